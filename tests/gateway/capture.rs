//! The ring of frames, and the file that Wireshark reads: a thousand transactions, judged by tshark.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use mobgate::capture::FRAMES_MAX;
use mobgate_simulator::net::{ClientStream, Path as ReplyTo};

use crate::prelude::*;

const SETTINGS: &str = "
port bus serial uart1 rtu client 115200 8E1 timeout 30ms down-after 0
port P502 tcp server 502
port wire tcp server 5029 capture
route P502 * * * bus
";
const TRANSACTIONS: u32 = 1_000;
const REQUESTS: [&[u8]; 8] = [
    &[1, 0, 0, 0, 20],
    &[2, 0, 3, 0, 9],
    &[3, 0, 100, 0, 30],
    &[4, 0, 7, 0, 1],
    &[5, 0, 4, 0xff, 0],
    &[6, 0, 9, 0x12, 0x34],
    &[16, 0, 20, 0, 2, 4, 1, 2, 3, 4],
    // An address that is not there.
    &[3, 0xff, 0xf0, 0, 1],
];

/// Runs mixed transactions with faults.
fn transactions<'g>(world: &mut World<'g>, rig: &Rig<'g>) {
    let faults = Faults::new(7)
        .with(When::Chance(0.02), Fault::BadCrc)
        .with(When::Chance(0.01), Fault::CutTo(4))
        .with(When::Chance(0.01), Fault::WrongUnit)
        .with(When::Chance(0.02), Fault::Dead);
    rig.attach(world, "uart1", [Device::new(5).with_faults(faults)]);
    let mut client = rig.client(machine(1), 502);
    for nth in 0..TRANSACTIONS as usize {
        world.run_until(client.request(5, REQUESTS[nth % REQUESTS.len()]));
    }
    world.run_for(Duration::from_millis(100));
}

/// Takes all that comes until the connection ends.
async fn collect(mut stream: ClientStream) -> Vec<u8> {
    let (mut file, mut part) = (Vec::new(), [0; 512]);
    while let Ok(count @ 1..) = stream.read(&mut part).await {
        file.extend_from_slice(&part[..count]);
    }
    file
}

/// A file that tshark can read, gone with the value.
struct PcapFile(PathBuf);

impl PcapFile {
    fn new(content: &[u8]) -> Self {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("mobgate-capture-{}-{number}.pcapng", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, content).unwrap();
        Self(path)
    }
}

impl Drop for PcapFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// How many packets of `file` tshark finds by `filter`.
fn count(file: &Path, filter: &str) -> u32 {
    let tshark = Command::new("tshark")
        .args(["-o", "mbrtu.crc_verification:TRUE", "-Y", filter, "-T", "fields", "-e", "frame.number", "-r"])
        .arg(file)
        .output()
        .expect("tshark is installed");
    assert!(tshark.status.success(), "{}", String::from_utf8_lossy(&tshark.stderr));
    tshark.stdout.iter().filter(|byte| **byte == b'\n').count() as u32
}

#[test]
fn tshark_decodes_a_thousand_transactions_by_tcp_and_on_the_line_and_counts_the_same_errors() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let wireshark = rig.network.connect(machine(9), 5029).unwrap();
        let streamed = world.spawn(collect(wireshark));
        world.run_for(Duration::from_millis(1));
        transactions(world, rig);
        rig.console("delete port wire").unwrap();
        let file = PcapFile::new(&world.run_until(streamed));
        let count = |filter: &str| count(&file.0, filter);
        assert_eq!(count("_ws.malformed"), 0);
        let tcp = "frame.interface_name == \"P502\"";
        for (event, of) in [
            (Event::Request, "requests"),
            (Event::Response, "responses"),
            (Event::BadCheck, "bad-crc"),
            (Event::Short, "short"),
            (Event::WrongUnit, "wrong-unit"),
        ] {
            let counted = rig.counted("bus", event);
            assert!(counted > 0, "{of}");
            assert_eq!(count(&format!("!({tcp}) && frame.comment == \"{of}\"")), counted, "{of}");
        }
        assert_eq!(count("mbrtu.crc16.status == \"Bad\""), rig.counted("bus", Event::BadCheck));
        let exceptions = "frame.comment == \"responses\" && modbus.exception_code";
        assert_eq!(count(&format!("!({tcp}) && {exceptions}")), rig.counted("bus", Event::Exception));
        assert_eq!(rig.counted("bus", Event::Request), TRANSACTIONS);
        // As many by TCP, where a response that did not come is an exception of the gateway.
        assert_eq!(count(&format!("{tcp} && mbtcp && frame.comment == \"requests\"")), TRANSACTIONS);
        assert_eq!(count(&format!("{tcp} && mbtcp && frame.comment == \"responses\"")), TRANSACTIONS);
        let refused = rig.counted("P502", Event::Exception);
        assert_eq!(count(&format!("{tcp} && {exceptions}")), refused);
        // Wireshark looks for the requests of responses that are no exceptions.
        assert_eq!(count(&format!("{tcp} && modbus.request_frame")), TRANSACTIONS - refused);
    });
}

