//! Units that are looked for on a line of which nothing is known, and what becomes of everybody else meanwhile.

use embassy_futures::select::{Either, select};
use mobgate::settings::{LineSettings, Parity, PortKind};
use mobgate_simulator::console::{typed_at_terminal, typed_slowly};
use mobgate_simulator::device;

use crate::prelude::*;

const SETTINGS: &str = "
port bus serial uart1 rtu client 115200 8E1 timeout 100ms
port P502 tcp server 502
route P502 * * * bus
";

#[test]
fn others_are_refused_at_once_and_served_again_behind_it_with_the_ports_own_settings() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let mut client = rig.client(machine(1), 502);
        let good = Response::Pdu(vec![3, 2, 5, 7]);
        assert_eq!(world.run_until(client.request(5, &READ)), good);
        let scan = world.spawn(typed(rig.gateway, "scan bus 9600 units 1-20"));
        world.run_for(Duration::from_millis(500));
        let asked = Instant::now();
        assert_eq!(world.run_until(client.request(5, &READ)).exception(), Some(0x0a));
        assert!(asked.elapsed() < Duration::from_millis(2));
        let shown = world.run_until(scan);
        assert!(shown.contains("0 units found"), "{shown}");
        world.run_for(Duration::from_millis(10));
        assert_eq!(world.run_until(client.request(5, &READ)), good);
        assert_eq!(rig.end("uart1").line().baud, 115_200);
        assert_eq!(rig.counted("bus", Event::NoPath), 1);
    });
}

#[test]
fn a_key_stops_it_and_a_session_that_is_cut_leaves_the_port_as_it_was() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let mut client = rig.client(machine(1), 502);
        let begun = Instant::now();
        let keys = [(Duration::from_ticks(0), "scan bus\n"), (Duration::from_secs(3), "x")];
        let shown = world.run_until(typed_slowly(rig.gateway, &keys));
        assert!(begun.elapsed() < Duration::from_millis(3_100), "{shown}");
        assert!(shown.contains("1 units found in 3s"), "{shown}");
        world.run_for(Duration::from_millis(10));
        assert_eq!(world.run_until(client.request(5, &READ)), Response::Pdu(vec![3, 2, 5, 7]));

        let cut = select(typed(rig.gateway, "scan bus"), Timer::after_secs(2));
        assert!(matches!(world.run_until(cut), Either::Second(())));
        world.run_for(Duration::from_millis(10));
        assert_eq!(world.run_until(client.request(5, &READ)), Response::Pdu(vec![3, 2, 5, 7]));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn without_speeds_the_ports_own_speed_and_format_come_first_and_once() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let shown = world.run_until(typed(rig.gateway, "scan bus units 1-9"));
        let lines: Vec<&str> = shown.lines().filter(|line| line.contains("; in all ")).collect();
        assert!(lines[0].starts_with("115200 8E1   about 2s; in all "), "{shown}");
        assert!(lines[1].starts_with("9600 8E1 "), "{shown}");
        assert_eq!(lines.len(), 8 * 4, "{shown}");
        let [found, second] = ["unit   5 115200 8E1 ", lines[1]].map(|text| shown.find(text));
        assert!(found.is_some() && found < second, "{shown}");
        // The time announced is that of all lines, each of them once.
        let all = world
            .run_until(typed(rig.gateway, "scan bus 9600 19200 38400 115200 57600 4800 2400 1200 units 1-9"));
        let announced =
            |shown: &str| shown.lines().find(|line| line.starts_with("about ")).map(str::to_owned);
        assert!(announced(&shown).is_some(), "{shown}");
        assert_eq!(announced(&shown), announced(&all));
    });
}

#[test]
fn a_line_that_is_gone_ends_it() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let scan = world.spawn(typed(rig.gateway, "scan bus"));
        world.run_for(Duration::from_secs(1));
        rig.end("uart1").unplug();
        let shown = world.run_until(scan);
        assert!(shown.contains("the line is not open any more"), "{shown}");
        let shown = world.run_until(typed(rig.gateway, "scan bus"));
        assert!(shown.contains("115200 8E1   not found\n0 units found"), "{shown}");
        rig.end("uart1").replug();
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.ask(world, 5, &READ), Response::Pdu(vec![3, 2, 5, 7]));
    });
}

#[test]
fn what_was_found_is_taken_over_by_one_key_and_left_by_any_other() {
    let settings = "port bus serial uart1 rtu client 115200 8E1\nport P502 tcp server 502\n";
    for (key, speed, rules) in [("y", 9_600, 1), ("n", 115_200, 0)] {
        rig::with_gateway(1, settings, |world, rig| {
            let line = LineSettings { baud: 9_600, parity: Parity::None, ..LineSettings::DEFAULT };
            let devices = [3, 7].map(Device::new).to_vec();
            world.spawn(device::serve(rig.wire("uart1").tap(line), devices));
            let keys = [
                (Duration::from_ticks(0), "scan bus 9600 units 1-9\r"),
                (Duration::from_secs(20), key),
                (Duration::from_secs(1), "\x15show routes\r"),
            ];
            let shown = world.run_until(typed_at_terminal(rig.gateway, &keys));
            assert!(shown.contains("y takes this over; any other key leaves it: "), "{shown}");
            assert!(!shown.contains("error"), "{shown}");
            let baud = |settings: &Settings| match &settings.ports[0].as_ref().unwrap().kind {
                PortKind::Serial(serial) => serial.line.baud,
                _ => 0,
            };
            assert_eq!(rig.gateway.settings(baud), speed);
            assert_eq!(rig.gateway.settings(|settings| settings.routes.len()), rules);
        });
    }
}
