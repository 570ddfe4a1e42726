//! The ring of frames, and the file that Wireshark reads: a thousand transactions, judged by tshark.

use std::path::Path;
use std::process::Command;

use embassy_time::{Duration, Timer};
use mobgate::capture::{Capture, Captured, FRAMES_MAX, pcapng};
use mobgate::stats::Event;
use mobgate_simulator::console::typed;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, Fault, Faults, Rig, World, rig};

const SETTINGS: &str = "
port bus serial uart1 rtu client 115200 8E1 timeout 30ms down-after 0
port P502 tcp server 502
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

/// Runs mixed transactions with faults, and gives the gateway's frames.
fn transactions<'g>(world: &mut World<'g>, rig: &Rig<'g>) -> Vec<Captured> {
    let faults = Faults::new(7)
        .with(When::Chance(0.02), Fault::BadCrc)
        .with(When::Chance(0.01), Fault::CutTo(4))
        .with(When::Chance(0.01), Fault::WrongUnit)
        .with(When::Chance(0.02), Fault::Dead);
    rig.attach(world, "uart1", [Device::new(5).with_faults(faults)]);
    let capture = rig.gateway.capture().unwrap();
    let follower = world.spawn(follow(capture));
    let mut client = rig.client(machine(1), 502);
    for nth in 0..TRANSACTIONS as usize {
        world.run_until(client.request(5, REQUESTS[nth % REQUESTS.len()]));
    }
    world.run_for(Duration::from_secs(1));
    world.run_until(follower)
}

/// Everything until half a second passes without a frame.
async fn follow(capture: &Capture) -> Vec<Captured> {
    let (mut cursor, mut frames, mut quiet) = (0, Vec::new(), 0);
    while quiet < 50 {
        Timer::after_millis(10).await;
        quiet += 1;
        while let Some(frame) = capture.next(&mut cursor) {
            frames.push(frame);
            quiet = 0;
        }
    }
    frames
}

fn file(frames: &[Captured]) -> Vec<u8> {
    let mut file = pcapng::header().to_vec();
    file.extend(pcapng::interface("bus"));
    frames.iter().for_each(|frame| file.extend(pcapng::packet(frame, 0, 1_700_000_000_000_000)));
    file
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
fn tshark_decodes_a_thousand_transactions_and_counts_the_same_errors() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let frames = transactions(world, rig);
        assert!(frames.iter().all(|frame| frame.missed == 0));
        let path = std::env::temp_dir().join(format!("mobgate-capture-{}.pcapng", std::process::id()));
        std::fs::write(&path, file(&frames)).unwrap();
        let count = |filter: &str| count(&path, filter);
        assert_eq!(count("_ws.malformed"), 0);
        assert_eq!(count("frame"), frames.len() as u32);
        for event in [Event::Request, Event::Answer, Event::BadCheck, Event::Short, Event::WrongUnit] {
            let counted = rig.counted("bus", event);
            assert!(counted > 0, "{}", event.name());
            assert_eq!(count(&format!("frame.comment == \"{}\"", event.name())), counted, "{}", event.name());
        }
        assert_eq!(count("mbrtu.crc16.status == \"Bad\""), rig.counted("bus", Event::BadCheck));
        let exceptions = "frame.comment == \"answers\" && modbus.exception_code";
        assert_eq!(count(exceptions), rig.counted("bus", Event::Exception));
        assert_eq!(rig.counted("bus", Event::Request), TRANSACTIONS);
        std::fs::remove_file(&path).unwrap();
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

#[test]
fn the_console_shows_the_last_frames_with_their_verdicts() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let faults = Faults::new(1).with(When::Requests(2..=2), Fault::BadCrc);
        rig.attach(world, "uart1", [Device::new(5).with_faults(faults)]);
        let mut client = rig.client(machine(1), 502);
        world.run_until(client.request(5, &[3, 0, 7, 0, 1]));
        world.run_until(client.request(5, &[3, 0, 7, 0, 1]));
        let shown = world.run_until(typed(rig.gateway, "show frames"));
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines.len(), 4, "{shown}");
        assert!(lines[0].contains(" bus             > requests   05 03 00 07 00 01 34 4F"), "{shown}");
        assert!(lines[1].contains("< answers    05 03 02 05 07"), "{shown}");
        assert!(lines[3].contains("< bad-crc    05 03 02 05 07"), "{shown}");
    });
}
