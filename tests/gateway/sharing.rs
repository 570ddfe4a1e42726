//! Reads that share answers behind a server in the network, where several requests may be open at a time.

use mobgate_simulator::client::{Reply, frame};

use crate::prelude::*;

const WRITE: [u8; 5] = [6, 0, 7, 0, 9];
const OLD: [u8; 4] = [3, 2, 0, 1];
const NEW: [u8; 4] = [3, 2, 0, 9];
const REQUEST_BYTES: usize = 12;

fn settings(words: &str, policy: &str) -> String {
    format!(
        "port plc tcp client {PLC} {words}
         port P502 tcp server 502
         route P502 * * * plc {policy}"
    )
}

/// What a master is told that reads one register or more at each of these addresses at once, from a server that takes two requests.
fn five_reads(policy: &str, reads: [[u8; 5]; 5]) -> Vec<Reply> {
    with_gateway(1, &settings("in-flight 2", policy), |world, rig| {
        let device = Device::new(5).with_turnaround(20 * MS);
        rig.attach_tcp(world, PLC, [device.clone()]);
        // Two go out at once, the rest waits.
        let session = asking(world, rig, 1, reads.map(|read| (5, read)));
        let answers = (0..5).map(|_| world.run_until(session.next()).reply.unwrap()).collect();
        assert_eq!(device.counters().all_requests(), 3);
        assert_eq!(rig.counted("plc", Event::Merged), 2);
        answers
    })
}

#[test]
fn reads_that_wait_for_a_place_on_the_connection_are_one_request_and_are_answered_in_order() {
    let answers = five_reads("", [1, 2, 3, 3, 3].map(|quantity| [3, 0, 7, 0, quantity]));
    assert_eq!(answers.iter().map(|reply| reply.transaction).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    assert!(answers[2..].iter().all(|reply| reply.pdu == [3, 6, 5, 7, 5, 8, 5, 9]), "{answers:?}");
}

#[test]
fn reads_of_neighbours_that_wait_for_a_place_on_the_connection_are_one_request() {
    let addresses = [100, 200, 2, 0, 1];
    let answers = five_reads("merge adjacent", addresses.map(|address| [3, 0, address, 0, 1]));
    for (transaction, address) in (1..).zip(addresses) {
        let reply = answers.iter().find(|reply| reply.transaction == transaction);
        assert_eq!(reply.unwrap().pdu, [3, 2, 5, address], "{answers:?}");
    }
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
        let session = asking(world, rig, 1, [(5, READ); 3]);
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
        let mut session = asking(world, rig, 1, [(5, READ), (5, WRITE)]);
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, WRITE);
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, OLD);
        for cached in 0..3 {
            world.run_until(session.send(5, &READ));
            assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, NEW);
            assert_eq!(rig.counted("plc", Event::Cached), cached);
        }
    });
}
