//! A TCP client with several servers: who is connected, who has to go, and that nobody waits for another's server.

use mobgate::port::client::servers::{Choice, RETRY_FIRST, Servers};
use mobgate::settings::{Tag, UnitRange};

use crate::prelude::*;

const AT_ONCE: Duration = Duration::from_ticks(0);

fn address(host: u8) -> SocketAddr {
    SocketAddr::from(([10, 0, 1, host], 502))
}

/// A server for each of the units 1 to `count`.
fn settings(count: u8, words: &str) -> String {
    let servers: String = (1..=count).map(|n| format!("server plant unit {n} at {}\n", address(n))).collect();
    format!(
        "port plant tcp client {words}\nport P502 tcp server 502\n{servers}route P502 * * * plant merge off\n"
    )
}

fn attach<'w>(world: &World<'w>, rig: &Rig<'w>, hosts: impl IntoIterator<Item = u8>) -> Vec<Device> {
    let one = |host: u8| {
        let device = Device::new(host);
        let path = Path { latency: MS, ..Path::default() };
        rig.network.set_path(address(host), path);
        rig.attach_tcp(world, &address(host).to_string(), [device.clone()]);
        device
    };
    hosts.into_iter().map(one).collect()
}

fn ask(world: &mut World<'_>, rig: &Rig<'_>, unit: u8) -> (Answer, Duration) {
    let asked = Instant::now();
    (rig.ask(world, unit, &READ), asked.elapsed())
}

fn no_path() -> Answer {
    Answer::Pdu(vec![0x83, 0x0a])
}

#[test]
fn a_unit_is_asked_at_its_own_server_by_the_number_that_it_has_there() {
    let settings = "port plant tcp client
        port P502 tcp server 502
        server plant unit 1-5 at 10.0.1.1
        server plant unit 7 at 10.0.1.2:1502 tag =255
        server plant unit 11-12 at 10.0.1.3 tag -10
        route P502 * * * plant";
    with_gateway(1, settings, |world, rig| {
        rig.attach_tcp(world, "10.0.1.1:502", [Device::new(1), Device::new(5)]);
        rig.attach_tcp(world, "10.0.1.2:1502", [Device::new(255)]);
        rig.attach_tcp(world, "10.0.1.3:502", [Device::new(1), Device::new(2)]);
        for (unit, there) in [(1, 1), (5, 5), (7, 255), (11, 1), (12, 2)] {
            assert_eq!(ask(world, rig, unit).0, value(there), "unit {unit}");
        }
        assert_eq!(ask(world, rig, 6), (no_path(), AT_ONCE), "no server has it");
        assert_eq!(rig.network.counters().made, 3);
        assert_eq!(rig.counted("plant", Event::NoPath), 1);
        // A line more is another set of servers: the port begins anew.
        rig.console("server plant unit 6 at 10.0.1.1").unwrap();
        rig.console("delete server plant unit 7").unwrap();
        assert_eq!(ask(world, rig, 5).0, value(5));
        assert_eq!(ask(world, rig, 7), (no_path(), AT_ONCE));
    });
}

#[test]
fn by_rtu_over_tcp_units_have_other_numbers_there_too() {
    let settings = "port plant tcp client rtu late-window 1ms
        port P502 tcp server 502
        server plant unit 7 at 10.0.1.1 tag =1
        server plant unit 11-12 at 10.0.1.2 tag -10
        route P502 * * * plant";
    with_gateway(1, settings, |world, rig| {
        rig.attach_rtu_over_tcp(world, "10.0.1.1:502", [Device::new(1)]);
        rig.attach_rtu_over_tcp(world, "10.0.1.2:502", [Device::new(1), Device::new(2)]);
        for (unit, there) in [(7, 1), (11, 1), (12, 2), (7, 1)] {
            assert_eq!(ask(world, rig, unit).0, value(there), "unit {unit}");
        }
    });
}

