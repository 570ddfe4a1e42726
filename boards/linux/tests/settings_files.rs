//! The configuration file: what is refused as one, and what a save does to it, also where it cannot be written.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Instant;

use rustix::process::Signal;

use common::{
    PATIENCE, Program, USER, ask, converse, free_port, mobgate, output, refusal, wait_for, with_console,
};

mod common;

/// A file as a person writes it.
const FILE: &str = "\
# The boiler house

port P502 tcp server {port}   # SCADA
# 19200 8E1
port P1 serial /dev/ttyS77 rtu client

route P502 1-9 * * P1
# the end
";

/// The same with somebody who may log in.
fn with_user(port: u16) -> String {
    FILE.replace("{port}", &port.to_string()) + USER
}

fn check(path: &Path) -> Output {
    output(&["--check", path.to_str().unwrap()])
}

/// What `--check` says of a file that it refuses.
fn refused(path: &Path) -> String {
    let begun = Instant::now();
    let said = refusal(&["--check", path.to_str().unwrap()]);
    assert!(begun.elapsed() < PATIENCE / 2, "{} took {:?}", path.display(), begun.elapsed());
    said
}

/// What `--check` says of a file with this text.
fn refusal_of(text: &str) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(&file, text).unwrap();
    refused(file.path())
}

/// Types `line` and gives the response up to its end.
fn type_line(console: &mut (impl Read + Write), line: &str) -> String {
    console.write_all(format!("{line}\n").as_bytes()).unwrap();
    let mut response = Vec::new();
    while !response.ends_with(b"\n") {
        let mut byte = [0];
        console.read_exact(&mut byte).unwrap_or_else(|error| panic!("{error} after {line}"));
        response.push(byte[0]);
    }
    String::from_utf8(response).unwrap()
}

