//! Devices behind Modbus TCP and RTU over TCP: connections, transaction ids, faults.

use crate::prelude::*;

const WRITE: [u8; 5] = [6, 0, 1, 0, 9];

fn settings(words: &str) -> String {
    format!(
        "port plc tcp client {PLC} {words}
         port P502 tcp server 502
         route P502 * * * plc"
    )
}

/// Asks `unit` by a new connection: the response and how long it took.
fn ask(world: &mut World<'_>, rig: &Rig<'_>, unit: u8, pdu: &[u8]) -> (Answer, Duration) {
    let asked = Instant::now();
    (rig.ask(world, unit, pdu), asked.elapsed())
}

fn exception(world: &mut World<'_>, rig: &Rig<'_>, unit: u8, pdu: &[u8]) -> (Option<u8>, Duration) {
    let (answer, took) = ask(world, rig, unit, pdu);
    (answer.exception(), took)
}

#[test]
fn by_default_a_client_that_waits_for_a_second_sees_0b_and_not_its_own_time_out() {
    let silent = "port bus serial uart1 rtu client\nport P502 tcp server 502\nroute P502 5 * * bus\n";
    for (settings, at_tcp) in [(silent.to_owned(), false), (settings(""), true)] {
        with_gateway(1, &settings, |world, rig| {
            // Who is there and does not answer.
            match at_tcp {
                true => rig.attach_tcp(world, PLC, [Device::new(9)]),
                false => rig.attach(world, "uart1", [Device::new(9)]),
            }
            world.run_for(2 * SECOND);
            let (code, took) = exception(world, rig, 5, &READ);
            assert_eq!(code, Some(0x0b));
            assert!(took < 950 * MS, "{took}");
        });
    }
}

#[test]
fn a_request_reaches_a_device_behind_tcp_and_its_answer_comes_back() {
    for words in ["", "idle 0", "in-flight 16", "rtu"] {
        with_gateway(1, &settings(words), |world, rig| {
            let device = Device::new(5);
            rig.attach_at(world, PLC, words == "rtu", [device.clone()]);
            world.run_for(2 * SECOND);
            // What comes by a new connection without transaction ids is discarded for the late window.
            let took = if words == "rtu" { 801 * MS } else { MS };
            assert_eq!(ask(world, rig, 5, &READ), (value(5), took));
            assert_eq!(ask(world, rig, 5, &WRITE).0, Answer::Pdu(WRITE.to_vec()));
            assert_eq!(device.writes().len(), 1);
            assert_eq!(exception(world, rig, 5, &[3, 0xff, 0xff, 0, 1]).0, Some(2));
            assert_eq!(rig.network.counters().made, 1, "one connection for all");
            world.run_for(10 * SECOND);
            assert_eq!(rig.frames_in_use(), 0);
        });
    }
}

#[test]
fn several_requests_are_open_at_a_time_and_answered_in_any_order() {
    for (in_flight, last) in [(1, 60), (2, 30), (4, 20), (16, 20)] {
        with_gateway(1, &settings(&format!("in-flight {in_flight}")), |world, rig| {
            let device = |unit: u8, ms| Device::new(unit).with_turnaround(Duration::from_millis(ms));
            rig.attach_tcp(world, PLC, [device(1, 20), device(2, 10), device(3, 20), device(4, 10)]);
            let start = Instant::now();
            let session = asking(world, rig, 1, (1..=4).map(|unit| (unit, READ)));
            let answers: Vec<_> = (0..4).map(|_| world.run_until(session.next()).reply.unwrap()).collect();
            for answer in &answers {
                assert_eq!(answer.transaction, answer.unit.into());
                assert_eq!(answer.pdu, [3, 2, answer.unit, 7]);
            }
            assert_eq!(start.elapsed(), Duration::from_millis(last), "{in_flight} in flight");
            let first = if in_flight == 1 { 1 } else { 2 };
            assert_eq!(answers[0].unit, first, "the quick one does not wait for the slow one");
        });
    }
}

