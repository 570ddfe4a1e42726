//! Random packets at each stage of a connection.

use std::time::{Duration, Instant, SystemTime};

use mobgate_simulator::random::{Random, chosen};

use crate::payload;
use crate::raw::{Client, Stage};
use crate::server::{Server, wait_for};

/// Random packets of each stage.
const PACKETS: usize = 10_000;
/// Time for those of a stage. A busy machine sends fewer.
const TIME: Duration = Duration::from_secs(4);

/// Sends random packets at `stage` until there were enough or the time is over; returns their number and that of connections.
fn send(server: &Server, random: &mut Random, stage: Stage, peer: u8) -> (usize, usize) {
    let (mut sent, mut connections, start) = (0, 0, Instant::now());
    while sent < PACKETS && start.elapsed() < TIME {
        connections += 1;
        // A pause after failures to log in is for this address alone.
        let Ok(mut client) = Client::connect(server.port, peer).and_then(|client| client.reach(stage)) else {
            continue;
        };
        for _ in 0..=random.index(40) {
            let done = if stage == Stage::Begin {
                let bytes: Vec<u8> = (0..random.index(300)).map(|_| random.byte()).collect();
                client.send_bytes(&bytes)
            } else {
                client.send(&payload::random(random, stage, client.channel))
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
fn random_packets_at_each_stage_do_no_harm() {
    let now = || SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_micros() as u64;
    let seed = chosen("MOBGATE_SEED").unwrap_or_else(now);
    println!("random packets: MOBGATE_SEED={seed}");
    let mut random = Random::new(seed);
    let server = Server::start(true);
    let good = || {
        let mut client = Client::connect(server.port, 1).unwrap().reach(Stage::Session).unwrap();
        client.run("show version").unwrap()
    };
    let stages = [Stage::Begin, Stage::Exchange, Stage::Keys, Stage::Service, Stage::LogIn, Stage::Session];
    let mut connections = 0;
    for (nth, stage) in stages.into_iter().enumerate() {
        let (sent, of_these) = send(server, &mut random, stage, 10 + nth as u8);
        println!("{stage:?}: {sent} packets by {of_these} connections");
        // A panic would end the thread that serves all of them.
        assert!(good().contains("mobgate 0."), "MOBGATE_SEED={seed}, after {stage:?}");
        connections += of_these + 1;
    }
    // And the one that looked whether the port is open.
    wait_for("the ends of all connections", || (server.ended() > connections).then_some(()));
}