#[test]
fn frames_by_udp_and_to_servers_are_decoded_too_and_only_while_somebody_follows() {
    const NETWORK: &str = "
        port U tcp client 10.0.1.1:502
        port R tcp client 10.0.1.2:502 rtu late-window 1ms
        port P502 udp server 502
        port wire tcp server 5029 capture
        route P502 5 * * U
        route P502 6 * * R
    ";
    rig::with_gateway(1, NETWORK, |world, rig| {
        rig.attach_tcp(world, "10.0.1.1:502", [Device::new(5)]);
        rig.attach_rtu_over_tcp(world, "10.0.1.2:502", [Device::new(6)]);
        let client = rig.network.udp_client(machine(1), 502);
        let ask = |world: &mut World<'_>, unit| {
            client.send(&[0, 1, 0, 0, 0, 6, unit, 3, 0, 7, 0, 1]);
            let response = world.run_until(client.receive(Duration::from_secs(1)));
            assert_eq!(response.unwrap()[6..], [unit, 3, 2, unit, 7]);
        };
        ask(world, 5);
        assert_eq!(rig.gateway.capture().unwrap().end(), 0, "nobody follows");
        let streamed = world.spawn(collect(rig.network.connect(machine(9), 5029).unwrap()));
        world.run_for(Duration::from_millis(1));
        ask(world, 5);
        ask(world, 6);
        world.run_for(Duration::from_millis(10));
        rig.console("delete port wire").unwrap();
        let file = PcapFile::new(&world.run_until(streamed));
        let count = |filter: &str| count(&file.0, filter);
        assert_eq!(count("frame"), 8);
        assert_eq!(count("_ws.malformed"), 0);
        assert_eq!(count("frame.interface_name == \"P502\" && mbudp && modbus.func_code == 3"), 4);
        assert_eq!(count("frame.interface_name == \"U\" && mbtcp && modbus.func_code == 3"), 2);
        assert_eq!(count("frame.interface_name == \"R\" && mbrtu && modbus.func_code == 3"), 2);
        let shown = world.run_until(typed(rig.gateway, "show frames"));
        assert!(shown.contains(" U               > requests   "), "{shown}");
        ask(world, 5);
        assert_eq!(rig.gateway.capture().unwrap().end(), 8, "nobody follows any more");
    });
}

/// The kinds of a file's blocks, and what each contains.
fn blocks(mut file: &[u8]) -> Vec<(u32, &[u8])> {
    let mut blocks = Vec::new();
    while let [a, b, c, d, e, f, g, h, ..] = *file {
        let length = u32::from_le_bytes([e, f, g, h]) as usize;
        blocks.push((u32::from_le_bytes([a, b, c, d]), &file[8..length - 4]));
        file = &file[length..];
    }
    blocks
}

#[test]
fn a_client_that_does_not_read_misses_frames_and_is_told_how_many_and_nobody_waits_for_it() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let path = ReplyTo { window_bytes: 1_000, ..ReplyTo::default() };
        let deaf = rig.network.connect_over(path, machine(9), 5029).unwrap();
        world.run_for(Duration::from_millis(1));
        let mut client = rig.client(machine(1), 502);
        let begun = Instant::now();
        for _ in 0..100 {
            assert!(matches!(world.run_until(client.request(5, REQUESTS[3])), Response::Pdu(_)));
        }
        assert!(begun.elapsed() < Duration::from_secs(1), "as fast as ever");
        let streamed = world.spawn(collect(deaf));
        world.run_for(Duration::from_millis(100));
        rig.console("delete port wire").unwrap();
        let file = world.run_until(streamed);
        let blocks = blocks(&file);
        let packets = blocks.iter().filter(|(kind, _)| *kind == 6).count();
        // Behind an interface and a time: the number of what was dropped, as option 5.
        let mut told = blocks.iter().filter(|(kind, _)| *kind == 5).map(|(_, block)| {
            assert_eq!(block[12..16], [5, 0, 8, 0]);
            u64::from_le_bytes(block[16..24].try_into().unwrap())
        });
        let dropped = told.next_back().unwrap() as usize;
        assert!(dropped > 100, "{dropped}");
        assert_eq!(packets + dropped, 400, "frames of the line and by TCP");
        let file = PcapFile::new(&file);
        assert_eq!(count(&file.0, "frame"), packets as u32);
        assert_eq!(count(&file.0, "_ws.malformed"), 0);
    });
}

#[test]
fn a_newcomer_takes_the_place_of_who_captures_and_whoever_leaves_is_noticed() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let connect = |host| rig.network.connect(machine(host), 5029).unwrap();
        let first = world.spawn(collect(connect(8)));
        world.run_for(Duration::from_millis(1));
        let second = connect(9);
        world.run_for(Duration::from_millis(1));
        assert!(blocks(&world.run_until(first)).iter().all(|(kind, _)| *kind != 6));
        drop(second);
        world.run_for(Duration::from_secs(1));
        assert!(!world.run_until(typed(rig.gateway, "show clients")).contains("wire"));
    });
}

#[test]
fn who_follows_too_slowly_is_told_what_is_missing() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let mut client = rig.client(machine(1), 502);
        for _ in 0..50 {
            world.run_until(client.request(5, REQUESTS[3]));
        }
        let (capture, mut cursor) = (rig.gateway.capture().unwrap(), 0);
        let oldest = capture.next(&mut cursor).unwrap();
        assert_eq!(oldest.missed as usize, 100 - FRAMES_MAX);
        assert_eq!(std::iter::from_fn(|| capture.next(&mut cursor)).count(), FRAMES_MAX - 1);
        assert_eq!(cursor, capture.end());
    });
}
