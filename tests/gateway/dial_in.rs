//! Client ports whose devices connect to the gateway: whose a device is, who replaces whom, and what heartbeats do.

use mobgate_simulator::net::ClientStream;

use crate::prelude::*;

/// Where devices connect.
const AT: u16 = 5020;

const ONE: &str = "port modem tcp client listen 5020 rtu
    port P502 tcp server 502
    route P502 * * * modem";

/// Three ports at one address: a network of its own, and two by their first bytes.
const THREE: &str = "port near tcp client listen 5020 allow 10.0.0.64/26
    port east tcp client listen 5020 allow 10.0.0.0/26 first \"EAST\"
    port west tcp client listen 5020 allow 10.0.0.0/26 first 0x57FE00
    port P502 tcp server 502
    route P502 1 * * near
    route P502 2 * * east
    route P502 3 * * west";

/// A device on the machine `host` that has connected and sent these bytes.
fn dialed(world: &mut World<'_>, rig: &Rig<'_>, host: u8, first: &[u8]) -> ClientStream {
    let mut stream = rig.network.connect(machine(host), AT).expect("the gateway listens");
    world.run_until(async {
        stream.write_all(first).await.unwrap();
        stream
    })
}

/// Whether the gateway ends the connection within `time`.
fn ends_within(world: &mut World<'_>, stream: &mut ClientStream, time: Duration) -> bool {
    let ended = async { matches!(stream.read(&mut [0; 16]).await, Ok(0) | Err(_)) };
    world.run_until(embassy_time::with_timeout(time, ended)).unwrap_or(false)
}

fn shown(world: &mut World<'_>, rig: &Rig<'_>, what: &str) -> String {
    world.run_until(typed(rig.gateway, what))
}

