//! The audit trail: over restarts, at a syslog server, and with the time of an NTP server.

use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::thread;

use mobgate_qemu::{Console, PATIENCE, wait_for};

use crate::{Bench, registers};

/// The rows of `show audit`, without their times.
fn trail(console: &mut Console) -> Vec<String> {
    let shown = console.run("show audit");
    let row =
        |line: &str| line.split_whitespace().skip_while(|word| !is_who(word)).collect::<Vec<_>>().join(" ");
    shown.lines().skip(1).map(row).collect()
}

fn is_who(word: &str) -> bool {
    ["local", "system", "gateway", "syslog"].contains(&word)
}

/// A server of datagrams on the host, which the board sees at 10.0.2.2.
fn datagrams() -> (UdpSocket, u16) {
    let server = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    server.set_read_timeout(Some(PATIENCE)).unwrap();
    let port = server.local_addr().unwrap().port();
    (server, port)
}

#[test]
fn the_trail_outlives_a_restart_and_a_fault_but_not_the_power() {
    let mut bench = Bench::told(tempfile::tempdir().unwrap(), "restart");
    let mut console = bench.machine.console();
    let started = "system start of mobgate 0.1.0, started by power or a reset";
    assert_eq!(trail(&mut console), [started]);
    assert_eq!(console.run("mdns off"), "");
    assert_eq!(console.run("save").trim_end(), "saved");
    console.type_keys("reboot\r");
    bench.machine.logs_times("network up", 2);
    let before = [started, "local console mdns off", "local console save", "local console reboot"];
    let expected = [&before[..], &["gateway above: before the last start", started]].concat();
    assert_eq!(trail(&mut console), expected);
    assert_eq!(console.run("mdns on"), "");
    assert_eq!(trail(&mut console).last().map(String::as_str), Some("local console mdns on"));
    drop(console);
    bench.restart();
    assert_eq!(trail(&mut bench.machine.console()), [started], "the power was off");
}

#[test]
fn the_trail_says_that_a_fault_has_ended_the_last_run() {
    let bench = Bench::told(tempfile::tempdir().unwrap(), "restart fault");
    let shown = bench.machine.console().run("show audit");
    assert!(shown.contains("the last run ended: fault 0x00008200 at 0x"), "{shown}");
}

#[test]
fn a_syslog_server_gets_the_lines_by_udp_and_those_of_before_a_restart_that_it_has_missed() {
    let (server, port) = datagrams();
    let next = || {
        let mut datagram = [0; 2_048];
        let length = server.recv(&mut datagram).unwrap();
        String::from_utf8(datagram[..length].to_vec()).unwrap()
    };
    let bench = Bench::told(tempfile::tempdir().unwrap(), "restart");
    let mut console = bench.machine.console();
    assert_eq!(console.run("mdns on name cabinet-7"), "");
    assert_eq!(console.run(&format!("syslog 10.0.2.2:{port}")), "");
    let start = next();
    // RFC 5424: priority 8 * 13 + 5, no date, no process.
    let head = "<109>1 - cabinet-7 mobgate - start [meta sequenceId=\"1\"] system: start of mobgate ";
    assert!(start.starts_with(head), "{start}");
    assert!(next().ends_with("settings [meta sequenceId=\"2\"] local console: mdns on name cabinet-7"));
    assert!(next().contains("sequenceId=\"3\""));
    wait_for("the last line", || {
        console.run("show audit").contains("open; last sent 3, 0 lost").then_some(())
    });

    // Without a link nothing is sent, and the lines wait: also over a restart.
    assert_eq!(console.run("save").trim_end(), "saved");
    assert!(next().contains("sequenceId=\"4\""));
    bench.machine.monitor("set_link net off");
    wait_for("the link to go", || console.run("show network").contains("down").then_some(()));
    assert_eq!(console.run("clear log"), "");
    console.type_keys("reboot\r");
    console.read_until("reboot\r\n");
    console.read_until("> ");
    bench.machine.monitor("set_link net on");
    assert!(next().ends_with("command [meta sequenceId=\"5\"] local console: clear log"));
    assert!(next().ends_with("command [meta sequenceId=\"6\"] local console: reboot"));
    assert!(next().contains("sequenceId=\"7\"] system: start of mobgate "));
}

#[test]
fn a_syslog_server_by_tcp_gets_each_line_with_its_length() {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let accepted = thread::spawn(move || listener.accept().unwrap().0);
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run(&format!("syslog tcp 10.0.2.2:{port}")), "");
    let mut stream = BufReader::new(accepted.join().unwrap());
    stream.get_ref().set_read_timeout(Some(PATIENCE)).unwrap();
    for number in 1..=2 {
        let mut length = Vec::new();
        stream.read_until(b' ', &mut length).unwrap();
        let length: usize = std::str::from_utf8(&length).unwrap().trim_end().parse().unwrap();
        let mut message = vec![0; length];
        stream.read_exact(&mut message).unwrap();
        let message = String::from_utf8(message).unwrap();
        assert!(message.contains(&format!("[meta sequenceId=\"{number}\"] ")), "{message}");
    }
    // Nobody listens there any more: lines wait, and requests do not.
    drop(stream);
    wait_for("the loss", || console.run("show audit").contains("nobody listens there").then_some(()));
    assert_eq!(bench.machine.client().read(1, 0, 1), registers(1, 0, 1));
}