#[test]
fn an_answer_that_is_not_the_requests_own_is_dropped_and_counted() {
    for (fault, event) in [
        (Fault::WrongTransaction, Event::Stray),
        (Fault::WrongUnit, Event::WrongUnit),
        (Fault::WrongFunction, Event::Misfit),
        (Fault::WrongLength, Event::Misfit),
        (Fault::Late(SECOND, SECOND), Event::Stray),
        (Fault::Dead, Event::Timeout),
    ] {
        with_gateway(1, &settings("timeout 300ms"), |world, rig| {
            let faults = Faults::new(1).with(When::Requests(1..=1), fault);
            rig.attach_tcp(world, PLC, [Device::new(5).with_faults(faults)]);
            let took = Duration::from_millis(300);
            assert_eq!(exception(world, rig, 5, &READ), (Some(0x0b), took), "{fault:?}");
            world.run_for(2 * SECOND);
            assert_eq!(rig.counted("plc", event), 1, "{fault:?}");
            assert_eq!(ask(world, rig, 5, &READ), (value(5), MS), "{fault:?} once");
            assert_eq!(rig.network.counters().made, 1);
        });
    }
}

#[test]
fn a_late_answer_is_not_taken_for_that_of_the_same_question_asked_again() {
    with_gateway(1, &settings("timeout 300ms down-after 0"), |world, rig| {
        let late = Fault::Late(400 * MS, 400 * MS);
        let device = Device::new(5).with_faults(Faults::new(1).with(When::Requests(1..=1), late));
        rig.attach_tcp(world, PLC, [device.clone()]);
        assert_eq!(exception(world, rig, 5, &READ).0, Some(0x0b));
        // By now the first response is under way, and says 7.
        device.memory().holding[7] = 4_711;
        assert_eq!(ask(world, rig, 5, &READ).0, Answer::Pdu(vec![3, 2, 0x12, 0x67]));
    });
}

#[test]
fn a_write_in_flight_when_the_connection_breaks_is_answered_0b_and_not_repeated() {
    for fault in [Fault::Close, Fault::Reset] {
        for words in ["retries 3", "rtu retries 3"] {
            with_gateway(1, &settings(words), |world, rig| {
                let faults = Faults::new(1).with(When::Requests(2..=2), fault);
                let device = Device::new(5).with_faults(faults);
                rig.attach_at(world, PLC, words.starts_with("rtu"), [device.clone()]);
                assert_eq!(ask(world, rig, 5, &READ).0, value(5));
                assert_eq!(exception(world, rig, 5, &WRITE), (Some(0x0b), MS), "{fault:?} {words}");
                assert_eq!(ask(world, rig, 5, &WRITE).0, Answer::Pdu(WRITE.to_vec()));
                assert_eq!(device.writes().len(), 2, "each write once");
                assert_eq!(rig.network.counters().made, 2);
                assert_eq!(rig.counted("plc", Event::LineLost), 1);
            });
        }
    }
}

#[test]
fn a_read_in_flight_when_the_connection_breaks_is_sent_on_a_new_one() {
    for retries in [0, 1] {
        with_gateway(1, &settings(&format!("retries {retries}")), |world, rig| {
            let faults = Faults::new(1).with(When::Requests(2..=2), Fault::Reset);
            let device = Device::new(5).with_faults(faults);
            rig.attach_tcp(world, PLC, [device.clone()]);
            assert_eq!(ask(world, rig, 5, &READ).0, value(5));
            assert_eq!(ask(world, rig, 5, &READ).0, value(5));
            assert_eq!(device.counters().all_requests(), 3);
        });
    }
}

#[test]
fn when_nobody_listens_requests_fail_at_once_with_0a_until_somebody_does() {
    with_gateway(1, &settings(""), |world, rig| {
        for _ in 0..5 {
            assert_eq!(exception(world, rig, 5, &READ), (Some(0x0a), Duration::from_ticks(0)));
        }
        world.run_for(60 * SECOND);
        rig.attach_tcp(world, PLC, [Device::new(5)]);
        // The longest pause between two attempts, without which this would not end.
        world.run_for(10 * SECOND);
        assert_eq!(ask(world, rig, 5, &READ).0, value(5));
        assert_eq!(rig.network.counters().made, 1);
    });
}

#[test]
fn only_the_first_request_waits_for_a_machine_that_does_not_answer() {
    with_gateway(1, &settings("connect-timeout 2s"), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(5)]);
        rig.network.set_unreachable(address(PLC), true);
        assert_eq!(exception(world, rig, 5, &WRITE), (Some(0x0a), 2 * SECOND));
        for _ in 0..100 {
            world.run_for(100 * MS);
            assert_eq!(exception(world, rig, 5, &READ), (Some(0x0a), Duration::from_ticks(0)));
        }
        rig.network.set_unreachable(address(PLC), false);
        world.run_for(12 * SECOND);
        assert_eq!(ask(world, rig, 5, &READ).0, value(5));
    });
}