#[test]
fn the_connection_that_was_quiet_for_longest_makes_room_and_no_busy_one() {
    with_gateway(1, &settings(6, "sockets 2"), |world, rig| {
        attach(world, rig, 1..=6);
        for unit in 1..=6 {
            assert_eq!(ask(world, rig, unit).0, value(unit));
        }
        // The last two are connected still, and 5 was quiet for longer than 6 is.
        assert_eq!((ask(world, rig, 6).0, rig.network.counters().made), (value(6), 6));
        assert_eq!((ask(world, rig, 1).0, rig.network.counters().made), (value(1), 7));
        assert_eq!((ask(world, rig, 6).0, rig.network.counters().made), (value(6), 7));
        assert_eq!((ask(world, rig, 5).0, rig.network.counters().made), (value(5), 8));
        // All at once: each is answered once.
        let session = asking(world, rig, 2, (1..=6).map(|unit| (unit, READ)));
        let mut unit = || world.run_until(session.next()).reply.unwrap().pdu[2];
        let mut units = [(); 6].map(|()| unit());
        units.sort_unstable();
        assert_eq!(units, [1, 2, 3, 4, 5, 6]);
        assert_eq!(rig.network.counters().sockets_most, 2);
        let lost = rig.counted("plant", Event::LineLost);
        assert_eq!(lost, 0, "no request was on a connection that was closed");
    });
}

#[test]
fn a_dead_and_a_slow_server_delay_nobody_else() {
    for (words, sockets) in [("sockets 8", 8), ("sockets 2 timeout 2s", 2)] {
        with_gateway(1, &settings(8, words), |world, rig| {
            attach(world, rig, 1..=7);
            rig.network.set_unreachable(address(8), true);
            let slow = Device::new(7).with_turnaround(SECOND);
            rig.attach_tcp(world, &address(7).to_string(), [slow]);
            if sockets > 2 {
                asking(world, rig, 2, [(7, READ)]);
            }
            let _dead = asking(world, rig, 3, [(8, READ)]);
            for round in 0..40 {
                for unit in 1..=6 {
                    let (answer, took) = ask(world, rig, unit);
                    assert_eq!(answer, value(unit));
                    // A handshake, there and back.
                    assert!(took <= 6 * MS, "round {round}, unit {unit}: {took}");
                }
                world.run_for(500 * MS);
            }
            assert_eq!(ask(world, rig, 8), (no_path(), AT_ONCE), "by now nobody waits for it");
        });
    }
}

#[test]
fn a_server_that_comes_back_is_found_though_all_sockets_are_in_use() {
    with_gateway(1, &settings(4, "sockets 2"), |world, rig| {
        attach(world, rig, 1..=3);
        rig.network.set_unreachable(address(4), true);
        assert_eq!(ask(world, rig, 4), (no_path(), 3 * SECOND));
        let mut found = None;
        for second in 0..60 {
            for unit in 1..=3 {
                assert_eq!(ask(world, rig, unit).0, value(unit));
            }
            if second == 20 {
                rig.network.set_unreachable(address(4), false);
                attach(world, rig, [4]);
            }
            if found.is_none() && ask(world, rig, 4).0 == value(4) {
                found = Some(second);
            }
            world.run_for(SECOND);
        }
        assert!(found.is_some_and(|second| (20..=32).contains(&second)), "{found:?}");
    });
}

#[test]
fn an_outage_of_the_past_makes_no_pause_longer_once_a_connection_was_well() {
    with_gateway(1, &settings(1, "connect-timeout 500ms idle 2s"), |world, rig| {
        attach(world, rig, [1]);
        rig.network.set_unreachable(address(1), true);
        for _ in 0..60 {
            assert_eq!(ask(world, rig, 1).0, no_path());
            world.run_for(SECOND);
        }
        rig.network.set_unreachable(address(1), false);
        // Longer than the longest pause.
        world.run_for(11 * SECOND);
        assert_eq!(ask(world, rig, 1).0, value(1));
        world.run_for(5 * SECOND);
        rig.network.set_unreachable(address(1), true);
        assert_eq!(ask(world, rig, 1).0, no_path());
        rig.network.set_unreachable(address(1), false);
        world.run_for(2 * RETRY_FIRST);
        assert_eq!(ask(world, rig, 1).0, value(1), "the first pause is the shortest again");
    });
}