#[test]
fn users_have_passwords_that_fit_the_board_and_no_line_tells_them() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run("user anna role operator"), "");
    console.type_keys("password anna\rlet me in\rlet me in\r");
    console.read_until("*> ");
    assert!(console.run("show users").contains("anna"));
    let secrets = console.run("show config secrets");
    assert!(
        secrets.contains("user anna role operator password \"$argon2id$v=19$m=32,t=16,p=1$"),
        "{secrets}"
    );
    let shown = console.run("show config") + &console.run("show audit");
    assert!(
        shown.contains("password anna") && !shown.contains("argon2") && !shown.contains("let me"),
        "{shown}"
    );
    // One that Linux has made.
    let hash =
        "$argon2id$v=19$m=19456,t=2,p=1$gZiV/M1gPc22ElAH/Jh1Hw$CWOrkoo7oJBQ/iyh7uJ0LO2aLEfrHwTWllSAxT0zRno";
    let refused = console.run(&format!("user bert role viewer password \"{hash}\""));
    assert!(refused.contains("expected a hash"), "{refused}");
}

/// Seconds from 1900 to 1970 (RFC 4330, 3).
const NTP_EPOCH: u64 = 2_208_988_800;
/// 2027-03-04T05:06:07Z, as `date -u -d @1804136767` says.
const NOW: u64 = 1_804_136_767;

/// Answers `count` questions with [`NOW`], as RFC 4330 has it (5).
fn tell_time(server: &UdpSocket, count: usize) {
    for _ in 0..count {
        let mut question = [0; 48];
        let (length, peer) = server.recv_from(&mut question).unwrap();
        assert_eq!((length, question[0] & 7), (48, 3), "a client's question");
        let now = ((NOW + NTP_EPOCH) << 32).to_be_bytes();
        let mut response = [0; 48];
        // Version 4, server, stratum 2.
        response[..4].copy_from_slice(&[4 << 3 | 4, 2, 6, 0xec]);
        response[24..32].copy_from_slice(&question[40..48]);
        response[32..40].copy_from_slice(&now);
        response[40..48].copy_from_slice(&now);
        server.send_to(&response, peer).unwrap();
    }
}

#[test]
fn an_ntp_server_tells_the_time_and_lines_of_the_trail_have_dates() {
    let (server, port) = datagrams();
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert!(console.run("show audit").lines().nth(1).is_some_and(|line| line.starts_with("up ")));
    assert_eq!(console.run(&format!("ntp 10.0.2.2:{port}")), "");
    tell_time(&server, 1);
    wait_for("the time", || {
        let version = console.run("show version");
        version.contains(", 2027-03-04T05:0").then_some(())
    });
    assert!(console.run("show version").contains(&format!("Z by 10.0.2.2:{port}")));
    assert_eq!(console.run("mdns off"), "");
    let shown = console.run("show audit");
    let dates: Vec<&str> =
        shown.lines().skip(1).map(|line| line.split_whitespace().next().unwrap()).collect();
    assert!(dates.iter().all(|date| date.starts_with("2027-03-04T05:0") && date.ends_with('Z')), "{shown}");
    assert!(dates.is_sorted(), "{shown}");
    // Lines from before it was known have theirs by the clock of the run.
    assert!(dates.len() == 3, "{shown}");

    assert!(console.run("show config").contains(&format!("ntp 10.0.2.2:{port}")));
    assert_eq!(console.run("ntp off"), "");
    assert!(console.run("show version").contains("2027-03-04T05:0"), "it goes on by itself");
}

#[test]
fn a_server_that_does_not_know_the_time_is_not_believed() {
    let (server, port) = datagrams();
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run(&format!("ntp 10.0.2.2:{port}")), "");
    let mut question = [0; 48];
    let (_, peer) = server.recv_from(&mut question).unwrap();
    let mut response = [0; 48];
    // The clock is not synchronized (RFC 4330, 4).
    response[..2].copy_from_slice(&[3 << 6 | 4 << 3 | 4, 2]);
    response[24..32].copy_from_slice(&question[40..48]);
    response[40..48].copy_from_slice(&((NOW + NTP_EPOCH) << 32).to_be_bytes());
    server.send_to(&response, peer).unwrap();
    let expected = format!(", no time from 10.0.2.2:{port}: failed (the server does not know the time)");
    wait_for("the fault", || console.run("show version").contains(&expected).then_some(()));
}