#[test]
fn requests_get_0a_until_the_device_has_connected_and_again_when_it_has_left() {
    with_gateway(1, ONE, |world, rig| {
        assert_eq!(rig.ask(world, 5, &READ).exception(), Some(0x0a));
        let ports = shown(world, rig, "show ports");
        assert!(["listen 5020", "waits for its device"].iter().all(|text| ports.contains(text)), "{ports}");
        let stream = dialed(world, rig, 9, b"");
        rig.serve_on(world, stream, true, [Device::new(5)]);
        world.run_for(SECOND);
        assert_eq!(rig.ask(world, 5, &READ), value(5));
        assert!(shown(world, rig, "show ports").contains("open, device 10.0.0.9:"));
        // It stays without requests.
        world.run_for(300 * SECOND);
        assert_eq!(rig.ask(world, 5, &READ), value(5));
        assert_eq!(rig.counted("modem", Event::Connected), 1);
        // Another one takes its place, and leaves.
        let leaves = dialed(world, rig, 9, b"");
        world.run_for(SECOND);
        drop(leaves);
        world.run_for(SECOND);
        assert_eq!(rig.ask(world, 5, &READ).exception(), Some(0x0a));
        assert!(shown(world, rig, "show ports").contains("waits for its device"));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn devices_at_one_address_are_told_apart_by_where_they_come_from_and_what_they_send_first() {
    with_gateway(2, THREE, |world, rig| {
        // What follows the first bytes is not theirs: a device may say more than tells it.
        for (host, first, unit) in [(3, &b"W\xfe\x00"[..], 3), (70, b"", 1), (4, b"EAST", 2)] {
            let stream = dialed(world, rig, host, first);
            rig.serve_on(world, stream, false, [Device::new(unit)]);
            world.run_for(MS);
            assert_eq!(rig.ask(world, unit, &READ), value(unit));
        }
        let ports = shown(world, rig, "show ports");
        for device in ["10.0.0.3:", "10.0.0.70:", "10.0.0.4:"] {
            assert!(ports.contains(&format!("open, device {device}")), "{ports}");
        }
    });
}

#[test]
fn first_bytes_may_come_one_by_one() {
    with_gateway(3, THREE, |world, rig| {
        let mut stream = dialed(world, rig, 4, b"");
        let stream = world.run_until(async move {
            for byte in b"EAST" {
                Timer::after(SECOND).await;
                stream.write_all(&[*byte]).await.unwrap();
            }
            stream
        });
        assert!(
            shown(world, rig, "show clients").contains("10.0.0.4:")
                || rig.counted("east", Event::Connected) == 1
        );
        rig.serve_on(world, stream, false, [Device::new(2)]);
        world.run_for(MS);
        assert_eq!(rig.ask(world, 2, &READ), value(2));
    });
}

#[test]
fn who_is_not_told_is_disconnected_counted_and_reported_but_not_each_time() {
    with_gateway(4, THREE, |world, rig| {
        // Wrong bytes, an address of no port, and silence.
        let mut wrong = dialed(world, rig, 5, b"EASY");
        assert!(ends_within(world, &mut wrong, SECOND));
        let mut foreign = dialed(world, rig, 200, b"EAST");
        assert!(ends_within(world, &mut foreign, SECOND));
        let mut silent = dialed(world, rig, 6, b"EA");
        assert!(!ends_within(world, &mut silent, 9 * SECOND));
        assert!(shown(world, rig, "show clients").contains("10.0.0.6:"));
        assert!(ends_within(world, &mut silent, 2 * SECOND));
        let counted = |event| rig.counted("near", event);
        assert_eq!((counted(Event::Unwelcome), counted(Event::Stalled)), (2, 1));
        for _ in 0..20 {
            let mut wrong = dialed(world, rig, 5, b"X");
            assert!(ends_within(world, &mut wrong, SECOND));
        }
        assert_eq!(rig.counted("near", Event::Unwelcome), 22);
        let audit = shown(world, rig, "show audit");
        for (host, why) in
            [("10.0.0.5", "it is that of no port"), ("10.0.0.6", "its first bytes do not come")]
        {
            let why = format!("a device is refused, {why}, at port near");
            assert!(audit.lines().any(|line| line.contains(host) && line.ends_with(&why)), "{audit}");
        }
        assert!(audit.matches("a device is refused").count() < 8, "{audit}");
        // Nothing of it keeps a device out.
        let stream = dialed(world, rig, 4, b"EAST");
        rig.serve_on(world, stream, false, [Device::new(2)]);
        world.run_for(100 * MS);
        assert_eq!(rig.ask(world, 2, &READ), value(2));
    });
}

#[test]
fn any_number_of_silent_connections_keeps_no_device_out() {
    with_gateway(5, THREE, |world, rig| {
        let crowd: Vec<ClientStream> = (0..60).map(|_| dialed(world, rig, 6, b"E")).collect();
        let stream = dialed(world, rig, 4, b"EAST");
        rig.serve_on(world, stream, false, [Device::new(2)]);
        world.run_for(SECOND);
        assert_eq!(rig.ask(world, 2, &READ), value(2));
        // 3 ports have 4 that wait each.
        let waiting = shown(world, rig, "show clients").matches("10.0.0.6:").count();
        assert!((1..=12).contains(&waiting), "{waiting}");
        drop(crowd);
    });
}

#[test]
fn a_further_connection_replaces_one_that_only_looks_open() {
    with_gateway(6, ONE, |world, rig| {
        let stream = dialed(world, rig, 9, b"");
        world.run_for(SECOND);
        // The network is gone: neither FIN nor reset.
        stream.vanish();
        let mut client = rig.client(machine(1), 502);
        let lost = world.spawn(async move { client.request(5, &READ).await });
        world.run_for(100 * MS);
        let stream = dialed(world, rig, 9, b"");
        rig.serve_on(world, stream, true, [Device::new(5)]);
        assert_eq!(world.run_until(lost).exception(), Some(0x0b), "it may have been executed");
        world.run_for(SECOND);
        assert_eq!(rig.ask(world, 5, &READ), value(5));
        assert_eq!(rig.counted("modem", Event::Connected), 2);
    });
}

/// A device that answers each request by what `respond` makes of it, in pieces with pauses before them.
async fn respond(mut stream: ClientStream, respond: impl Fn(&[u8]) -> Vec<(Duration, Vec<u8>)>) {
    loop {
        let mut request = [0; 260];
        let count = stream.read(&mut request).await.unwrap_or(0);
        if count == 0 {
            return;
        }
        for (pause, piece) in respond(&request[..count]) {
            Timer::after(pause).await;
            if stream.write_all(&piece).await.is_err() {
                return;
            }
        }
    }
}

/// Heartbeats, also such as look like the beginning of a response.
const HEARTBEATS: [&[u8]; 6] =
    [b"HB\r\n", &[0], &[0xfe; 7], &[5, 3], &[5, 3, 2, 0, 0, 0, 0], &[0, 0, 0, 0, 0, 0, 0]];

#[test]
fn heartbeats_between_and_before_responses_damage_none_by_rtu() {
    for heartbeat in HEARTBEATS {
        with_gateway(7, ONE, |world, rig| {
            let stream = dialed(world, rig, 9, b"REG 0815\r\n");
            world.spawn(respond(stream, move |_| {
                let response = rtu::frame(5, &[3, 2, 5, 7]);
                // One before the response, one with it, and one behind.
                vec![
                    (50 * MS, heartbeat.to_vec()),
                    (200 * MS, [heartbeat, &response].concat()),
                    (50 * MS, heartbeat.to_vec()),
                ]
            }));
            world.run_for(SECOND);
            for _ in 0..5 {
                assert_eq!(rig.ask(world, 5, &READ), value(5), "{heartbeat:?}");
                world.run_for(SECOND);
            }
            let lost =
                [Event::Timeout, Event::Corrupt, Event::LineLost].map(|event| rig.counted("modem", event));
            assert_eq!(lost, [0; 3], "{heartbeat:?}");
            assert!(rig.counted("modem", Event::Noise) >= 5);
            assert_eq!(rig.counted("modem", Event::Connected), 1);
        });
    }
}

#[test]
fn heartbeats_between_and_before_responses_damage_none_by_modbus_tcp() {
    for heartbeat in HEARTBEATS {
        with_gateway(8, &ONE.replace(" rtu", ""), |world, rig| {
            let stream = dialed(world, rig, 9, b"REG 0815\r\n");
            world.spawn(respond(stream, move |request| {
                let response = [&request[..4], &[0, 5, 5, 3, 2, 5, 7]].concat();
                let (head, rest) = response.split_at(3);
                vec![
                    (50 * MS, heartbeat.to_vec()),
                    (50 * MS, [heartbeat, head].concat()),
                    (50 * MS, [rest, heartbeat].concat()),
                    (50 * MS, heartbeat.to_vec()),
                ]
            }));
            world.run_for(SECOND);
            for _ in 0..5 {
                assert_eq!(rig.ask(world, 5, &READ), value(5), "{heartbeat:?}");
                world.run_for(SECOND);
            }
            let lost =
                [Event::Timeout, Event::Malformed, Event::LineLost].map(|event| rig.counted("modem", event));
            assert_eq!(lost, [0; 3], "{heartbeat:?}");
            assert_eq!(rig.counted("modem", Event::Connected), 1);
        });
    }
}

#[test]
fn a_response_that_is_corrupt_indeed_ends_at_the_timeout() {
    with_gateway(9, ONE, |world, rig| {
        let stream = dialed(world, rig, 9, b"");
        world.spawn(respond(stream, |_| {
            let mut response = rtu::frame(5, &[3, 2, 5, 7]);
            response[3] ^= 1;
            vec![(50 * MS, response)]
        }));
        world.run_for(SECOND);
        let start = Instant::now();
        assert_eq!(rig.ask(world, 5, &READ).exception(), Some(0x0b));
        assert!(start.elapsed() < SECOND);
        assert_eq!(rig.counted("modem", Event::BadCheck), 1);
    });
}

#[test]
fn new_settings_end_the_connection_and_the_listener() {
    with_gateway(10, ONE, |world, rig| {
        let mut stream = dialed(world, rig, 9, b"");
        world.run_for(SECOND);
        rig.console("edit port modem listen 5021").unwrap();
        assert!(ends_within(world, &mut stream, SECOND));
        world.run_for(SECOND);
        assert!(rig.network.is_listening(5021) && !rig.network.is_listening(AT));
        rig.console("port modem tcp client 10.0.1.1").unwrap();
        world.run_for(SECOND);
        assert!(shown(world, rig, "show ports").contains("idle, connects when asked"));
    });
}

#[test]
fn a_listener_that_cannot_be_opened_is_told_and_tried_again() {
    with_gateway(11, "port P502 tcp server 502", |world, rig| {
        rig.network.refuse_listeners(AT, Some(mobgate::hal::OpenErrorKind::InUse));
        rig.console("port modem tcp client listen 5020").unwrap();
        world.run_for(SECOND);
        assert!(shown(world, rig, "show ports").contains("in use by another program"));
        rig.network.refuse_listeners(AT, None);
        world.run_for(2 * SECOND);
        assert!(shown(world, rig, "show ports").contains("waits for its device"));
    });
}

#[test]
fn lines_that_would_leave_a_device_in_doubt_are_refused() {
    with_gateway(12, THREE, |_, rig| {
        for (line, why) in [
            (
                "port more tcp client listen 5020",
                "port near has these devices there: tell them apart by allow or first",
            ),
            (
                "port more tcp client listen 5020 allow 10.0.0.1 first \"EASTER\"",
                "port east has these devices",
            ),
            ("port more tcp client listen 5020 allow 10.0.0.1 first W", "port west has these devices"),
            ("port more tcp client listen 127.0.0.1:5020 first X", "another port listens there"),
            ("port more tcp server 5020", "another port listens there"),
            ("edit port east listen 502", "another port listens there"),
        ] {
            let said = rig.console(line).unwrap_err();
            assert!(said.contains(why), "{line}: {said}");
        }
        rig.console("port more tcp client listen 5020 allow 10.0.0.1 first \"SOUTH\"").unwrap();
        rig.console("port other tcp client listen 5020 allow 10.0.1.0/24").unwrap();
    });
}
