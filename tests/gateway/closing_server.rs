//! Servers that close the connection behind a response: a client without pause does not notice.

use std::cell::RefCell;
use std::rc::Rc;

use mobgate_simulator::device::rtu::frame;

use crate::prelude::*;

const REQUEST_BYTES: usize = 12;

fn settings(words: &str) -> String {
    format!(
        "port plc tcp client {PLC} {words}
         port P502 tcp server 502
         route P502 * * * plc merge off"
    )
}

/// Answers `responses` requests of each connection and closes it, `pause` after the last. Gives what it has carried out.
fn serve(world: &World<'_>, rig: &Rig<'_>, responses: usize, pause: Duration) -> Rc<RefCell<Vec<[u8; 5]>>> {
    let server = rig.network.serve(address(PLC));
    rig.network.set_path(address(PLC), Path { latency: MS, ..Path::default() });
    let carried_out = Rc::<RefCell<Vec<[u8; 5]>>>::default();
    let done = carried_out.clone();
    world.spawn(async move {
        loop {
            let mut stream = server.accept().await;
            for _ in 0..responses {
                let mut request = [0; REQUEST_BYTES];
                if stream.read_exact(&mut request).await.is_err() {
                    break;
                }
                let pdu: [u8; 5] = request[7..].try_into().unwrap();
                done.borrow_mut().push(pdu);
                // A write is echoed; a read of one register gives its address.
                let response = if pdu[0] == 6 { pdu.to_vec() } else { vec![3, 2, pdu[1], pdu[2]] };
                let head = [request[0], request[1], 0, 0, 0, 1 + response.len() as u8, request[6]];
                let _ = stream.write_all(&[&head[..], &response].concat()).await;
            }
            Timer::after(pause).await;
            drop(stream);
        }
    });
    carried_out
}

/// `clients` ask 100 times each without pause; `request` gives what. How many got the response of their own, and how many 0B.
fn ask(
    world: &mut World<'_>,
    rig: &Rig<'_>,
    clients: u8,
    request: impl Fn(u8, u8) -> [u8; 5] + Copy + 'static,
) -> (usize, usize) {
    let asking: Vec<_> = (1..=clients)
        .map(|nth| {
            let mut client = rig.client(machine(nth), 502);
            world.spawn(async move {
                let (mut good, mut silent) = (0, 0);
                for turn in 0..100 {
                    let pdu = request(nth, turn);
                    let expected = if pdu[0] == 6 { pdu.to_vec() } else { vec![3, 2, pdu[1], pdu[2]] };
                    match client.request(1, &pdu).await {
                        Response::Pdu(pdu) if pdu == expected => good += 1,
                        response if response.exception() == Some(0x0b) => silent += 1,
                        other => panic!("{other:?}"),
                    }
                }
                (good, silent)
            })
        })
        .collect();
    let counts = asking.into_iter().map(|client| world.run_until(client));
    counts.fold((0, 0), |sum, count| (sum.0 + count.0, sum.1 + count.1))
}

#[test]
fn reads_are_all_answered_by_a_server_that_closes_behind_each_response() {
    for words in ["", "in-flight 4", "idle 0", "request-delay 1ms"] {
        for (responses, pause_us) in [(1, 0), (1, 300), (1, 1_000), (1, 5_000), (3, 300), (3, 2_500)] {
            for clients in [1, 8] {
                with_gateway(1, &settings(words), |world, rig| {
                    serve(world, rig, responses, Duration::from_micros(pause_us));
                    // A port that connects at once has found nobody at first.
                    world.run_for(Duration::from_secs(2));
                    let counts = ask(world, rig, clients, |nth, turn| [3, nth, turn, 0, 1]);
                    let all = 100 * usize::from(clients);
                    let case = format!("{words}, {responses} responses, {pause_us} us, {clients} clients");
                    assert_eq!(counts, (all, 0), "{case}");
                    world.run_for(Duration::from_secs(10));
                    assert_eq!(rig.frames_in_use(), 0);
                });
            }
        }
    }
}

#[test]
fn writes_are_sent_on_a_new_connection_where_the_end_of_the_old_one_has_come_and_never_twice() {
    for (pause_us, lost) in [(0, false), (1_000, true)] {
        with_gateway(1, &settings(""), |world, rig| {
            let carried_out = serve(world, rig, 1, Duration::from_micros(pause_us));
            let (good, silent) = ask(world, rig, 8, |nth, turn| [6, nth, turn, 0, 1]);
            assert_eq!(silent > 0, lost, "{silent} of {} at {pause_us} us", good + silent);
            let mut done = carried_out.borrow().clone();
            let all = done.len();
            done.sort_unstable();
            done.dedup();
            assert_eq!((all, done.len()), (good, good), "each write once");
        });
    }
}

#[test]
fn a_server_that_closes_without_a_response_is_not_asked_again_and_again() {
    with_gateway(1, &settings(""), |world, rig| {
        // The first connection has a response, all others have none.
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            for turn in 0.. {
                let mut stream = server.accept().await;
                let mut request = [0; REQUEST_BYTES];
                let _ = stream.read_exact(&mut request).await;
                if turn == 0 {
                    let _ = stream.write_all(&[request[0], request[1], 0, 0, 0, 5, 1, 3, 2, 0, 7]).await;
                    let _ = stream.read_exact(&mut request).await;
                }
            }
        });
        let mut client = rig.client(machine(1), 502);
        let mut read = || world.run_until(client.request(1, &[3, 0, 7, 0, 1]));
        assert_eq!(read(), Response::Pdu(vec![3, 2, 0, 7]));
        assert_eq!(read().exception(), Some(0x0b));
        assert_eq!(rig.network.counters().made, 2, "it was sent once more");
        assert_eq!(rig.counted("plc", Event::Retry), 1);
    });
}

#[test]
fn a_read_that_several_share_is_sent_again_for_all_of_them() {
    // The same for two, or of neighbours.
    for (policy, registers) in [("", [7, 8, 8]), ("merge adjacent", [7, 18, 19])] {
        sent_again_for_all(policy, registers);
    }
}

fn sent_again_for_all(policy: &str, registers: [u8; 3]) {
    let settings = format!(
        "port plc tcp client {PLC} rtu late-window 1ms
         port P502 tcp server 502
         route P502 * * * plc {policy}"
    );
    with_gateway(1, &settings, |world, rig| {
        // The first connection ends when it is asked a second time.
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            for responses in [1, usize::MAX] {
                let mut stream = server.accept().await;
                for _ in 0..responses {
                    let mut request = [0; 8];
                    stream.read_exact(&mut request).await.unwrap();
                    let pdu = &request[1..6];
                    let values = (0..pdu[4]).flat_map(|nth| [pdu[1], pdu[2] + nth]);
                    let response = match pdu[0] {
                        8 => pdu.to_vec(),
                        _ => [3, 2 * pdu[4]].into_iter().chain(values).collect(),
                    };
                    stream.write_all(&frame(request[0], &response)).await.unwrap();
                }
                let _ = stream.read_exact(&mut [0; 8]).await;
            }
        });
        let asking = registers.map(|register| {
            let mut client = rig.client(machine(register), 502);
            world.spawn(async move { client.request(1, &[3, 0, register, 0, 1]).await })
        });
        let responses = asking.map(|client| world.run_until(client));
        assert_eq!(responses, registers.map(|register| Response::Pdu(vec![3, 2, 0, register])));
        assert_eq!((rig.counted("plc", Event::Merged), rig.counted("plc", Event::Retry)), (1, 1));
    });
}
