//! The program's start and end: options, bad configurations, signals.

use std::fs;
use std::net::Ipv4Addr;
use std::os::unix::net::UnixDatagram;
use std::thread;
use std::time::Duration;

use rustix::process::Signal;

use common::{PATIENCE, Program, ask, converse, free_port, listening, mobgate, output, refusal, wait_for};

mod common;

/// What the program tells a service manager, up to `last`.
fn told(socket: &UnixDatagram, last: &str) -> Vec<String> {
    let mut told = Vec::new();
    while told.last().is_none_or(|state| state != last) {
        let mut state = [0; 256];
        let count = socket.recv(&mut state).unwrap_or_else(|error| panic!("{error} after {told:?}"));
        told.push(String::from_utf8_lossy(&state[..count]).trim().to_owned());
    }
    told
}

#[test]
fn a_service_manager_is_told_that_it_runs_goes_on_and_stops() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut command = mobgate();
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "60000");
    let program = Program::by(&mut command, "", &["--listen", "127.0.0.1:{port}", "--socket", "off"]);
    assert_eq!(told(&socket, "WATCHDOG=1"), ["READY=1", "WATCHDOG=1"]);
    // By itself, again and again.
    assert_eq!(told(&socket, "WATCHDOG=1"), ["WATCHDOG=1"]);
    program.signal(Signal::TERM);
    let told = told(&socket, "STOPPING=1");
    assert!(told[..told.len() - 1].iter().all(|state| state == "WATCHDOG=1"), "{told:?}");
}

#[test]
fn a_port_that_a_test_was_given_is_nobody_elses() {
    let given = common::free_port();
    assert!(!mobgate_simulator::ports::reserve(given), "although nobody listens there yet");
    assert_ne!(common::free_port(), given);
}

/// A good file but for its seventh line.
const BAD_LINE_7: &str = "\
# lines
port P1 serial /dev/ttyS7 rtu client 9600 8N1

# clients
port P502 tcp server {port}

route P502 1-247 * * P9
";

fn file(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(&file, text).unwrap();
    file
}

#[test]
fn check_names_file_line_and_word_of_an_error() {
    // The blank line after the ports is line 6.
    let file = file(&BAD_LINE_7.replace("{port}", "502"));
    let path = file.path().to_str().unwrap();
    let said = refusal(&["--check", path]);
    for part in [path, "line 7", "\"P9\""] {
        assert!(said.contains(part), "{part} is not in {said:?}");
    }
}

#[test]
fn sii_and_esi_write_what_the_gateway_is_on_ethercat() {
    let folder = tempfile::tempdir().unwrap();
    // SPI, and SYNC signals.
    for (word, begins) in [("sii", &[0x80, 0x04][..]), ("esi", b"<?xml")] {
        let path = folder.path().join(word);
        let made = output(&[word, path.to_str().unwrap()]);
        assert_eq!((made.status.code(), made.stdout.len()), (Some(0), 0));
        assert!(fs::read(&path).unwrap().starts_with(begins));
    }
    let [fixed, modular] = [&[][..], &["--modules"]].map(|more| {
        let path = folder.path().join("image");
        assert!(output(&[&["sii"], more, &[path.to_str().unwrap()]].concat()).status.success());
        let image = fs::read(&path).unwrap();
        u32::from_le_bytes(image[0x14..0x18].try_into().unwrap())
    });
    assert_eq!(modular, fixed + 1, "another product");
    let settings = file("port ecat ethercat modules\nslave 0 unit 17 input 0 count 4 as f32\n");
    let path = folder.path().join("modules.xml");
    let made = output(&["esi", "--config", settings.path().to_str().unwrap(), path.to_str().unwrap()]);
    assert!(made.status.success(), "{made:?}");
    let module = "<Name>Slave 0, unit 17: 4 REAL in input registers</Name>";
    assert!(fs::read_to_string(&path).unwrap().contains(module));
    let bad = file("port ecat ethercat modules\nslave 0 unit 300\n");
    let refused = refusal(&["esi", "--config", bad.path().to_str().unwrap(), path.to_str().unwrap()]);
    assert!(refused.contains("line 2"), "says where");
    assert!(refusal(&["esi", "/does/not/exist"]).contains("/does/not/exist"));
}

/// What `--check` says of a good file with this text.
fn checked(text: &str) -> String {
    let file = file(text);
    let checked = output(&["--check", file.path().to_str().unwrap()]);
    assert_eq!(checked.status.code(), Some(0));
    String::from_utf8(checked.stdout).unwrap()
}

#[test]
fn check_of_a_good_file_says_so_and_ends_with_0() {
    assert!(checked("port P1 serial /dev/ttyS7 rtu client 9600 8N1\n").contains("good"));
}

#[test]
fn check_says_which_rules_never_match_or_lead_in_a_circle() {
    let said = checked(
        "port P502 tcp server 502\nport c tcp client 127.0.0.1:502\n\
         route P502 1-9 * * c\nroute P502 5 * * c readonly\n",
    );
    assert!(said.contains(": rule 2 never matches: rule 1 takes all its requests\n"), "{said}");
    assert!(
        said.contains(": rule 1 leads unit 1 in a circle: its requests come back by port P502\n"),
        "{said}"
    );
}

#[test]
fn check_of_a_file_that_does_not_exist_ends_with_1() {
    refusal(&["--check", "/does/not/exist"]);
}

