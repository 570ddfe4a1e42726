//! Servers of TCP clients as lines: what is accepted, and what each error says.

use std::string::ToString;

use super::{error_after, load, print, std};
use crate::language::*;
use crate::settings::Tag;
use crate::settings::*;

const PLANT: &str = "port P502  tcp server 502
port plant tcp client sockets 4 idle 5s
port one   tcp client meter.example:1502
server plant unit 1-5     at 192.168.1.20:502
server plant unit 7       at meter.example:1502 tag =1
server plant unit 11-12   at [fe80::1]:502 tag -10
";

#[test]
fn servers_have_units_an_address_and_a_tag() {
    let settings = load(PLANT);
    assert_eq!(print(&settings), PLANT);
    assert_eq!(load(&print(&settings)), settings);
    let [first, second, third] = &settings.servers[..] else { panic!("three") };
    assert_eq!((first.units.first, first.units.last, first.tag), (1, 5, Tag::Keep));
    assert_eq!((second.at.to_string().as_str(), second.tag), ("meter.example:1502", Tag::Set(1)));
    assert_eq!(third.tag, Tag::Subtract(10));
    let plant = settings.find("plant").unwrap();
    let asked = |unit| settings.server(plant, unit).map(|(at, there)| (at.port, there));
    assert_eq!(
        [asked(5), asked(6), asked(7), asked(12)],
        [Some((502, 5)), None, Some((1_502, 1)), Some((502, 2))]
    );
}

#[test]
fn names_are_names_of_hosts_and_no_mistyped_addresses() {
    let good =
        |address: &str| apply(&mut Settings::new(), &std::format!("port a tcp client {address}")).is_ok();
    for name in ["localhost", "meter.example:502", "plc-7", "a.b.c.d1", "METER", "timeout:502"] {
        assert!(good(name), "{name}");
    }
    for name in
        "192.168.1, 300.1.1.1, 1.2.3.4.5, -a, a-, a..b, meter:0, meter:x, meter:1:2, me ter, a/b".split(", ")
    {
        assert!(!good(name), "{name}");
    }
    assert!(!good(&"a".repeat(ServerName::new().capacity() + 1)));
}

#[test]
fn what_does_not_fit_a_port_with_one_or_several_servers_is_refused() {
    for (line, text) in [
        ("server plant unit 5-6 at 10.0.0.1", "\"5-6\": unit 5 is in the line server ... unit 1-5 already"),
        ("server plant unit 0-20 at 10.0.0.1", "\"0-20\": unit 1 is in the line server ... unit 1-5 already"),
        (
            "server one unit 5 at 10.0.0.1",
            "\"one\": is not a tcp client without an address: only that has server lines",
        ),
        (
            "server P502 unit 5 at 10.0.0.1",
            "\"P502\": is not a tcp client without an address: only that has server lines",
        ),
        ("server nobody unit 5 at 10.0.0.1", "\"nobody\": there is no port of this name"),
        (
            "server plant unit 20-21 at 10.0.0.1 tag =1",
            "\"=1\": expected * or a shift for several units, and * for unit 0",
        ),
        ("server plant unit 20-21 at 10.0.0.1 tag +240", "\"+240\": unit 20 would become 260"),
        ("server plant unit 20 at 10.0.0.1 tag", "end of line: expected *"),
        ("server plant unit 20 at 10.0.0", "\"10.0.0\": expected the address of a server"),
        ("server plant 20 at 10.0.0.1", "\"20\": expected unit and the units of the server"),
        ("edit port plant unit 7", "\"unit\": is for a tcp client with an address: server lines have tags"),
        (
            "edit port one sockets 2",
            "\"sockets\": is for a tcp client without an address, which has several servers",
        ),
        ("edit port plant sockets 17", "\"17\": expected connections from 1 to 16"),
        ("edit port plant address 10.0.0.1", "\"plant\": 3 server lines name this port: delete them first"),
        ("port plant serial uart1 rtu client", "\"plant\": 3 server lines name this port: delete them first"),
        ("delete port plant", "\"plant\": 3 server lines name this port: delete them first"),
        ("delete server plant unit 1", "\"1\": no server line of this port has these units"),
    ] {
        let error = error_after(PLANT, line);
        assert!(error.contains(text), "{line}: {error}");
    }
}

#[test]
fn there_can_be_so_many_servers_at_a_port_and_in_all() {
    let mut settings = load("port a tcp client\nport b tcp client\nport c tcp client\n");
    let mut add = |port: &str, unit: usize| {
        apply(&mut settings, &std::format!("server {port} unit {unit} at 10.0.0.1"))
    };
    for port in ["a", "b"] {
        (1..=PORT_SERVERS_MAX).for_each(|unit| drop(add(port, unit).unwrap()));
        assert_eq!(add(port, 200).unwrap_err().problem, Problem::ServersFull(PORT_SERVERS_MAX));
    }
    assert_eq!(add("c", 1).unwrap_err().problem, Problem::ServersFull(SERVERS_MAX));
}

#[test]
fn rules_to_units_without_a_server_and_circles_through_servers_draw_a_warning() {
    let warning = |lines: &str| {
        let mut settings = load(PLANT);
        lines.lines().for_each(|line| drop(apply(&mut settings, line).unwrap()));
        settings.warnings().next().map(|warning| warning.to_string())
    };
    let missing = "rule 1 leads to unit 6 of port plant, which has no server line: 0A";
    assert_eq!(warning("route P502 1-7 * * plant").as_deref(), Some(missing));
    assert_eq!(warning("route P502 106 * -100 plant").as_deref(), Some(missing));
    assert_eq!(warning("route P502 1-5 * * plant\nroute P502 * * * plant"), None, "all that there are");
    let circle = "server plant unit 30 at 127.0.0.1 tag =31\nroute P502 31 * -1 plant";
    let back = "rule 1 leads unit 31 in a circle: its requests come back by port P502";
    assert_eq!(warning(circle).as_deref(), Some(back));
}
