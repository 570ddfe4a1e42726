//! The audit trail at a syslog server: read by a parser of others, from a server that comes late, and one that goes.

use std::io::{BufReader, Read};
use std::net::{Ipv4Addr, TcpListener, TcpStream, UdpSocket};

use common::{PATIENCE, Program, ask, converse, free_port, wait_for};
use rustix::process::Signal;
use syslog_loose::{Message, ProcId, Protocol, SyslogFacility, Variant, parse_message};

mod common;

/// The program with a console, a server whose writes are denied, and this line of settings.
fn program(line: &str) -> Program {
    let settings =
        format!("port P502 tcp server 127.0.0.1:{{port}}\nroute P502 1 * * local readonly\n{line}\n");
    Program::with(&settings, &["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"])
}

/// Has `lines` carried out at the local console.
fn console(program: &Program, lines: &str, until: &str) {
    converse(&mut program.session(), lines, until);
}

/// One message of a stream with octet counting.
fn framed(stream: &mut impl Read) -> Option<String> {
    let mut length = 0;
    loop {
        let mut byte = [0];
        stream.read_exact(&mut byte).ok()?;
        match byte[0] {
            b' ' => break,
            digit => length = 10 * length + usize::from(digit - b'0'),
        }
    }
    let mut message = vec![0; length];
    stream.read_exact(&mut message).ok()?;
    Some(String::from_utf8(message).unwrap())
}

/// Its parts, if it is a message of RFC 5424 with all that these messages have.
fn parsed(text: &str) -> Message<&str> {
    let message = parse_message(text, Variant::RFC5424);
    assert_eq!(message.protocol, Protocol::RFC5424(1), "{text}");
    assert_eq!(message.facility, Some(SyslogFacility::LOG_AUDIT), "{text}");
    assert_eq!(message.appname, Some("mobgate"), "{text}");
    assert!(message.timestamp.is_some() && message.hostname.is_some(), "{text}");
    assert!(matches!(message.procid, Some(ProcId::PID(_))), "{text}");
    message
}

/// The number of a message.
fn number(message: &Message<&str>) -> Option<u32> {
    let meta = message.structured_data.iter().find(|element| element.id == "meta")?;
    meta.params().find(|(name, _)| **name == "sequenceId").map(|(_, value)| value.parse().unwrap())
}

#[test]
fn lines_go_to_a_server_by_udp_and_are_messages_of_rfc_5424() {
    let server = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    server.set_read_timeout(Some(PATIENCE)).unwrap();
    let program = program(&format!("syslog {}", server.local_addr().unwrap()));
    let next = || {
        let mut datagram = [0; 2_048];
        let length = server.recv(&mut datagram).unwrap();
        String::from_utf8(datagram[..length].to_vec()).unwrap()
    };
    let start = next();
    let start = parsed(&start);
    assert_eq!((start.msgid, number(&start)), (Some("start"), Some(1)));
    assert!(start.msg.starts_with("system: start of "), "{}", start.msg);
    console(&program, "mdns off\nshow audit\n", "last sent");
    let change = next();
    let change = parsed(&change);
    assert_eq!(
        (change.msgid, change.msg, number(&change)),
        (Some("settings"), "local console: mdns off", Some(2))
    );
    let mut client = program.connect();
    assert_eq!(ask(&mut client, 1, &[6, 0, 0, 0, 1]), [0x86, 1]);
    let denied = next();
    let denied = parsed(&denied);
    assert_eq!((denied.msgid, number(&denied)), (Some("denied-write"), Some(3)));
    assert_eq!(denied.msg, "127.0.0.1: a write to unit 1 by function 6 is denied at port P502");
    program.signal(Signal::TERM);
    assert!(next().ends_with("system: ended by SIGTERM"), "the last words arrive");
    assert!(program.wait().success());
}

/// The texts of all messages of `stream` up to one that has `last`.
fn until(stream: &mut impl Read, last: &str) -> Vec<(Option<u32>, String)> {
    let mut all = Vec::new();
    while all.last().is_none_or(|(_, text): &(_, String)| !text.contains(last)) {
        let text = framed(stream).unwrap_or_else(|| panic!("{last} is not in {all:?}"));
        let message = parsed(&text);
        all.push((number(&message), message.msg.to_owned()));
    }
    all
}

fn accepted(listener: &TcpListener) -> BufReader<TcpStream> {
    let (stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    BufReader::new(stream)
}

#[test]
fn what_happens_while_a_tcp_server_is_away_arrives_when_it_is_back() {
    let port = free_port();
    let program = program(&format!("syslog tcp 127.0.0.1:{port}"));
    console(&program, "mdns on name a1\nshow audit\n", "last sent");
    program.logs("nobody listens there");
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
    let mut stream = accepted(&listener);
    until(&mut stream, "name a1");
    drop((stream, listener));
    // It is seen before anything is written.
    wait_for("the loss in the log", || program.log().contains("has closed the connection").then_some(()));
    console(&program, "mdns on name a2\nmdns on name a3\nshow audit\n", "last sent");
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
    let texts = until(&mut accepted(&listener), "name a3");
    assert_eq!(
        texts.iter().map(|(_, text)| text.as_str()).collect::<Vec<_>>(),
        ["local console: mdns on name a2", "local console: mdns on name a3"]
    );
}

#[test]
fn what_a_server_that_is_away_for_too_long_misses_is_counted_and_told() {
    const CHANGES: usize = 2_000;
    let port = free_port();
    let program = program(&format!("syslog tcp 127.0.0.1:{port}"));
    let lines: String = (0..CHANGES).map(|nth| format!("mdns on name x{nth}\n")).collect();
    console(&program, &(lines + "show version\n"), "mobgate 0.");
    // A flood of refusals takes no room of the changes'.
    let mut client = program.connect();
    for _ in 0..2_000 {
        assert_eq!(ask(&mut client, 1, &[6, 0, 0, 0, 1]), [0x86, 1]);
    }
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).unwrap();
    let mut stream = accepted(&listener);
    console(&program, "mdns on name last\nshow version\n", "mobgate 0.");
    let told = until(&mut stream, "name last");
    let lost =
        |text: &str| text.strip_prefix("gateway: ")?.split_once(" lines before")?.0.parse::<usize>().ok();
    let lost: usize = told.iter().filter_map(|(_, text)| lost(text)).sum();
    let refused = told.iter().filter(|(_, text)| text.contains("is denied")).count();
    let got = told.iter().filter(|(_, text)| text.contains("mdns on name x")).count();
    assert!(refused > 0 && refused < 100, "{refused} lines about 2000 refusals");
    // The line of the start is the oldest, and lost as well.
    assert_eq!(got + lost, CHANGES + 1, "{lost} lost");
    assert!(lost > 0 && told[0].1.contains("lines before this one were lost"), "{told:?}");
    let numbers: Vec<u32> = told.iter().filter_map(|(number, _)| *number).collect();
    assert!(numbers.is_sorted_by(|one, other| one < other), "in order, each once");
    console(&program, "show audit\n", &format!("{lost} lost"));
}