/// Makes a named pipe.
fn fifo(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
fn what_is_no_file_of_bounded_length_is_refused_without_being_read() {
    let folder = tempfile::tempdir().unwrap();
    let (pipe, long) = (folder.path().join("pipe"), folder.path().join("long"));
    fifo(&pipe);
    File::create(&long).unwrap().set_len(1 << 30).unwrap();
    for (path, expected) in [
        (Path::new("/dev/zero"), "it is a device, not a file"),
        (&pipe, "it is a pipe, not a file"),
        (folder.path(), "it is a folder, not a file"),
        (&long, "it is longer than 262144 bytes, the most that a settings file may have"),
    ] {
        assert_eq!(refused(path), format!("mobgate: {}: {expected}\n", path.display()));
        assert!(refusal(&["--config", path.to_str().unwrap(), "--socket", "off"]).contains(expected));
    }
}

#[test]
fn sighup_refuses_them_too_and_goes_on() {
    let program = with_console(FILE);
    fs::remove_file(program.config()).unwrap();
    fifo(&program.config());
    program.signal(Signal::HUP);
    program.logs("it is a pipe, not a file; everything stays as it was");
    fs::remove_file(program.config()).unwrap();
    File::create(program.config()).unwrap().set_len(1 << 30).unwrap();
    program.signal(Signal::HUP);
    program.logs("it is longer than 262144 bytes");
    assert_eq!(ask(&mut program.connect(), 70, &[3, 0, 0, 0, 1]), [0x83, 0x0a]);
}

#[test]
fn a_byte_order_mark_and_crlf_are_good() {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(&file, "\u{feff}port P1 serial ttyS77 rtu client\r\n\r\nport P2 tcp server 502\r\n").unwrap();
    assert!(check(file.path()).status.success());
}

#[test]
fn lines_for_boards_are_refused_with_their_line_and_word() {
    for line in ["network dhcp", "network dhcp name x", "network address 10.0.0.5/8"] {
        let said = refusal_of(&format!("port P1 tcp server 502\n\n  {line}\n"));
        let expected = "line 3, column 3: \"network\": network lines are for boards with a network of their own; \
                        here the operating system manages it";
        assert!(said.contains(expected), "{said}");
    }
    let said = refusal_of("port E ethercat\nport P1 tcp server 502\n");
    let expected =
        "line 1, column 8: \"ethercat\": there is no EtherCAT controller here; name the network interface";
    assert!(said.contains(expected), "{said}");
    let said = refusal_of("port E ethercat interface an/eth1\n");
    assert!(
        said.contains("line 1, column 27: \"an/eth1\": expected a network interface such as eth1"),
        "{said}"
    );
    let said = refusal_of("port P1 tcp server 502 clients 200\nport P2 tcp server 503 clients 200\n");
    assert!(said.contains("line 2, column 24: \"clients\": the TCP servers need 402 connections"), "{said}");
    let program = with_console("port P502 tcp server {port}\n");
    let said = type_line(&mut program.session(), "network dhcp");
    assert!(said.contains("error: line 1, network lines are for boards"), "{said}");
}

#[test]
fn two_names_of_one_device_are_refused_with_both_ports() {
    let folder = tempfile::tempdir().unwrap();
    let link = |name: &str, target: &str| {
        let path = folder.path().join(name);
        symlink(target, &path).unwrap();
        path.into_os_string().into_string().unwrap()
    };
    // /dev/null is a device that every machine has; the other one is not plugged in.
    let (present, absent) = (link("null", "/dev/null"), link("gone", "/dev/ttyS77"));
    for (one, other) in [
        ("/dev/null", present.as_str()),
        ("null", &present),
        ("/dev/ttyS77", "ttyS77"),
        ("/dev/ttyS77", "/dev//ttyS77"),
        ("/dev/./ttyS77", "/dev/ttyS77"),
        ("/dev/ttyS77", &absent),
    ] {
        let said = refusal_of(&format!("port A serial {one} rtu client\nport B serial {other} rtu client\n"));
        assert!(said.contains(": line 2, column 15: \""), "{said}");
        assert!(said.contains("\": ports A and B are on the same device"), "{said}");
    }
    let program = with_console("port P502 tcp server {port}\nport A serial ttyS77 rtu client\n");
    let said = type_line(&mut program.session(), "port B serial /dev/ttyS77 rtu client");
    assert_eq!(said, "error: line 1, ports A and B are on the same device\n");
}

#[test]
fn names_of_adapters_may_be_as_long_as_names_of_files() {
    let serial =
        "usb-Silicon_Labs_CP2102N_USB_to_UART_Bridge_Controller_ca9a25868e1bec11a0bd4c8e5bbd1b2f-if00-port0";
    let file = tempfile::NamedTempFile::new().unwrap();
    let longest = format!("/dev/serial/by-id/{:x<237}", serial);
    fs::write(
        &file,
        format!(
            "port P1 serial /dev/serial/by-id/{serial} rtu client\nport P2 serial {longest} rtu client\n"
        ),
    )
    .unwrap();
    let checked = check(file.path());
    assert!(checked.status.success(), "{checked:?}");
    let said = refusal_of(&format!("port P2 serial {longest}x rtu client\n"));
    assert!(said.contains("at most 255 characters"), "{said}");
}

#[test]
fn a_save_keeps_what_people_have_written() {
    let program = with_console(FILE);
    let mut console = program.session();
    let file = FILE.replace("{port}", &program.port.to_string());
    assert_eq!(type_line(&mut console, "edit port P1 9600\nroute P502 10 * * P1\nsave"), "saved\n");
    let expected = file
        .replace(
            "port P1 serial /dev/ttyS77 rtu client\n",
            "port P1   serial /dev/ttyS77 rtu client 9600 8E1\n",
        )
        .replace("* * P1\n", "* * P1\nroute P502 10      * * P1\n");
    assert_eq!(fs::read_to_string(program.config()).unwrap(), expected);
    assert_eq!(type_line(&mut console, "edit port P1 19200\ndelete route 2\nsave"), "saved\n");
    let expected = file.replace("rtu client\n", "rtu client 19200 8E1\n").replace("port P1 ", "port P1   ");
    assert_eq!(fs::read_to_string(program.config()).unwrap(), expected);
}

#[test]
fn a_file_that_was_edited_is_written_over_by_force_alone() {
    let program = with_console(FILE);
    let (mut one, mut other) = (program.session(), program.session());
    let edited = format!("# edited\nport P502 tcp server {}\n", program.port);
    fs::write(program.config(), &edited).unwrap();
    let said = type_line(&mut one, "save");
    assert!(said.contains("the file was edited since it was read") && said.contains("save force"), "{said}");
    assert_eq!(fs::read_to_string(program.config()).unwrap(), edited);
    assert_eq!(type_line(&mut one, "save force"), "saved\n");
    let saved = fs::read_to_string(program.config()).unwrap();
    assert!(saved.starts_with(&edited) && saved.contains("ttyS77"), "{saved}");
    // What one session has written is known to the others; so is what was loaded or taken over at SIGHUP.
    assert_eq!(type_line(&mut other, "edit port P1 9600\nsave"), "saved\n");
    fs::write(program.config(), &edited).unwrap();
    assert_eq!(type_line(&mut other, "load"), "loaded\n");
    assert_eq!(type_line(&mut one, "save"), "saved\n");
    fs::write(program.config(), FILE.replace("{port}", &program.port.to_string())).unwrap();
    program.signal(Signal::HUP);
    program.logs("taken over");
    assert_eq!(type_line(&mut one, "save"), "saved\n");
    // A file that was refused has not been taken over.
    fs::write(program.config(), "port P9 serial\n").unwrap();
    assert!(type_line(&mut one, "load").contains("line 1"));
    assert!(type_line(&mut one, "save").contains("was edited"));
}

#[test]
fn sighup_keeps_what_was_not_saved_beside_the_file() {
    let program = with_console(FILE);
    let mut console = program.session();
    let aside = program.config().with_extension("conf.unsaved");
    program.signal(Signal::HUP);
    program.logs("taken over");
    assert!(!aside.exists(), "there was nothing to keep");
    type_line(&mut console, "edit port P1 9600\nshow version");
    let edited = format!("# edited\nport P502 tcp server {}\n", program.port);
    fs::write(program.config(), &edited).unwrap();
    program.signal(Signal::HUP);
    program.logs("mobgate.conf.unsaved: has the changes that were not saved");
    wait_for("the file's settings", || (program.log().matches("taken over").count() == 2).then_some(()));
    let expected = FILE.replace("{port}", &program.port.to_string()).replace(
        "port P1 serial /dev/ttyS77 rtu client\n",
        "port P1   serial /dev/ttyS77 rtu client 9600 8E1\n",
    );
    assert_eq!(fs::read_to_string(&aside).unwrap(), expected);
    assert_eq!(fs::read_to_string(program.config()).unwrap(), edited);
    assert_eq!(type_line(&mut console, "save"), "saved\n", "they are not unsaved any more");
    assert_eq!(fs::read_to_string(program.config()).unwrap(), edited);
}

#[test]
fn what_an_interrupted_save_has_left_goes_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let (config, port) = (folder.path().join("mobgate.conf"), free_port());
    let left = folder.path().join(".mobgate.conf.x1Y2z3.saving");
    fs::write(&config, format!("port P502 tcp server {port}\n")).unwrap();
    fs::write(&left, "port P5").unwrap();
    assert!(check(&config).status.success());
    assert!(left.exists(), "who checks a file changes nothing");
    let mut command = mobgate();
    command.arg("--config").arg(&config).args(["--socket", "off"]);
    let program = Program::start(&mut command, folder, port);
    assert!(!left.exists());
    program.logs(".mobgate.conf.x1Y2z3.saving: removed");
}

