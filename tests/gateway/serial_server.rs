//! A master on a serial line asks the gateway, in virtual time.

use embassy_time::Duration;
use mobgate::stats::Event;
use mobgate_simulator::client::Answer;
use mobgate_simulator::{Device, Rig, World, rig};

const READ: [u8; 5] = [3, 0, 7, 0, 1];

/// A server line of `server` in front of a client line of `client` with devices 5 and 6.
fn settings(server: &str, client: &str) -> String {
    format!("port S serial up {server}\nport C serial down {client}\nroute S 1-9 * * C\n")
}

fn played(server: &str, client: &str, play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>)) {
    rig::with_gateway(1, &settings(server, client), |world, rig| {
        rig.attach(world, "down", [Device::new(5), Device::new(6)]);
        world.run_for(Duration::from_secs(1));
        play(world, rig);
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.frames_in_use(), 0);
        assert_eq!(rig.wire("up").collisions() + rig.wire("down").collisions(), 0);
    });
}

#[test]
fn a_master_reaches_a_device_in_all_pairs_of_framings() {
    for server in ["rtu server 19200 8E1", "ascii server 9600 7E1"] {
        for client in ["rtu client 115200 8N1", "ascii client 38400 7E1"] {
            played(server, client, |world, rig| {
                let mut master = rig.master("up");
                let answer = world.run_until(master.request(5, &READ));
                assert_eq!(answer, Answer::Pdu(vec![3, 2, 5, 7]), "{server} {client}");
                let answer = world.run_until(master.request(6, &[6, 0, 1, 0xab, 0xcd]));
                assert_eq!(answer, Answer::Pdu(vec![6, 0, 1, 0xab, 0xcd]));
                let answer = world.run_until(master.request(6, &[65, 1, 2]));
                assert_eq!(answer, Answer::Pdu(vec![65, 1, 2, !65]));
                let answer = world.run_until(master.request(6, &[3, 0xff, 0, 0, 1]));
                assert_eq!(answer, Answer::Pdu(vec![0x83, 2]));
                let answer = world.run_until(master.request(10, &READ));
                assert_eq!(answer, Answer::Silence, "not ours");
                assert_eq!(rig.counted("S", Event::Answer), 4);
            });
        }
    }
}
