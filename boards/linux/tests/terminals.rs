//! The console at a terminal: the program's own, and one that joins a gateway by `mobgate console`.

use rustix::process::{Pid, Signal, kill_process};

use common::terminal::{Terminal, status};
use common::{ask, converse, wait_for, with_console};

mod common;

#[test]
fn a_terminal_gets_a_prompt_and_echo_and_is_restored_at_the_end() {
    let mut terminal = Terminal::new();
    let program = terminal.gateway();
    terminal.type_in("", "mobgate> ");
    terminal.type_in("show con", "show con");
    terminal.type_in("fig\r", "serial demo rtu client");
    assert!(!terminal.is_cooked());
    // `exit` leads nowhere at a terminal: the gateway goes on, and so does its console.
    terminal.keyboard.write_all(b"exit\r").unwrap();
    program.logs("the gateway goes on; Ctrl-C");
    terminal.type_in("show ports\r", "P");
    assert!(!terminal.is_cooked());
    program.signal(Signal::TERM);
    assert_eq!(program.wait().code(), Some(0));
    assert!(terminal.is_cooked(), "the terminal was left raw");
}

#[test]
fn ctrl_c_ends_what_runs_then_the_line_and_twice_on_an_empty_one_the_gateway() {
    let mut terminal = Terminal::new();
    let mut program = terminal.gateway();
    for (command, begun, ended) in [
        ("watch\r", "watch\r\n", "mobgate> "),
        ("scan bus 300\r", "about", " units found in "),
        ("tune bus units 1 count 1000\r", "about", "mobgate> "),
    ] {
        terminal.type_in(command, begun);
        let said = terminal.type_in("\x03", ended);
        assert!(!said.contains("again"), "{said:?}");
        terminal.type_in("show version\r", "mobgate 0.");
    }
    let said = terminal.type_in("show lo\x03", "^C\r\n\rmobgate> ");
    assert!(!said.contains("again"), "{said:?}");
    terminal.type_in("\x03", "press Ctrl-C again to stop the gateway");
    // A key in between takes it back.
    terminal.type_in("show version\r", "mobgate 0.");
    terminal.type_in("\x03", "press Ctrl-C again to stop the gateway");
    assert!(program.is_running());
    terminal.keyboard.write_all(b"\x03").unwrap();
    assert_eq!(program.wait().code(), Some(0));
    assert!(terminal.is_cooked(), "the terminal was left raw");
}

#[test]
fn a_terminal_that_joins_has_prompt_tab_and_history_and_leaves_the_gateway_alone() {
    let mut program = with_console("port P502 tcp server {port}\n");
    let mut terminal = Terminal::new();
    let client = terminal.join(&program);
    terminal.type_in("", "mobgate> ");
    assert!(!terminal.is_cooked());
    terminal.type_in("show ver\t\r", "mobgate 0.");
    terminal.type_in("shwo\r", "error: column 1");
    terminal.type_in("\x1b[A\x1b[A\r", "mobgate 0.");
    terminal.type_in("watch\r", "watch\r\n");
    terminal.type_in("\x03", "mobgate> ");
    let said = terminal.type_in("abc\x03\x03\x03show version\r", "mobgate 0.");
    assert!(!said.contains("again"), "{said:?}");
    terminal.keyboard.write_all(b"\x04").unwrap();
    assert_eq!(status(client).code(), Some(0));
    assert!(terminal.is_cooked(), "the terminal was left raw");
    assert!(program.is_running());
}

#[test]
fn a_terminal_that_joined_is_restored_at_signals_and_at_the_gateway_s_end() {
    for signal in [Signal::TERM, Signal::HUP, Signal::INT, Signal::QUIT] {
        let program = with_console("port P502 tcp server {port}\n");
        let mut terminal = Terminal::new();
        let client = terminal.join(&program);
        terminal.type_in("", "mobgate> ");
        kill_process(Pid::from_child(&client), signal).unwrap();
        assert!(!status(client).success());
        assert!(terminal.is_cooked(), "{signal:?} left the terminal raw");
    }
    for signal in [Signal::TERM, Signal::KILL] {
        let program = with_console("port P502 tcp server {port}\n");
        let mut terminal = Terminal::new();
        let client = terminal.join(&program);
        terminal.type_in("", "mobgate> ");
        program.signal(signal);
        assert_eq!(status(client).code(), Some(3));
        assert!(terminal.is_cooked(), "the gateway's end left the terminal raw");
    }
}

