//! Units that are looked for on a line of which nothing is known, and what becomes of everybody else meanwhile.

use embassy_futures::select::{Either, select};
use mobgate::settings::{LineSettings, Parity, PortKind};
use mobgate_simulator::console::{typed_at_terminal, typed_slowly};
use mobgate_simulator::device;
use mobgate_simulator::wire::Flaw;

use crate::prelude::*;

const SETTINGS: &str = "
port bus serial uart1 rtu client 115200 8E1 timeout 100ms
port P502 tcp server 502
route P502 * * * bus
";

fn line(baud: u32, parity: Parity) -> LineSettings {
    LineSettings { baud, parity, ..LineSettings::DEFAULT }
}

/// Puts `units` on the line with another speed and format than the gateway's.
fn attach<'g>(world: &World<'g>, rig: &Rig<'g>, line: LineSettings, units: &[u8]) {
    let devices = units.iter().map(|unit| Device::new(*unit)).collect();
    world.spawn(device::serve(rig.wire("uart1").tap(line), devices));
}

#[test]
fn five_units_at_two_of_four_speeds_are_found_with_their_formats_and_nothing_else() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        attach(world, rig, line(9_600, Parity::None), &[3, 17, 40]);
        attach(world, rig, line(38_400, Parity::Even), &[5, 9]);
        let shown = world.run_until(typed(rig.gateway, "scan bus 9600 19200 38400 115200"));
        for unit in [3, 17, 40] {
            assert!(shown.contains(&format!("unit {unit:>3} 9600 8N1")), "{shown}");
        }
        for unit in [5, 9] {
            assert!(shown.contains(&format!("unit {unit:>3} 38400 8E1")), "{shown}");
        }
        assert!(shown.contains("5 units found in "), "{shown}");
        assert!(shown.contains("edit port bus 9600 8N1     # units 3,17,40\n"), "{shown}");
        assert!(shown.contains("edit port bus 38400 8E1    # units 5,9\n"), "{shown}");
        let known = rig.gateway.port_state(PortId(0)).unwrap().units(|units| units.iter().count());
        assert_eq!(known, 0, "the port has learned nothing");
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn the_answer_time_is_that_to_the_first_character_and_the_identification_is_shown() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let [named, other] = [3, 4].map(|unit| Device::new(unit).with_turnaround(Duration::from_millis(10)));
        named.set_response(b"\x2b\x0e\x01\x82\x00\x00\x02\x00\x04Acme\x01\x02X\xff");
        rig.attach(world, "uart1", [named.clone(), other]);
        let shown = world.run_until(typed(rig.gateway, "scan bus 115200 units 1-5 function 8"));
        assert!(!shown.contains("unit   3"), "an answer to another question is none: {shown}");
        // 1.75 ms of silence, 10 ms, and a character of 96 us; its id is no text.
        assert!(shown.contains("unit   4 115200 8E1   11.845ms function 8\n"), "{shown}");
        named.set_response(b"\x11\x05Acme\xff");
        let shown = world.run_until(typed(rig.gateway, "scan bus 115200 units 3 function 17"));
        assert!(shown.contains("function 17 Acme.\n"), "{shown}");
    });
}

#[test]
fn others_are_refused_at_once_and_served_again_behind_it_with_the_ports_own_settings() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let mut client = rig.client(machine(1), 502);
        let good = Answer::Pdu(vec![3, 2, 5, 7]);
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
        assert!(shown.contains("0 units found in 3s"), "{shown}");
        world.run_for(Duration::from_millis(10));
        assert_eq!(world.run_until(client.request(5, &READ)), Answer::Pdu(vec![3, 2, 5, 7]));

        let cut = select(typed(rig.gateway, "scan bus"), Timer::after_secs(2));
        assert!(matches!(world.run_until(cut), Either::Second(())));
        world.run_for(Duration::from_millis(10));
        assert_eq!(world.run_until(client.request(5, &READ)), Answer::Pdu(vec![3, 2, 5, 7]));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn an_ascii_line_is_tried_in_its_own_formats() {
    rig::with_gateway(1, "port bus serial uart1 ascii client 115200\n", |world, rig| {
        let line = LineSettings { data_bits: 7, stop_bits: 2, ..line(9_600, Parity::None) };
        let end = rig.wire("uart1").tap(line);
        world.spawn(device::serve_in(Framing::Ascii, end, vec![Device::new(5)]));
        let shown = world.run_until(typed(rig.gateway, "scan bus 9600 units 5-6"));
        assert!(shown.contains("unit   5 9600 7N2 "), "{shown}");
        assert!(shown.ends_with("route SOURCE 5-5 * * bus\n"), "{shown}");
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
        assert!(shown.contains("9600 8E1     not found\n0 units found"), "{shown}");
        rig.end("uart1").replug();
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.ask(world, 5, &READ), Answer::Pdu(vec![3, 2, 5, 7]));
    });
}

#[test]
fn an_answer_with_faulty_characters_is_no_proof_of_its_format() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let flawed = Faults::new(1).with(When::Always, Fault::Flawed(Flaw::Parity));
        rig.attach(world, "uart1", [Device::new(5).with_faults(flawed)]);
        let shown = world.run_until(typed(rig.gateway, "scan bus 115200 units 5"));
        assert!(shown.contains("0 units found"), "{shown}");
        assert!(shown.contains("115200 8E1   1 things heard that cannot be read"), "{shown}");
    });
}

#[test]
fn words_that_make_no_sense_are_refused() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        for (line, error) in [
            ("scan P502", "expected a port that is the client of a serial line"),
            ("scan nobody", "there is no port of this name"),
            ("scan bus units 9-1", "the range ends before it starts"),
            ("scan bus function 6", "expected a function that changes nothing: 1 to 4, 8 or 17"),
            ("scan bus 9600 what", "expected a baud rate, units, timeout or function"),
            ("tune P502", "expected a port that is the client of a serial line"),
            ("tune bus", "no unit has answered at this port yet"),
            ("tune bus count 1", "expected requests from 10 to 20000"),
        ] {
            let shown = world.run_until(typed(rig.gateway, line));
            assert!(shown.starts_with("error: line 1, ") && shown.contains(error), "{line}: {shown}");
        }
    });
}

#[test]
fn a_unit_that_answers_late_is_asked_again_and_found_too() {
    // The last one of the range, and one in its midst.
    for range in ["units 1-3", "units 1-20"] {
        rig::with_gateway(1, SETTINGS, |world, rig| {
            let slow = Device::new(3).with_turnaround(Duration::from_millis(300));
            rig.attach(world, "uart1", [Device::new(1), Device::new(2), slow]);
            let shown = world.run_until(typed(rig.gateway, &format!("scan bus 115200 {range}")));
            assert!(shown.contains("115200 8E1   slower units: timeout 500ms, "), "{shown}");
            let found = shown.contains("unit   3 115200 8E1   301.8") && shown.contains("# units 1,2,3\n");
            assert!(found, "{shown}");
            assert!(!shown.contains("cannot be read"), "{shown}");
            assert!(!shown.contains("takes this over"), "nobody is asked who types no keys: {shown}");
        });
    }
}

#[test]
fn what_was_found_is_taken_over_by_one_key_and_left_by_any_other() {
    let settings = "port bus serial uart1 rtu client 115200 8E1\nport P502 tcp server 502\n";
    for (key, speed, rules) in [("y", 9_600, 1), ("n", 115_200, 0)] {
        rig::with_gateway(1, settings, |world, rig| {
            attach(world, rig, line(9_600, Parity::None), &[3, 7]);
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