/// Starts the program by `sh` behind the options of unshare(1) in a namespace of its own, after `prepare`, where `$1` is the
/// folder of its file. Saves there, and gives what the console says, with the program.
fn save_where(unshare: &[&str], prepare: &str) -> (Program, String) {
    mobgate_simulator::own_network::require_user_namespaces();
    let folder = tempfile::tempdir().unwrap();
    let (port, console) = (free_port(), free_port());
    let config = folder.path().join("mobgate.conf");
    fs::write(&config, with_user(port)).unwrap();
    let mut command = Command::new("unshare");
    command.args(unshare).args([
        "sh",
        "-ec",
        &format!("{prepare}\nexec \"$2\" --config \"$3\" --console \"$4\" --socket off"),
    ]);
    command.arg("sh").arg(folder.path()).arg(env!("CARGO_BIN_EXE_mobgate")).arg(&config);
    command.arg(console.to_string()).env_remove("RUST_LOG").stdin(std::process::Stdio::null());
    let program = Program::start(&mut command, folder, port);
    // The console opens a moment after the gateway's own ports.
    let mut console = wait_for("the console", || TcpStream::connect((Ipv4Addr::LOCALHOST, console)).ok());
    console.set_read_timeout(Some(PATIENCE)).unwrap();
    converse(&mut console, "anna\n", "password: ");
    console.write_all(b"let me in\n").unwrap();
    let said = type_line(&mut console, "edit port P1 9600\nsave");
    // The settings are in force, and are not lost.
    converse(&mut console, "show config\n", &format!("P502 tcp server {port}"));
    (program, said)
}

