//! Reads that share answers behind a server in the network, where several requests may be open at a time.

use std::net::SocketAddr;

use embassy_time::Duration;
use embedded_io_async::{Read, Write};
use mobgate::stats::Event;
use mobgate_simulator::Device;
use mobgate_simulator::client::frame;
use mobgate_simulator::client::session::Session;
use mobgate_simulator::rig::{machine, with_gateway};

const PLC: &str = "10.0.1.1:502";
const READ: [u8; 5] = [3, 0, 7, 0, 1];
const WRITE: [u8; 5] = [6, 0, 7, 0, 9];
const OLD: [u8; 4] = [3, 2, 0, 1];
const NEW: [u8; 4] = [3, 2, 0, 9];
const REQUEST_BYTES: usize = 12;
const MS: Duration = Duration::from_millis(1);

fn address(text: &str) -> SocketAddr {
    text.parse().unwrap()
}

fn settings(words: &str, policy: &str) -> String {
    format!(
        "port plc tcp client {PLC} {words}
         port P502 tcp server 502
         route P502 * * * plc {policy}"
    )
}

#[test]
fn reads_that_wait_for_a_place_on_the_connection_are_one_request_and_are_answered_in_order() {
    with_gateway(1, &settings("in-flight 2", ""), |world, rig| {
        let device = Device::new(5).with_turnaround(20 * MS);
        rig.attach_tcp(world, PLC, [device.clone()]);
        let mut session = Session::start(rig.network.connect(machine(1), 502).unwrap(), world);
        // Two go out at once, the rest waits.
        for quantity in [1, 2, 3, 3, 3] {
            world.run_until(session.send(5, &[3, 0, 7, 0, quantity]));
        }
        let answers: Vec<_> = (0..5).map(|_| world.run_until(session.next()).reply.unwrap()).collect();
        assert_eq!(answers.iter().map(|reply| reply.transaction).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
        assert!(answers[2..].iter().all(|reply| reply.pdu == [3, 6, 5, 7, 5, 8, 5, 9]), "{answers:?}");
        assert_eq!(device.counters().all_requests(), 3);
        assert_eq!(rig.counted("plc", Event::Merged), 2);
    });
}

#[test]
fn reads_of_neighbours_that_wait_for_a_place_on_the_connection_are_one_request() {
    with_gateway(1, &settings("in-flight 2", "merge adjacent"), |world, rig| {
        let device = Device::new(5).with_turnaround(20 * MS);
        rig.attach_tcp(world, PLC, [device.clone()]);
        let mut session = Session::start(rig.network.connect(machine(1), 502).unwrap(), world);
        // Two go out at once, the rest waits.
        for address in [100, 200, 2, 0, 1] {
            world.run_until(session.send(5, &[3, 0, address, 0, 1]));
        }
        let answers: Vec<_> = (0..5).map(|_| world.run_until(session.next()).reply.unwrap()).collect();
        for (transaction, address) in (1..).zip([100, 200, 2, 0, 1]) {
            let reply = answers.iter().find(|reply| reply.transaction == transaction);
            assert_eq!(reply.unwrap().pdu, [3, 2, 5, address], "{answers:?}");
        }
        assert_eq!(device.counters().all_requests(), 3);
        assert_eq!(rig.counted("plc", Event::Merged), 2);
    });
}

#[test]
fn when_the_connection_breaks_all_who_shared_a_request_are_told() {
    with_gateway(1, &settings("", ""), |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            let mut stream = server.accept().await;
            let mut request = [0; REQUEST_BYTES];
            let _ = stream.read_exact(&mut request).await;
        });
        let mut session = Session::start(rig.network.connect(machine(1), 502).unwrap(), world);
        for _ in 0..3 {
            world.run_until(session.send(5, &READ));
        }
        for _ in 0..3 {
            assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, [0x83, 0x0b]);
        }
        world.run_for(10 * MS);
        assert_eq!(rig.frames_in_use(), 0);
    });
}

/// The server carries the write out before it answers the read that it took in before.
#[test]
fn an_answer_from_before_a_write_that_was_on_its_way_meanwhile_is_not_kept() {
    with_gateway(1, &settings("in-flight 2", "cache 10s"), |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            let mut stream = server.accept().await;
            let (mut read, mut write) = ([0; REQUEST_BYTES], [0; REQUEST_BYTES]);
            stream.read_exact(&mut read).await.unwrap();
            stream.read_exact(&mut write).await.unwrap();
            let answer = |request: &[u8], pdu: &[u8]| {
                frame(u16::from_be_bytes([request[0], request[1]]), request[6], pdu)
            };
            stream.write_all(&answer(&write, &WRITE)).await.unwrap();
            stream.write_all(&answer(&read, &OLD)).await.unwrap();
            while stream.read_exact(&mut read).await.is_ok() {
                stream.write_all(&answer(&read, &NEW)).await.unwrap();
            }
        });
        let mut session = Session::start(rig.network.connect(machine(1), 502).unwrap(), world);
        world.run_until(session.send(5, &READ));
        world.run_until(session.send(5, &WRITE));
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, WRITE);
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, OLD);
        for cached in 0..3 {
            world.run_until(session.send(5, &READ));
            assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, NEW);
            assert_eq!(rig.counted("plc", Event::Cached), cached);
        }
    });
}
