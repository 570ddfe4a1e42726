//! `mobgate user add`: adds a user of the gateway running on this machine by two lines of its console.
//!
//! The password is typed twice at a terminal, which does not show it, or is one line of standard input.

use std::io::{self, IsTerminal, Write as _, stderr, stdin};
use std::process::ExitCode;

use mobgate::console::PASSWORD_BYTES;
use mobgate::settings::PasswordHash;

use super::client::{Terminal, carry_out, exit_code};
use crate::cli::NewUser;
use crate::passwords;
use crate::reactor::block_on;
use crate::stdio::TerminalMode;

/// Adds the user, and saves the settings.
pub fn add(user: &NewUser) -> ExitCode {
    match hash_of_new(user) {
        Ok(hash) => exit_code(tell(user, &hash)),
        Err(fault) => {
            eprintln!("mobgate: {fault}");
            exit_code(Ok(Some(false)))
        }
    }
}

/// Runs both lines, the second one if the first one was carried out.
fn tell(NewUser { name, role, socket }: &NewUser, hash: &str) -> Result<Option<bool>, String> {
    for line in [&*format!("user {name} role {role} password \"{hash}\"\n"), "save\n"] {
        let done = carry_out(socket.as_deref(), line)?;
        if done != Some(true) {
            return Ok(done);
        }
    }
    println!("{name} may log in as {role}");
    Ok(Some(true))
}

/// Reads the password of the new user, and gives its hash: the gateway is told no more.
fn hash_of_new(user: &NewUser) -> Result<PasswordHash, String> {
    let password = password(user)?;
    if !PASSWORD_BYTES.contains(&password.len()) {
        let (least, most) = PASSWORD_BYTES.into_inner();
        return Err(format!("a password has {least} to {most} characters"));
    }
    block_on(passwords::hash(&password)).ok_or_else(|| "no random numbers for the hash".into())
}

fn password(user: &NewUser) -> Result<String, String> {
    if !stdin().is_terminal() {
        return line();
    }
    let hidden = Terminal::enter(TerminalMode::hidden).map_err(|error| error.to_string())?;
    if !hidden.has_changed() {
        return Err("this terminal would show the password: pass it on standard input".into());
    }
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