#[test]
fn a_server_that_accepts_and_closes_is_not_called_again_and_again() {
    with_gateway(1, &settings(""), |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            loop {
                drop(server.accept().await);
            }
        });
        for _ in 0..600 {
            let (answer, took) = exception(world, rig, 5, &READ);
            assert!(matches!(answer, Some(0x0a | 0x0b)), "{answer:?}");
            assert!(took < 10 * MS, "{took}");
            world.run_for(100 * MS);
        }
        let made = rig.network.counters().made;
        assert!(made < 20, "{made} connections for 600 requests in a minute");
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn a_server_that_never_accepts_or_never_answers_is_given_up_after_the_time_out() {
    with_gateway(1, &settings("timeout 500ms down-after 2"), |world, rig| {
        let _server = rig.network.serve(address(PLC));
        assert_eq!(exception(world, rig, 5, &READ), (Some(0x0b), 500 * MS));
        assert_eq!(exception(world, rig, 5, &READ), (Some(0x0b), 500 * MS));
        assert_eq!(exception(world, rig, 5, &READ), (Some(0x0b), Duration::from_ticks(0)), "down");
        assert_eq!(rig.counted("plc", Event::UnitDown), 1);
    });
}

#[test]
fn a_unit_that_is_down_gets_one_probe_at_a_time_and_the_others_go_on() {
    let settings = settings("timeout 300ms in-flight 16") + " merge off";
    with_gateway(1, &settings, |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(1)]);
        let mut session = Session::start(rig.network.connect(machine(2), 502).unwrap(), world);
        for _ in 0..3 {
            for _ in 0..10 {
                world.run_until(session.send(9, &READ));
            }
            world.run_for(1_400 * MS);
            assert_eq!(ask(world, rig, 1, &READ), (value(1), MS));
        }
        // Ten at first, then one probe after 1 s; the next one is due 2 s after that.
        assert_eq!(rig.counted("plc", Event::Timeout), 11);
        assert_eq!(rig.counted("plc", Event::UnitDown), 19);
    });
}

#[test]
fn an_unused_connection_is_closed_after_the_idle_time_and_opened_again_on_demand() {
    with_gateway(1, &settings("idle 5s"), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(5)]);
        world.run_for(10 * SECOND);
        assert_eq!(rig.network.counters().made, 0, "nobody has asked");
        for _ in 0..3 {
            assert_eq!(ask(world, rig, 5, &READ), (value(5), MS));
            world.run_for(4_900 * MS);
        }
        assert_eq!(rig.network.counters().made, 1);
        world.run_for(SECOND);
        assert_eq!(ask(world, rig, 5, &READ), (value(5), MS));
        assert_eq!(rig.network.counters().made, 2);
    });
}

#[test]
fn a_connection_that_the_device_closes_when_it_is_idle_is_opened_again_without_a_fault() {
    with_gateway(1, &settings("idle 0"), |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            loop {
                let stream = server.accept().await;
                Timer::after(5 * SECOND).await;
                drop(stream);
            }
        });
        world.run_for(21 * SECOND);
        assert_eq!(rig.network.counters().made, 5);
        assert_eq!(rig.counted("plc", Event::LineLost), 0);
    });
}

#[test]
fn fragile_devices_get_their_delays() {
    with_gateway(1, &settings("connect-delay 200ms request-delay 50ms in-flight 4"), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(5)]);
        assert_eq!(ask(world, rig, 5, &READ), (value(5), 201 * MS));
        assert_eq!(ask(world, rig, 5, &READ), (value(5), 51 * MS), "from the answer before");
        world.run_for(SECOND);
        assert_eq!(ask(world, rig, 5, &READ), (value(5), MS));
    });
}

#[test]
fn a_forced_unit_id_is_sent_and_the_asker_sees_its_own() {
    with_gateway(1, &settings("unit 255"), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(255)]);
        assert_eq!(ask(world, rig, 1, &READ).0, value(255));
        assert_eq!(ask(world, rig, 77, &READ).0, value(255));
        let units = rig.gateway.port_state(PortId(0)).unwrap();
        let ids: Vec<u8> = units.units(|units| units.iter().map(|unit| unit.id).collect());
        assert_eq!(ids, [255]);
    });
}

