//! Random packets at each stage of a connection.

use mobgate_linux::capture::epoch_us;
use mobgate_simulator::random::{Random, chosen};
use mobgate_simulator::waiting::wait_for;

use crate::payload;
use crate::raw::{Client, Stage};
use crate::server::Server;

#[test]
fn random_packets_at_each_stage_do_no_harm() {
    let seed = chosen("MOBGATE_SEED").unwrap_or_else(epoch_us);
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
        // A pause after failures to log in is for this address alone.
        let (sent, of_these) =
            payload::send(&mut random, stage, || Client::connect(server.port, 10 + nth as u8));
        println!("{stage:?}: {sent} packets by {of_these} connections");
        // A panic would end the thread that serves all of them.
        assert!(good().contains("mobgate 0."), "MOBGATE_SEED={seed}, after {stage:?}");
        connections += of_these + 1;
    }
    // And the one that looked whether the port is open.
    wait_for("the ends of all connections", || (server.ended() > connections).then_some(()));
}
