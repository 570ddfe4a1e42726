//! The console where the program offers it: standard input, a terminal, a TCP port.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::process::Stdio;
use std::time::Instant;

use rustix::process::Signal;
use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};
use serial2::SerialPort;

use common::{PATIENCE, Program, free_port, mobgate, output, session, wait_for, with_console};

mod common;

/// Types `line`, and reads until `answer` has come.
fn converse(session: &mut (impl Read + Write), line: &str, answer: &str) -> String {
    session.write_all(line.as_bytes()).unwrap();
    let mut heard = String::new();
    while !heard.contains(answer) {
        let mut piece = [0; 512];
        let count = session.read(&mut piece).unwrap_or_else(|error| panic!("{error} after {heard:?}"));
        assert!(count > 0, "the session ended after {heard:?}");
        heard.push_str(&String::from_utf8_lossy(&piece[..count]));
    }
    heard
}

#[test]
fn several_sessions_at_once_see_the_same_settings() {
    let (_program, console) = with_console("port P502 tcp server {port}\n");
    let (mut one, mut two) = (session(console), session(console));
    converse(&mut one, "port P7 serial /dev/ttyS7 rtu client 9600 8N1\nshow config\n", "ttyS7");
    converse(&mut two, "show config\n", "ttyS7");
}

#[test]
fn the_program_is_up_since_it_was_started_and_not_since_the_machine_was() {
    let before = Instant::now();
    let (_program, console) = with_console("port P502 tcp server {port}\n");
    let said = converse(&mut session(console), "show version\n", "\n");
    let up = said.trim_end().rsplit_once(", up ").and_then(|(_, up)| up.strip_suffix('s')).unwrap();
    assert!(up.parse::<u64>().unwrap() <= before.elapsed().as_secs(), "{said}");
}

#[test]
fn save_writes_the_file_that_check_finds_good() {
    let (program, console) = with_console("port P502 tcp server {port}\n");
    let mut console = session(console);
    console
        .write_all(b"port P7 serial /dev/ttyS7 rtu client 9600 8N1\nroute P502 1-9 * * P7\nsave\n")
        .unwrap();
    wait_for("the file", || fs::read_to_string(program.config()).unwrap().contains("ttyS7").then_some(()));
    let checked = output(&["--check", program.config().to_str().unwrap()]);
    assert!(checked.status.success(), "{checked:?}");
}

#[test]
fn the_demo_cannot_save_and_says_how_it_could() {
    let (port, console) = (free_port(), free_port());
    let mut command = mobgate();
    command.args(["--listen", &port.to_string(), "--console", &console.to_string()]);
    let _program = Program::start(&mut command, tempfile::tempdir().unwrap(), port);
    converse(&mut session(console), "save\n", "start with --config FILE");
}

#[test]
fn reboot_starts_the_program_again_with_the_saved_settings() {
    let (mut program, console) = with_console("port P502 tcp server {port}\n");
    let new = free_port();
    fs::write(program.config(), format!("port P502 tcp server {new}\n")).unwrap();
    converse(&mut session(console), "reboot\n", "starting again");
    wait_for("the new port", || TcpStream::connect((Ipv4Addr::LOCALHOST, new)).ok());
    assert!(program.is_running(), "the process stays the same");
    program.signal(Signal::TERM);
    assert_eq!(program.wait().code(), Some(0));
}

#[test]
fn a_taken_console_port_ends_the_start_only_when_it_was_asked_for() {
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let at = taken.local_addr().unwrap().port().to_string();
    let listen = free_port().to_string();
    let started = output(&["--listen", &listen, "--console", &at]);
    assert_eq!(started.status.code(), Some(1));
    assert!(String::from_utf8(started.stderr).unwrap().contains("console"));
}

#[test]
fn lines_of_a_file_on_standard_input_are_carried_out_and_the_gateway_goes_on() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let (config, lines) = (folder.path().join("mobgate.conf"), folder.path().join("lines"));
    fs::write(&config, "").unwrap();
    // The last line lacks its end.
    fs::write(&lines, format!("port P502 tcp server 127.0.0.1:{port}\nshow config")).unwrap();
    let mut command = mobgate();
    command.arg("--config").arg(config).args(["--console", "off"]).stdin(File::open(lines).unwrap());
    let mut program = Program::start(&mut command, folder, port);
    program.logs(&format!("port P502 tcp server 127.0.0.1:{port}"));
    assert!(program.is_running());
}

/// The program in a session of its own, whose terminal is a PTY; setsid(1) of util-linux makes the PTY its terminal.
fn on_terminal() -> (Program, SerialPort, SerialPort) {
    let (mut keyboard, terminal) = SerialPort::pair().unwrap();
    keyboard.set_read_timeout(PATIENCE).unwrap();
    let mut cooked = tcgetattr(&terminal).unwrap();
    cooked.local_modes |= LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
    tcsetattr(&terminal, OptionalActions::Now, &cooked).unwrap();
    let name = rustix::termios::ttyname(&terminal, Vec::new()).unwrap().into_string().unwrap();
    let port = free_port();
    let open = || File::options().read(true).write(true).open(&name).unwrap();
    let mut command = std::process::Command::new("setsid");
    command.args(["--ctty", "--wait", env!("CARGO_BIN_EXE_mobgate"), "--console", "off", "--listen"]);
    command.arg(port.to_string()).stdin(Stdio::from(open()));
    let program = Program::start_on(&mut command, Stdio::from(open()), tempfile::tempdir().unwrap(), port);
    (program, keyboard, terminal)
}

#[test]
fn a_terminal_gets_a_prompt_and_echo_and_is_restored_at_the_end() {
    let (program, mut keyboard, terminal) = on_terminal();
    let cooked = || tcgetattr(&terminal).unwrap().local_modes.contains(LocalModes::ICANON | LocalModes::ECHO);
    converse(&mut keyboard, "", "mobgate> ");
    converse(&mut keyboard, "show con", "show con");
    converse(&mut keyboard, "fig\r", "serial demo rtu client");
    assert!(!cooked());
    // `exit` leads nowhere at a terminal: the gateway goes on, and so does its console.
    keyboard.write_all(b"exit\r").unwrap();
    program.logs("Ctrl-C ends it");
    converse(&mut keyboard, "show ports\r", "P");
    assert!(!cooked());
    keyboard.write_all(b"\x03").unwrap();
    assert_eq!(program.wait().code(), Some(0));
    assert!(cooked(), "the terminal was left raw");
}
