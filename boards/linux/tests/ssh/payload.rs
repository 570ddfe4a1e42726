//! Random packets.

use std::io;
use std::time::{Duration, Instant};

use mobgate_simulator::random::{Random, chosen};

use super::raw::{Client, Stage, put};

/// Random packets of each stage, unless `MOBGATE_PACKETS` says how many; then they take the time that they take.
const PACKETS: u64 = 10_000;
/// Time for those of a stage. A busy machine sends fewer.
const TIME: Duration = Duration::from_secs(4);

/// Names and numbers that mean something, among others.
const NAMES: [&str; 24] = [
    "ssh-userauth",
    "ssh-connection",
    "vera",
    "nobody",
    "none",
    "password",
    "publickey",
    "keyboard-interactive",
    "hostbased",
    "ssh-ed25519",
    "let me out",
    "session",
    "direct-tcpip",
    "x11",
    "auth-agent@openssh.com",
    "pty-req",
    "shell",
    "exec",
    "subsystem",
    "window-change",
    "env",
    "tcpip-forward",
    "signal",
    "show config",
];
const KINDS: [u8; 30] = [
    1, 2, 3, 4, 5, 6, 7, 20, 21, 30, 31, 50, 51, 52, 60, 61, 80, 81, 82, 90, 91, 92, 93, 94, 95, 96, 97, 98,
    99, 100,
];

/// A packet's payload that may make sense up to some place.
fn payload(random: &mut Random, stage: Stage, channel: u32) -> Vec<u8> {
    let kind = match random.index(4) {
        0 => random.byte(),
        _ if stage == Stage::LogIn => 50,
        1 if stage == Stage::Session => 98,
        2 if stage == Stage::Session => 94,
        _ => KINDS[random.index(KINDS.len())],
    };
    let mut payload = vec![kind];
    if kind >= 91 {
        let number = if random.index(4) == 0 { random.bits() as u32 } else { channel };
        payload.extend(number.to_be_bytes());
    }
    for _ in 0..random.index(7) {
        match random.index(6) {
            0..=2 => put(&mut payload, NAMES[random.index(NAMES.len())].as_bytes()),
            3 => payload.push(random.index(2) as u8),
            4 => payload.extend((random.bits() as u32 >> random.index(32)).to_be_bytes()),
            _ => {
                let bytes: Vec<u8> = (0..random.index(300)).map(|_| random.byte()).collect();
                payload.extend(bytes);
            }
        }
    }
    payload
}

/// Sends random packets at `stage` until there were enough or the time is over; returns their number and that of connections.
pub(crate) fn send(
    random: &mut Random,
    stage: Stage,
    mut connect: impl FnMut() -> io::Result<Client>,
) -> (usize, usize) {
    let asked = chosen("MOBGATE_PACKETS");
    let (most, time) = (asked.unwrap_or(PACKETS) as usize, asked.map_or(TIME, |_| Duration::MAX));
    let (mut sent, mut connections, start) = (0, 0, Instant::now());
    while sent < most && start.elapsed() < time {
        connections += 1;
        let Ok(mut client) = connect().and_then(|client| client.reach(stage)) else { continue };
        for _ in 0..=random.index(40) {
            let done = if stage == Stage::Begin {
                let bytes: Vec<u8> = (0..random.index(300)).map(|_| random.byte()).collect();
                client.send_bytes(&bytes)
            } else {
                client.send(&payload(random, stage, client.channel))
            };
            sent += 1;
            if done.is_err() || sent >= most || start.elapsed() > time {
                break;
            }
        }
    }
    (sent, connections)
}