#[test]
fn check_finds_more_connections_than_there_are() {
    let file = file("port P502 tcp server 502 clients 999\n");
    assert!(refusal(&["--check", file.path().to_str().unwrap()]).contains("1000 connections"));
}

#[test]
fn the_program_does_not_start_half_configured() {
    let port = free_port();
    let file = file(&BAD_LINE_7.replace("{port}", &port.to_string()));
    let said = refusal(&["--config", file.path().to_str().unwrap(), "--socket", "off"]);
    assert!(said.contains("line 7") && !said.contains("listening"), "{said}");
}

#[test]
fn a_bad_option_ends_with_2_and_help_tells_the_exit_codes() {
    assert_eq!(output(&["--listen", "nowhere"]).status.code(), Some(2));
    let help = String::from_utf8(output(&["--help"]).stdout).unwrap();
    assert!(help.contains("Exit codes"));
    let examples = help.lines().skip_while(|line| *line != "Examples:").skip(1);
    let examples: Vec<_> = examples.take_while(|line| !line.is_empty()).collect();
    assert!(examples.len() > 5 && examples.iter().all(|line| line.starts_with("  ")), "{help}");
}

#[test]
fn a_configured_port_that_is_taken_ends_the_start_with_a_hint() {
    let (_taken, at) = listening();
    let file = file(&format!("port P502 tcp server 127.0.0.1:{at}\n"));
    let said = refusal(&["--config", file.path().to_str().unwrap(), "--socket", "off"]);
    assert!(said.contains("P502") && said.contains("in use") && said.contains("ss -ltnp"), "{said}");
}

#[test]
fn the_demo_serves_its_three_devices_and_prints_the_commands_to_try() {
    let program = Program::demo();
    let mut client = program.connect();
    let meter = ask(&mut client, 1, &[4, 0, 0, 0, 2]);
    let volts = f32::from_be_bytes(meter[2..6].try_into().unwrap());
    assert!((227.0..233.0).contains(&volts), "{volts} V");
    assert_eq!(ask(&mut client, 2, &[5, 0, 0, 0xff, 0]), [5, 0, 0, 0xff, 0]);
    assert_eq!(ask(&mut client, 2, &[1, 0, 0, 0, 8]), [1, 1, 1]);
    let asked = std::time::Instant::now();
    assert_eq!(ask(&mut client, 3, &[3, 0, 0, 0, 1]).len(), 4);
    assert!(asked.elapsed() >= Duration::from_millis(300));
    program.logs(&format!("mbpoll -m tcp -p {} -a 1", program.port));
}

#[test]
fn the_line_that_the_demo_prints_protects_the_meter_from_writes() {
    let program = Program::demo_with_console();
    let mut client = program.connect();
    let write = [6, 0, 9, 0, 1];
    assert_eq!(ask(&mut client, 1, &write), write);
    program.logs("protect the meter");
    let said = program.log();
    let line = said.lines().map(str::trim).find(|line| line.ends_with("readonly")).unwrap();
    converse(&mut program.session(), &format!("{line}\nshow routes\n"), "readonly");
    assert_eq!(ask(&mut client, 1, &write), [0x86, 1]);
    assert_eq!(ask(&mut client, 2, &[5, 0, 0, 0xff, 0]), [5, 0, 0, 0xff, 0], "the relays are not protected");
}

#[test]
fn the_meters_registers_move() {
    let program = Program::demo();
    let mut client = program.connect();
    let first = ask(&mut client, 1, &[4, 0, 0, 0, 6]);
    wait_for("another value", || (ask(&mut client, 1, &[4, 0, 0, 0, 6]) != first).then_some(()));
}

/// The demo has no file to read at SIGHUP.
#[test]
fn sigterm_and_sigint_end_the_program_with_0_and_sighup_the_demo() {
    for signal in [Signal::TERM, Signal::INT, Signal::HUP] {
        let program = Program::demo();
        program.signal(signal);
        assert_eq!(program.wait().code(), Some(0), "{signal:?}");
    }
}

#[test]
fn sighup_takes_the_file_over_as_a_whole_or_not_at_all() {
    let mut program = Program::configured("port P502 tcp server {port}\n");
    let (old, new) = (program.port, free_port());
    fs::write(program.config(), format!("port P502 tcp server {new}\nport P503 tcp serve 503\n")).unwrap();
    program.signal(Signal::HUP);
    program.logs("line 2");
    program.connect();

    fs::write(program.config(), format!("port P502 tcp server {new}\n")).unwrap();
    program.signal(Signal::HUP);
    program.port = new;
    wait_for("the new port", || std::net::TcpStream::connect((Ipv4Addr::LOCALHOST, new)).ok());
    wait_for("the old port's end", || std::net::TcpStream::connect((Ipv4Addr::LOCALHOST, old)).err());
}

#[test]
fn the_end_of_standard_input_neither_ends_nor_spins_the_program() {
    let mut program = Program::demo();
    let before = program.cpu_ticks();
    thread::sleep(Duration::from_secs(2)); // what is measured
    let spent = program.cpu_ticks() - before;
    assert!(program.is_running());
    assert!(spent < 20, "{} ms of processor time in 2 s of doing nothing", spent * 10);
}

#[test]
fn the_journal_gets_priorities_and_no_times() {
    let settings = "port P1 serial /dev/does-not-exist rtu client\nport P502 tcp server {port}\n";
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "off"];
    let program = Program::by(mobgate().env("JOURNAL_STREAM", "8:12345"), settings, &options);
    program.logs("<4>/dev/does-not-exist cannot be opened: not found");
}
