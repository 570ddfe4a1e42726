//! The SSH server under random packets, at each stage of a connection.
//!
//! No client library sends packets that make no sense, so there is one in `raw`, with the least that it takes to reach each stage.

use mobgate_linux::capture::epoch_us;
use mobgate_simulator::random::{Random, chosen};

use common::{Program, USER, converse, wait_for};
use raw::{Client, Stage};

mod common;
#[path = "ssh/payload.rs"]
mod payload;
#[path = "ssh/raw.rs"]
mod raw;

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
        // A pause after failures to log in is for this address alone.
        let (sent, connections) =
            payload::send(&mut random, stage, || Client::connect(program.port, 10 + nth as u8));
        println!("{stage:?}: {sent} packets by {connections} connections");
        assert!(good().contains("mobgate 0."), "MOBGATE_SEED={seed}, after {stage:?}\n{}", program.log());
        assert!(!program.log().contains("panicked"), "MOBGATE_SEED={seed}, {stage:?}\n{}", program.log());
    }
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    wait_for("the ends of all connections", || (program.descriptors() <= descriptors).then_some(()));
}