#[test]
fn user_add_asks_twice_and_shows_no_key_of_the_password() {
    let program = with_console("port P502 tcp server {port}\n");
    let mut terminal = Terminal::new();
    let add = |terminal: &Terminal| {
        let mut command = terminal.command();
        command.args(["user", "add", "anna", "--socket"]).arg(program.socket());
        command.stdout(terminal.open()).stderr(terminal.open()).spawn().unwrap()
    };
    let differ = add(&terminal);
    let mut said = terminal.type_in("", "new password of anna: ");
    said += &terminal.type_in("battery staple\r", "again: ");
    said += &terminal.type_in("battery stapler\r", "the passwords differ");
    assert_eq!(status(differ).code(), Some(1));
    assert!(terminal.is_cooked(), "the terminal still hides what is typed");

    let good = add(&terminal);
    said += &terminal.type_in("", "new password of anna: ");
    said += &terminal.type_in("battery staple\r", "again: ");
    said += &terminal.type_in("battery staple\r", "anna may log in as engineer");
    assert_eq!(status(good).code(), Some(0));
    assert!(!said.contains("battery"), "{said}");

    let interrupted = add(&terminal);
    terminal.type_in("", "new password of anna: ");
    terminal.keyboard.write_all(b"batt\x03").unwrap();
    assert!(!status(interrupted).success());
    assert!(terminal.is_cooked(), "Ctrl-C left a terminal that hides what is typed");
}

#[test]
fn the_prompt_and_what_is_typed_stand_below_every_line_of_the_log() {
    let mut terminal = Terminal::new();
    let program = terminal.whole_gateway();
    let start = terminal
        .type_in("", "mobgate> ")
        .replace("\x1b[K", "")
        .replace("\x1b[32m", "")
        .replace("\x1b[0m", "");
    let seen = |line: &str| line.trim_end_matches('\r').rsplit('\r').next().unwrap().chars().count();
    assert!(start.lines().all(|line| seen(line) <= 80), "{start}");
    // All has been said about the start then.
    wait_for("the demo's line", || {
        converse(&mut program.session(), "show ports\n", "tcp server")
            .contains("19200 8E1    open")
            .then_some(())
    });
    terminal.type_in("show por", "show por");
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    let said = terminal.type_in("", "\nmobgate> show por");
    assert!(said.contains("console session of"), "{said:?}");
    terminal.type_in("ts\r", "rtu client");
    terminal.type_in("show\x1b[D\x1b[D", "\x1b[11C");
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    // The cursor is in its place again, too.
    terminal.type_in("", "\nmobgate> show\r\x1b[11C");
}

#[test]
fn a_terminal_that_nobody_reads_delays_no_request() {
    let terminal = Terminal::new();
    let program = terminal.whole_gateway();
    for _ in 0..400 {
        converse(&mut program.session(), "show version\n", "mobgate 0.");
    }
    assert_eq!(ask(&mut program.connect(), 2, &[1, 0, 0, 0, 8])[..2], [1, 1]);
}

#[test]
fn a_table_is_as_wide_as_the_terminal_and_follows_it() {
    let program = with_console("port P502 tcp server {port}\nroute P502 1 * * local\n");
    let mut terminal = Terminal::new();
    terminal.resize(132);
    let client = terminal.join(&program);
    terminal.type_in("show routes\r", "NO SOURCE          UNITS   IP                 TAG  DESTINATION");
    terminal.resize(80);
    terminal.type_in("show routes\r", "NO SOURCE UNITS IP TAG DESTINATION KIND POLICY\r\n");
    terminal.keyboard.write_all(b"\x04").unwrap();
    assert_eq!(status(client).code(), Some(0));
}