#[test]
fn unit_0_is_a_device_by_modbus_tcp_and_everybody_by_rtu_over_tcp() {
    with_gateway(1, &settings(""), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(0)]);
        assert_eq!(ask(world, rig, 0, &READ).0, value(0));
    });
    with_gateway(1, &settings("rtu late-window 1ms"), |world, rig| {
        rig.attach_rtu_over_tcp(world, PLC, [Device::new(5)]);
        let mut client = rig.client(machine(1), 502).with_patience(SECOND);
        assert_eq!(world.run_until(client.request(0, &WRITE)), Answer::Silence);
        assert_eq!(ask(world, rig, 5, &READ), (value(5), MS));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn what_cannot_be_followed_ends_the_connection_and_not_the_port() {
    with_gateway(1, &settings(""), |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            for nonsense in [&[0, 0, 0, 0, 0, 0][..], &[0xff; 300], &[0, 0, 0, 0, 1, 0, 5]] {
                let mut stream = server.accept().await;
                let _ = stream.read(&mut [0; 260]).await;
                let _ = stream.write_all(nonsense).await;
                assert_eq!(stream.read(&mut [0; 260]).await.unwrap_or(0), 0);
            }
        });
        for _ in 0..3 {
            assert_eq!(exception(world, rig, 5, &READ).0, Some(0x0b));
            world.run_for(15 * SECOND);
        }
        assert_eq!(rig.counted("plc", Event::Malformed), 3);
    });
}

#[test]
fn changed_settings_answer_what_is_open_and_what_waits() {
    with_gateway(1, &settings("timeout 10s"), |world, rig| {
        let _server = rig.network.serve(address(PLC));
        let session = asking(world, rig, 2, [(5, READ); 3]);
        world.run_for(SECOND);
        rig.console("edit port plc address 10.0.1.2:502").unwrap();
        let answers: Vec<_> = (0..3).map(|_| world.run_until(session.next()).reply.unwrap()).collect();
        let code = |id| answers.iter().find(|answer| answer.transaction == id).map(|answer| answer.pdu[1]);
        assert_eq!([code(1), code(2), code(3)], [Some(0x0b), Some(0x0a), Some(0x0a)]);
        rig.attach_tcp(world, "10.0.1.2:502", [Device::new(5)]);
        assert_eq!(ask(world, rig, 5, &READ).0, value(5));
        world.run_for(SECOND);
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn more_devices_than_sockets_take_turns_and_a_broken_one_holds_none() {
    let port = |n| format!("port D{n} tcp client 10.0.1.{n}:502 timeout 300ms\n");
    let route = |n| format!("route P502 {n} * * D{n}\n");
    let lines: String = (1..=8).map(port).chain((1..=8).map(route)).collect();
    with_gateway(1, &format!("port P502 tcp server 502\n{lines}"), |world, rig| {
        rig.network.set_sockets(2);
        rig.network.set_unreachable(address("10.0.1.8:502"), true);
        for n in 1..=7 {
            let path = Path { latency: MS, ..Path::default() };
            rig.network.set_path(address(&format!("10.0.1.{n}:502")), path);
            rig.attach_tcp(world, &format!("10.0.1.{n}:502"), [Device::new(n)]);
        }
        // One after the other: the connection that was quiet for longest goes.
        for round in 0..3 {
            for unit in 1..=7 {
                assert_eq!(ask(world, rig, unit, &READ).0, value(unit), "round {round}");
            }
        }
        // The last two are connected still.
        let made = rig.network.counters().made;
        assert_eq!((ask(world, rig, 7, &READ).0, ask(world, rig, 6, &READ).0), (value(7), value(6)));
        assert_eq!(rig.network.counters().made, made);
        // All at a time, and a dead one among them.
        let clients: Vec<_> = (1..=8)
            .map(|unit| {
                let mut client = rig.client(machine(unit), 502);
                world.spawn(async move {
                    let mut answered = 0;
                    for _ in 0..50 {
                        answered += usize::from(client.request(unit, &READ).await == value(unit));
                    }
                    answered
                })
            })
            .collect();
        let start = Instant::now();
        let answered: Vec<usize> = clients.into_iter().map(|client| world.run_until(client)).collect();
        assert_eq!(answered, [50, 50, 50, 50, 50, 50, 50, 0]);
        assert!(start.elapsed() < 20 * SECOND, "{}", start.elapsed());
        world.run_for(10 * SECOND);
        assert_eq!(rig.frames_in_use(), 0);
    });
}