#[test]
fn each_server_has_its_own_status_and_the_port_is_as_well_as_the_best() {
    with_gateway(1, &settings(3, "sockets 2"), |world, rig| {
        attach(world, rig, [1]);
        let shows = |world: &mut World<'_>, command: &str, phrase: &str| {
            let text = world.run_until(typed(rig.gateway, &format!("{command}\n")));
            let squeezed = text.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(squeezed.contains(phrase), "{phrase}: {text}");
        };
        shows(world, "show servers", "plant 1 * 10.0.1.1:502 idle, connects when asked plant 2");
        assert_eq!((ask(world, rig, 1).0, ask(world, rig, 2).0), (value(1), no_path()));
        let servers = "plant 1 * 10.0.1.1:502 open plant 2 * 10.0.1.2:502 connection refused plant 3 *";
        shows(world, "show servers", servers);
        shows(world, "show ports", "plant tcp client see show servers open");
        rig.console("delete server plant unit 1").unwrap();
        rig.console("delete server plant unit 3").unwrap();
        assert_eq!(ask(world, rig, 2).0, no_path());
        shows(world, "show servers", "STATUS plant 2 * 10.0.1.2:502 connection refused");
        shows(world, "show ports", "plant tcp client see show servers connection refused");
    });
}

#[test]
fn a_line_that_goes_leaves_other_ports_as_they_are() {
    let settings = "port one tcp client
        port other tcp client
        port P502 tcp server 502
        server one unit 1 at 10.0.1.1
        server other unit 2 at 10.0.1.2
        server other unit 3 at 10.0.1.3
        route P502 1 * * one
        route P502 2-3 * * other";
    with_gateway(1, settings, |world, rig| {
        attach(world, rig, [1, 2]);
        assert_eq!((ask(world, rig, 1).0, ask(world, rig, 2).0), (value(1), value(2)));
        assert_eq!(ask(world, rig, 3).0, no_path());
        rig.console("delete server one unit 1").unwrap();
        assert_eq!((ask(world, rig, 1).0, ask(world, rig, 2).0), (no_path(), value(2)));
        assert_eq!(rig.network.counters().made, 2, "the other port has its connection still");
        let text = world.run_until(typed(rig.gateway, "show servers\n"));
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("other")).collect();
        assert!(rows[0].ends_with("open") && rows[1].ends_with("connection refused"), "{text}");
    });
}

#[test]
fn a_server_whose_attempt_made_room_for_another_one_still_takes_requests() {
    with_gateway(1, &settings(0, "sockets 1 idle 0"), |world, rig| {
        attach(world, rig, [2]);
        // The connection that is to be kept hangs, and nobody has asked for it.
        rig.network.set_unreachable(address(1), true);
        rig.console("server plant unit 1 at 10.0.1.1").unwrap();
        rig.console("server plant unit 2 at 10.0.1.2").unwrap();
        assert_eq!(ask(world, rig, 2).0, value(2));
        attach(world, rig, [1]);
        rig.network.set_unreachable(address(1), false);
        let (answer, took) = ask(world, rig, 1);
        assert_eq!(answer, value(1), "after {took}");
    });
}

