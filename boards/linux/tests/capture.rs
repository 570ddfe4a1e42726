//! The program writes the frames of its lines into a file that tshark reads.

use std::fs;
use std::process::Command;

use common::{Program, ask, free_port, mobgate, wait_for};

mod common;

#[test]
fn frames_are_written_as_they_come_and_decoded_without_settings() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let file = folder.path().join("demo.pcapng");
    let mut command = mobgate();
    command.args(["--listen", &format!("127.0.0.1:{port}"), "--console", "off", "--capture"]).arg(&file);
    let program = Program::start(&mut command, folder, port);
    let answer = ask(&mut program.connect(), 1, &[3, 0, 0, 0, 2]);
    assert_eq!(answer[..2], [3, 4]);
    let whole = |written: &Vec<u8>| written.windows(7).any(|part| part == b"answers");
    wait_for("the answer in the file", || fs::read(&file).ok().filter(whole));
    let tshark = Command::new("tshark")
        .args(["-T", "fields", "-e", "modbus.func_code", "-e", "frame.comment", "-r"])
        .arg(&file)
        .output()
        .expect("tshark is installed");
    assert_eq!(String::from_utf8_lossy(&tshark.stdout), "3\trequests\n3\tanswers\n");
}

#[test]
fn a_file_that_cannot_be_written_is_said_at_the_start() {
    let output = common::output(&["--console", "off", "--capture", "/nowhere/capture.pcapng"]);
    assert!(!output.status.success());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("/nowhere/capture.pcapng: "), "{said}");
}
