//! The program writes the frames of its lines into a file that tshark reads.

use std::fs;
use std::process::Command;

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::path::Path;

use common::{PATIENCE, Program, ask, converse, free_port, wait_for};

mod common;

#[test]
fn frames_are_written_as_they_come_and_decoded_without_settings() {
    let options = ["--listen", "127.0.0.1:{port}", "--socket", "off", "--capture", "{folder}/demo.pcapng"];
    let program = Program::with("", &options);
    let file = program.file("demo.pcapng");
    let response = ask(&mut program.connect(), 1, &[3, 0, 0, 0, 2]);
    assert_eq!(response[..2], [3, 4]);
    wait_for("the response in the file", || fs::read(&file).ok().filter(|written| is_whole(written)));
    assert_eq!(decoded(&file), WHOLE);
}

/// A transaction by TCP and on the line.
const WHOLE: &str = "mbtcp\t3\trequests\nmbrtu\t3\trequests\nmbrtu\t3\tresponses\nmbtcp\t3\tresponses\n";

/// Whether the transaction's last frame has been written.
fn is_whole(written: &[u8]) -> bool {
    written.windows(9).filter(|part| part == b"responses").count() == 2
}

/// Protocol, function and verdict of the frames that tshark finds in `file`.
fn decoded(file: &Path) -> String {
    let mut tshark = Command::new("tshark");
    for field in ["frame.protocols", "modbus.func_code", "frame.comment"] {
        tshark.args(["-e", field]);
    }
    let tshark = tshark.args(["-T", "fields", "-r"]).arg(file).output().expect("tshark is installed");
    let fields = String::from_utf8_lossy(&tshark.stdout);
    fields.replace("exported_pdu:", "").replace(":modbus", "")
}

#[test]
fn the_console_begins_and_ends_a_file_and_writes_over_none() {
    let program = Program::demo_with_console();
    let file = program.file("later.pcapng");
    fs::create_dir(program.file("below")).unwrap();
    std::os::unix::fs::symlink("/", program.file("below/all")).unwrap();
    let mut console = program.session();
    // Nowhere else, and over nothing.
    for elsewhere in [file.to_str().unwrap(), "../later.pcapng", "below/../../x", "below/all/tmp/x"] {
        let refused = "captures are files below the folder that the program was started in";
        converse(&mut console, &format!("capture {elsewhere}\n"), refused);
    }
    let capture = "capture later.pcapng\n";
    console.write_all(capture.as_bytes()).unwrap();
    wait_for("the beginning of the file", || fs::read(&file).ok().filter(|written| !written.is_empty()));
    let mut client = program.connect();
    ask(&mut client, 1, &[3, 0, 0, 0, 2]);
    wait_for("the response in the file", || fs::read(&file).ok().filter(|written| is_whole(written)));
    converse(&mut console, "capture off\nshow version\n", "mobgate ");
    ask(&mut client, 1, &[3, 0, 0, 0, 2]);
    assert_eq!(decoded(&file), WHOLE, "the second transaction is not in there");
    converse(&mut console, capture, "failed (there is such a file already)");
}

#[test]
fn frames_are_streamed_by_tcp_to_whoever_connects() {
    let (program, wire) = (Program::demo_with_console(), free_port());
    let file = program.file("streamed.pcapng");
    let set = format!("port wire tcp server 127.0.0.1:{wire} capture\n");
    program.session().write_all(set.as_bytes()).unwrap();
    let mut stream = wait_for("the capture's port", || TcpStream::connect((Ipv4Addr::LOCALHOST, wire)).ok());
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let (mut streamed, mut part) = (Vec::new(), [0; 1024]);
    let mut take = |streamed: &mut Vec<u8>| {
        let count = stream.read(&mut part).unwrap();
        streamed.extend_from_slice(&part[..count]);
    };
    // What it begins with: from here on frames are followed.
    take(&mut streamed);
    ask(&mut program.connect(), 1, &[3, 0, 0, 0, 2]);
    while !is_whole(&streamed) {
        take(&mut streamed);
    }
    fs::write(&file, &streamed).unwrap();
    assert_eq!(decoded(&file), WHOLE);
}

#[test]
fn a_file_that_cannot_be_written_is_said_at_the_start() {
    let at = format!("127.0.0.1:{}", free_port());
    let said = common::refusal(&["--listen", &at, "--socket", "off", "--capture", "/nowhere/capture.pcapng"]);
    assert!(said.contains("/nowhere/capture.pcapng: "), "{said}");
}