/// The file, and how many others there are beside it, as the program sees them.
fn seen_by(program: &Program) -> (String, usize) {
    let inside = format!("/proc/{}/root{}", program.id(), program.config().display());
    let inside = Path::new(&inside);
    let others = fs::read_dir(inside.parent().unwrap()).unwrap().count() - 1;
    (fs::read_to_string(inside).unwrap(), others)
}

#[test]
fn a_full_disk_is_named_and_leaves_the_old_file() {
    let full = "text=$(cat \"$1/mobgate.conf\"); mount -t tmpfs -o size=16k none \"$1\"
        printf '%s\\n' \"$text\" >\"$1/mobgate.conf\"
        head -c 100000 /dev/zero >\"$1/filler\" 2>/dev/null || true";
    let (program, said) = save_where(&["--mount", "--map-root-user"], full);
    assert!(said.contains("error: line 2, the settings cannot be read or saved: the disk is full"), "{said}");
    assert_eq!(seen_by(&program), (with_user(program.port), 1));
}

#[test]
fn a_read_only_file_system_is_named() {
    let read_only = "mount --bind \"$1\" \"$1\"; mount -o remount,bind,ro \"$1\"";
    let (program, said) = save_where(&["--mount", "--map-root-user"], read_only);
    assert!(said.contains("the file system is read-only"), "{said}");
    assert_eq!(seen_by(&program), (with_user(program.port), 0));
}

#[test]
fn a_folder_that_may_not_be_written_is_named() {
    // In a user namespace without a mapping permission bits hold for root as well.
    let (program, said) = save_where(&["--user"], "chmod 555 \"$1\"");
    let folder = program.config().parent().unwrap().to_owned();
    assert!(said.contains("permission denied"), "{said}");
    assert_eq!(seen_by(&program), (with_user(program.port), 0));
    fs::set_permissions(folder, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn a_limit_of_the_system_is_named_and_does_not_end_the_program() {
    let (mut program, said) = save_where(&["--user"], "prlimit --pid $$ --fsize=100");
    assert!(said.contains("longer than the system lets this program write"), "{said}");
    assert_eq!(seen_by(&program), (with_user(program.port), 0));
    assert!(program.is_running());
}

#[test]
fn saved_versions_outlive_a_start_and_come_back_even_where_one_is_corrupt() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("mobgate.conf");
    let first = "# by hand\nport P1 serial /dev/ttyS77 rtu client 19200 8E1\n";
    fs::write(&config, first).unwrap();
    // What a program that starts with the file says to `text`.
    let lines = |text: &str, count: usize| {
        let mut command = mobgate();
        command.arg("--config").arg(&config).args(["--socket", "off"]).env("RUST_LOG", "off");
        let mut program = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        program.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        let mut out = BufReader::new(program.stdout.take().unwrap()).lines();
        let said = (0..count).map(|_| out.next().unwrap().unwrap()).collect::<Vec<_>>();
        program.kill().unwrap();
        program.wait().unwrap();
        said
    };
    assert_eq!(lines("edit port P1 9600\nsave\nedit port P1 4800\nsave\n", 2), ["saved", "saved"]);
    let listed = lines("versions\n", 4);
    let rows: Vec<Vec<&str>> = listed.iter().map(|row| row.split_whitespace().collect()).collect();
    assert_eq!(rows[0], ["NO", "TIME", "LINES", "WHO"]);
    assert_eq!((rows[1][0], &rows[1][2..]), ("0", &["+1", "-1", "local", "console"][..]));
    assert_eq!((rows[3][0], &rows[3][2..]), ("2", &["+2", "-0", "system"][..]));
    let path = folder.path().join("mobgate.conf.versions");
    let corrupt = fs::read_to_string(&path).unwrap().replacen("4800", "4801", 1);
    fs::write(&path, corrupt).unwrap();
    // The last one is corrupt, so the one before it has its number.
    let said = lines("rollback 1\ncommit\n", 2);
    assert_eq!(said, ["version 1 is the candidate: see `diff`, then `commit`", "in force and saved"]);
    assert_eq!(fs::read_to_string(&config).unwrap(), first);
}
