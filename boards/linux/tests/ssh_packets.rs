//! The SSH server under random packets, at each stage of a connection.
//!
//! No client library sends packets that make no sense, so there is one in `raw`, with the least that it takes to reach each stage.

use std::io;
use std::time::{Duration, Instant};

use mobgate_linux::capture::epoch_us;
use mobgate_simulator::random::{Random, chosen};

use common::{Program, USER, converse, wait_for};
use raw::{Client, Stage};

mod common;
#[path = "ssh/raw.rs"]
mod raw;

/// Random packets of each stage.
const PACKETS: usize = 10_000;
/// Time for those of a stage. A busy machine sends fewer.
const TIME: Duration = Duration::from_secs(4);
/// Names and numbers that mean something, among others.
const NAMES: &str = "ssh-userauth, ssh-connection, vera, nobody, none, password, publickey, \
    keyboard-interactive, hostbased, ssh-ed25519, let me out, session, direct-tcpip, x11, \
    auth-agent@openssh.com, pty-req, shell, exec, subsystem, window-change, env, \
    tcpip-forward, signal, show config";
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
            0..=2 => {
                let names: Vec<_> = NAMES.split(", ").collect();
                raw::put(&mut payload, names[random.index(names.len())].as_bytes());
            }
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
fn send(program: &Program, random: &mut Random, stage: Stage, peer: u8) -> (usize, usize) {
    let (mut sent, mut connections, start) = (0, 0, Instant::now());
    while sent < PACKETS && start.elapsed() < TIME {
        connections += 1;
        // A pause after failures to log in is for this address alone.
        let Ok(mut client) = Client::connect(program.port, peer).and_then(|client| client.reach(stage))
        else {
            continue;
        };
        for _ in 0..=random.index(40) {
            let done: io::Result<()> = if stage == Stage::Begin {
                let bytes: Vec<u8> = (0..random.index(300)).map(|_| random.byte()).collect();
                client.send_bytes(&bytes)
            } else {
                client.send(&payload(random, stage, client.channel))
            };
            sent += 1;
            if done.is_err() || sent >= PACKETS || start.elapsed() > TIME {
                break;
            }
        }
    }
    (sent, connections)
}

#[test]
fn random_packets_at_each_stage_of_ssh_do_no_harm() {
    let seed = chosen("MOBGATE_SEED").unwrap_or_else(epoch_us);
    println!("random packets by SSH: MOBGATE_SEED={seed}");
    let mut random = Random::new(seed);
    let vera = USER.replace("anna", "vera").replace("engineer", "viewer");
    let settings = format!("port ssh ssh server 127.0.0.1:{{port}}\n{USER}{vera}");
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"];
    let program = Program::with(&settings, &options);
    let good = || {
        let mut client = Client::connect(program.port, 1).unwrap().reach(Stage::Session).unwrap();
        client.run("show version").unwrap()
    };
    assert!(good().contains("mobgate 0."));
    let descriptors = program.descriptors();
    let stages = [Stage::Begin, Stage::Exchange, Stage::Keys, Stage::Service, Stage::LogIn, Stage::Session];
    for (nth, stage) in stages.into_iter().enumerate() {
        let (sent, connections) = send(&program, &mut random, stage, 10 + nth as u8);
        println!("{stage:?}: {sent} packets by {connections} connections");
        assert!(good().contains("mobgate 0."), "MOBGATE_SEED={seed}, after {stage:?}\n{}", program.log());
        assert!(!program.log().contains("panicked"), "MOBGATE_SEED={seed}, {stage:?}\n{}", program.log());
    }
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    wait_for("the ends of all connections", || (program.descriptors() <= descriptors).then_some(()));
}