#[test]
fn a_name_is_looked_up_again_when_the_connection_has_failed() {
    let settings = "port plant tcp client
        port one tcp client plc.example:1502
        port P502 tcp server 502
        server plant unit 7 at meter.example
        route P502 7 * * plant
        route P502 8 * * one";
    with_gateway(1, settings, |world, rig| {
        rig.attach_tcp(world, "10.0.1.1:502", [Device::new(7)]);
        assert_eq!(ask(world, rig, 7), (no_path(), AT_ONCE), "nobody knows it");
        rig.network.set_name("meter.example", Some(address(1).ip()));
        rig.network.set_name("plc.example", Some(address(3).ip()));
        rig.attach_tcp(world, "10.0.1.3:1502", [Device::new(8)]);
        world.run_for(SECOND);
        assert_eq!((ask(world, rig, 7).0, ask(world, rig, 8).0), (value(7), value(8)));
        // The device gets another address, and its server at the old one goes.
        rig.network.set_name("meter.example", Some(address(2).ip()));
        rig.attach_tcp(world, "10.0.1.2:502", [Device::new(7)]);
        world.run_for(61 * SECOND);
        assert_eq!(ask(world, rig, 7).0, value(7));
    });
}

#[test]
fn a_free_link_takes_who_is_wanted_before_who_is_to_be_tried_again_before_who_is_kept() {
    let at = Instant::from_secs;
    let unit = |n| (UnitRange { first: n, last: n }, Tag::Keep);
    let mut servers = Servers::new([unit(1), unit(2), unit(3)]);
    assert_eq!(servers.choose(0, None, false, at(0)), Choice::Wait(Instant::MAX));
    assert_eq!(servers.choose(0, Some(1), true, at(0)), Choice::Connect(1));
    let connected = (servers.connection(2), servers.unconnected(2), servers.connected_count());
    assert_eq!(connected, (Some(0), None, 1));
    servers.failed(1, at(0));
    servers.release(1);
    assert!(!servers.takes(2, false) && servers.takes(2, true), "only who spares servers himself may ask");
    assert_eq!(servers.choose(0, None, false, at(0)), Choice::Wait(at(0) + RETRY_FIRST));
    assert_eq!(servers.choose(1, None, true, at(0)), Choice::Connect(0), "kept");
    assert_eq!(servers.choose(0, None, true, at(1)), Choice::Connect(1), "due");
    assert!(!servers.takes(2, true), "it is being tried");
    servers.opened(1);
    assert!(servers.takes(2, false));
    // Each pause is longer than the one before, up to ten seconds.
    let pauses = (0..7).map(|_| {
        servers.failed(1, at(100));
        servers.release(1);
        servers.retries(at(100)).1 - at(100)
    });
    let ms: Vec<u64> = pauses.map(|pause| pause.as_millis()).collect();
    assert_eq!(ms, [1_000, 2_000, 4_000, 8_000, 10_000, 10_000, 10_000]);
    servers.well(1);
    servers.failed(1, at(200));
    assert_eq!(servers.retries(at(200)), (0, at(200) + RETRY_FIRST));
    assert_eq!(servers.retries(at(201)).0, 0b10);
}

#[test]
fn units_have_other_numbers_on_the_way_out_and_their_own_on_the_way_back() {
    let units = |first, last| UnitRange { first, last };
    let servers = Servers::new([
        (units(1, 5), Tag::Keep),
        (units(7, 7), Tag::Set(255)),
        (units(11, 15), Tag::Subtract(10)),
        (units(20, 21), Tag::Add(100)),
    ]);
    for (server, unit, outside) in [(0, 3, 3), (1, 7, 255), (2, 12, 2), (3, 21, 121)] {
        assert_eq!((servers.of(unit), servers.outside(unit)), (Some(server), Some(outside)));
        assert_eq!(servers.inside(server, outside), Some(unit));
    }
    for (server, outside) in [(0, 6), (1, 7), (2, 6), (2, 12), (3, 20), (3, 90), (4, 1)] {
        assert_eq!(servers.inside(server, outside), None, "{outside} is none of {server}");
    }
    assert_eq!((servers.of(6), servers.outside(6), servers.connection(6)), (None, None, None));
}
