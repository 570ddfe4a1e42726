//! `mobgate user add`: adds a user of the gateway running on this machine by three lines of its console.
//!
//! The password is typed twice at a terminal, which does not show it, or is one line of standard input.

use std::io::{self, IsTerminal, Write as _, stderr, stdin};
use std::process::ExitCode;

use super::client::{Terminal, carry_out, exit_code};
use crate::cli::NewUser;
use crate::stdio::RawMode;

/// Adds the user, and saves the settings.
pub fn add(user: &NewUser) -> ExitCode {
    match password(user) {
        Ok(password) => exit_code(tell(user, &password)),
        Err(fault) => {
            eprintln!("mobgate: {fault}");
            exit_code(Ok(Some(false)))
        }
    }
}

/// Runs the lines one after the other: a password behind a line that was refused would be taken for a command.
fn tell(NewUser { name, role, socket }: &NewUser, password: &str) -> Result<Option<bool>, String> {
    let lines =
        [format!("user {name} role {role}\n"), format!("password {name}\n{password}\n"), "save\n".into()];
    for line in lines {
        let done = carry_out(socket.as_deref(), &line)?;
        if done != Some(true) {
            return Ok(done);
        }
    }
    println!("{name} may log in as {role}");
    Ok(Some(true))
}

/// Reads the password of the new user.
fn password(user: &NewUser) -> Result<String, String> {
    if !stdin().is_terminal() {
        return line();
    }
    let _hidden_until_read = Terminal::enter(RawMode::hide).map_err(|error| error.to_string())?;
    let first = ask(&format!("new password of {}: ", user.name))?;
    if ask("again: ")? == first { Ok(first) } else { Err("the passwords differ".into()) }
}

fn ask(prompt: &str) -> Result<String, String> {
    // What the terminal does not show includes the end of the line.
    let show = |text: &str| stderr().write_all(text.as_bytes()).map_err(|error| error.to_string());
    show(prompt)?;
    let typed = line();
    show("\n")?;
    typed
}

fn line() -> Result<String, String> {
    let mut line = String::new();
    let read = stdin().read_line(&mut line).map_err(|error: io::Error| format!("the password: {error}"))?;
    if read == 0 {
        Err("no password was given".into())
    } else {
        Ok(line.trim_end_matches(['\r', '\n']).into())
    }
}
