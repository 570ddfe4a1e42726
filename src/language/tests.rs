//! The line language as its users meet it: what is accepted, and what each error says.

// Only a gateway that was built with them has certificates.
#[cfg(feature = "tls")]
mod certificates;
mod network;
// As below.
#[cfg(all(feature = "points", not(feature = "long-values")))]
mod no_long;
// And only one that was built without them has none.
#[cfg(not(feature = "points"))]
mod no_points;
#[cfg(not(feature = "tls"))]
mod no_tls;
pub(crate) mod properties;
// As its lines.
#[cfg(feature = "mqtt")]
mod publishers;
mod rules;
mod texts;
// And only one that was built with them has slaves.
#[cfg(feature = "points")]
mod slaves;
// And only one that was built with them has servers.
#[cfg(feature = "servers")]
mod servers;

extern crate std;
use std::borrow::ToOwned;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use embassy_time::Duration;

use super::*;
use crate::routing::is_implied;
use crate::settings::*;
use crate::settings::{Destination, Functions, Priority, Tag, UnitRange};

const PORTS: &str = "\
port P1   serial uart1 rtu client 19200 8E1 timeout 300ms
port P2   serial uart2 rtu server 9600 8N1
port P3   serial /dev/ttyUSB0 ascii server 9600 7E1
port P4   serial uart4 ascii client 9600
port P502 tcp server 502 clients 16 idle 60s reserve 2 for 192.168.1.0/24,10.0.0.7
port P5   tcp server 127.0.0.1:5020 pipeline 4 lifetime 2s
";

fn load(text: &str) -> Settings {
    let mut settings = Settings::new();
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut settings, &mut line);
    loader.feed(text.as_bytes()).unwrap();
    loader.finish().unwrap();
    settings
}

fn print(settings: &Settings) -> String {
    let mut text = String::new();
    let mut n = 0;
    while let Some(written) = write_line(settings, n, &mut text) {
        written.unwrap();
        text.push('\n');
        n += 1;
    }
    text
}

/// Applies `line` on top of `PORTS` and gives its error as the console prints it.
fn error(line: &str) -> String {
    error_after(PORTS, line)
}

fn error_after(text: &str, line: &str) -> String {
    let mut settings = load(text);
    let before = settings.clone();
    let error = apply(&mut settings, line).expect_err(line).to_string();
    assert_eq!(settings, before, "a bad line changes nothing: {line}");
    error
}

fn apply_all(settings: &mut Settings, lines: &[&str]) {
    for line in lines {
        apply(settings, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
}

#[test]
fn ports_are_read_by_value() {
    let settings = load(PORTS);
    let Some(PortKind::Serial(p1)) = settings.ports[0].as_ref().map(|port| &port.kind) else { panic!() };
    assert_eq!((p1.device.as_str(), p1.framing, p1.side), ("uart1", Framing::Rtu, Side::Client));
    assert_eq!(p1.line, LineSettings::DEFAULT);
    assert_eq!(p1.client.timeout, Duration::from_millis(300));
    let Some(PortKind::Serial(p4)) = settings.ports[3].as_ref().map(|port| &port.kind) else { panic!() };
    assert_eq!((p4.line.baud, p4.line.data_bits, p4.line.parity), (9_600, 7, Parity::Even));
    let Some(PortKind::TcpServer(p502)) = settings.ports[4].as_ref().map(|port| &port.kind) else { panic!() };
    assert_eq!((p502.listen.port, p502.clients, p502.reserved), (502, 16, 2));
    assert_eq!(p502.reserved_for[1], IpPrefix::new("10.0.0.7".parse().unwrap(), 32).unwrap());
}

fn address(text: &str) -> ServerAddress {
    text.parse::<core::net::SocketAddr>().unwrap().into()
}

#[test]
fn a_tcp_client_is_read_by_value_and_changed_by_words() {
    let mut settings = load("port plc tcp client 192.168.1.20 in-flight 4 idle 0 unit 255 retries 2");
    let client = |settings: &Settings| match settings.ports[0].as_ref().map(|port| port.kind.clone()) {
        Some(PortKind::TcpClient(client)) => client,
        other => panic!("{other:?}"),
    };
    let plc = client(&settings);
    assert_eq!(plc.server, Some(address("192.168.1.20:502")));
    assert_eq!((plc.in_flight, plc.unit, plc.retries), (4, Some(255), 2));
    assert_eq!(plc.idle, Duration::from_ticks(0));
    apply_all(&mut settings, &["edit port plc address [::1]:1502 unit auto rtu"]);
    let plc = client(&settings);
    assert_eq!((plc.server, plc.unit), (Some(address("[::1]:1502")), None));
    assert_eq!((plc.framing, plc.in_flight), (StreamFraming::Rtu, 1), "one request at a time with rtu");
    assert_eq!(print(&settings), "port plc tcp client [::1]:1502 rtu idle 0 retries 2\n");
    apply_all(&mut settings, &["edit port plc mbap"]);
    assert_eq!(client(&settings).framing, StreamFraming::Mbap);
}

#[test]
fn a_capture_has_one_client_unless_told_otherwise_and_nothing_to_set_for_requests() {
    let mut settings = load("port wire tcp server 5029 capture allow 10.0.0.0/8");
    let server = |settings: &Settings| match settings.ports[0].as_ref().map(|port| port.kind.clone()) {
        Some(PortKind::TcpServer(server)) => (server.framing, server.clients),
        other => panic!("{other:?}"),
    };
    assert_eq!(server(&settings), (StreamFraming::Capture, 1));
    assert_eq!(print(&settings), "port wire tcp server 5029 capture allow 10.0.0.0/8\n");
    apply_all(&mut settings, &["edit port wire clients 16"]);
    assert_eq!(print(&settings), "port wire tcp server 5029 capture clients 16 allow 10.0.0.0/8\n");
    for word in ["idle 5s", "pipeline 4", "lifetime 1s", "broadcast off"] {
        let error =
            apply(&mut Settings::new(), &format!("port wire tcp server 5029 capture {word}")).unwrap_err();
        assert_eq!(error.problem, Problem::NoRequests, "{word}");
    }
    assert!(apply(&mut Settings::new(), "port wire tcp client 10.0.0.1 capture").is_err());
}

#[test]
fn options_come_in_any_order_and_case_with_commas_and_tabs() {
    let one = load("port P1 serial uart1 rtu client 9600 8N2 timeout 300ms gap 5ms retries 2");
    let two = load("PORT P1\tSerial uart1, 8n2,9600, Retries 2, GAP 5ms Master RTU timeout 0.3s # done");
    assert_eq!(one, two);
}

/// Lines, and what their errors say.
const ERRORS: &[(&str, &str)] = &[
    (
        "prot P1",
        "column 1: \"prot\": expected port, server, route, device, point, slave, edit, insert, move, delete, network, mdns",
    ),
    ("prot P1", " or user; did you mean port?"),
    ("port", "column 5: end of line: expected a port name: a letter"),
    ("port 7 tcp server 1", "column 6: \"7\": expected a port name"),
    ("port local tcp server 1", "column 6: \"local\": expected a port name"),
    ("port sixteen--letters tcp server 1", "expected a port name"),
    ("port X", "column 7: end of line: expected serial, tcp, udp, "),
    ("port X udp client 1", "\"client\": expected server"),
    ("port X udp server 502 requests 33", "expected requests from 1 to 32"),
    ("port X tcp klient 1", "expected server or client; did you mean client?"),
    ("port X tcp client 1", "\"1\": expected the address of a server"),
    ("port X tcp client 0.0.0.0:502", "expected the address of a server"),
    ("port X tcp client 10.0.0.1:0", "expected the address of a server"),
    ("port X tcp client 10.0.0.1 in-flight 17", "expected requests from 1 to 16"),
    ("port X tcp client 10.0.0.1 unit 256", "expected auto, or a unit id from 0 to 255"),
    ("port X tcp client 10.0.0.1 rtu in-flight 4", "\"in-flight\": cannot be set with rtu"),
    ("port X tcp server 1 pipeline 4 rtu", "\"pipeline\": cannot be set with rtu"),
    ("port X tcp client 10.0.0.1 connect-delay 2m", "expected a time from 0 to 60s"),
    ("port X tcp client 10.0.0.1 clients 4", "expected address, rtu, sockets, unit"),
    ("port X tcp server 0", "\"0\": expected a TCP port from 1 to 65535"),
    ("port X tcp server 1 clints 4", "did you mean clients?"),
    ("port X tcp server 1 idle 60", "\"60\": expected a time with its unit"),
    ("port X tcp server 1 idle 100ms", "expected a time from 1s to 86400s"),
    ("port X tcp server 1 pipeline 17", "expected requests from 1 to 16"),
    ("port X tcp server 1 clients 4 reserve 5 for ::1", "\"5\": more connections are reserved than the 4"),
    ("port X tcp server 1 reserve 2", "end of line: expected for and the addresses"),
    ("port X tcp server 1 reserve 1 for ::1,::2,::3,::4,::5", "\"::5\": expected at most 4 prefixes"),
    ("port X tcp server 502", "\"502\": another port listens there"),
    ("port X tcp server 1.2.3.4:502", "another port listens there"),
    ("port X serial uart1 rtu client", "\"uart1\": port P1 has this device"),
    ("port X serial uart9 client", "column 27: end of line: expected rtu or ascii"),
    ("port X serial uart9 rtu", "end of line: expected client or server"),
    ("port X serial uart9 rtu client 0", "expected a baud rate from 1 to 10000000"),
    ("port X serial uart9 rtu client 10000001", "expected a baud rate from 1 to 10000000"),
    ("port X serial uart9 rtu client 7E1", "\"7E1\": RTU needs 8 data bits"),
    ("port X serial uart9 rtu client 9600 19200", "\"19200\": is set twice"),
    ("port X serial uart9 rtu ascii client", "\"ascii\": is set twice"),
    ("port X serial uart9 rtu client timeout 2h", "expected a time from 1ms to 3600s"),
    ("port X serial uart9 rtu client timeout", "end of line: expected a time with its unit"),
    ("port X serial uart9 rtu server retries 2", "\"retries\": is for the client side only"),
    ("port X serial uart9 rtu client reply-delay 2ms", "\"reply-delay\": is for the server side only"),
    ("port X serial uart9 rtu server answer-within 1ms", "expected a time from 10ms to 3600s"),
    ("port X serial uart9 rtu client driver-after 1ms", "\"driver-after\": needs rs485 or rts"),
    ("port X serial uart9 rtu client rs485 rts", "\"rts\": is set twice"),
    ("route P9 1 * * P1", "column 7: \"P9\": there is no port of this name"),
    ("route P502 64-1 * * P1", "\"64-1\": the range ends before it starts"),
    ("route P502 256 * * P1", "\"256\": expected a unit id from 0 to 255"),
    ("route P502 1 192.168.1 * P1", "\"192.168.1\": expected an IP address"),
    ("route P2 1 192.168.1.1 * P1", "\"192.168.1.1\": clients of this source"),
    ("route P502 1 * 7 P1", "\"7\": expected * (the unit id stays)"),
    ("route P502 1 * * P502", "\"P502\": source and destination are the same port"),
    ("route P502 1 * * P1 readonly all", "\"all\": is set twice"),
    ("route P502 1 * * P1 functions", "end of line: expected function codes from 1 to 127"),
    ("route P502 1 * * P1 functions 3,128", "\"128\": expected function codes from 1 to 127"),
    ("route P502 1 * * P1 priority urgent", "\"urgent\": expected high, normal or low"),
    ("route P502 1 * * P1 merge near", "end of line: expected addresses between two reads from 1 to 255"),
    ("route P502 1 * * P1 merge near 0", "\"0\": expected addresses between two reads from 1 to 255"),
    ("route P502 1 * * P1 merge maybe", "\"maybe\": expected on, off, adjacent or near N"),
    ("route P502 1 * * P1 cache 2m", "\"2m\": expected a time from 0 to 60s"),
    ("route P502 1 * * P1 cache 1.5ms", "\"1.5ms\": expected whole milliseconds"),
    ("route P502 1 * * P1 P2", "\"P2\": expected readonly, all"),
    ("edit port P9 9600", "\"P9\": there is no port of this name"),
    ("edit port P1", "end of line: expected rtu, ascii"),
    ("edit route 1 P502 1 * * P1", "\"1\": there is no rule of this number (there are 0)"),
    ("delete route 0", "\"0\": expected a rule's number from 1 to 64"),
    ("delete routes now", "\"now\": expected the end of the line"),
];

#[test]
fn an_error_names_the_column_the_word_and_what_is_expected() {
    assert_eq!(
        error("port P9 serial uart9 rtu 81E client"),
        "column 26: \"81E\": expected a format such as 8E1, 7E1, 8N1 or 8N2"
    );
    for (line, expected) in ERRORS {
        let error = error(line);
        assert!(error.contains(expected), "{line}\n gives    {error}\n expected {expected}");
    }
}

#[test]
fn a_port_that_rules_name_is_not_deleted() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["route P502 1 * * P1", "route P502 2 * * P4", "route P2 2 * * P1"]);
    let error = apply(&mut settings, "delete port P1").unwrap_err().to_string();
    assert_eq!(error, "column 13: \"P1\": rules 1, 3 name this port: delete or edit first");
    let error = apply(&mut settings, "delete port P4").unwrap_err().to_string();
    assert_eq!(error, "column 13: \"P4\": rule 2 names this port: delete or edit first");
    apply_all(&mut settings, &["delete route 2", "delete port P4"]);
    assert_eq!(settings.ports[3], None);
    assert_eq!(settings.routes[1].destination, Destination::Port(PortId(0)));
}

#[test]
fn a_port_that_becomes_serial_must_not_have_rules_by_address() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["route P502 1 10.0.0.1 * P1"]);
    let error = apply(&mut settings, "port P502 serial uart9 rtu server").unwrap_err().to_string();
    assert_eq!(error, "column 6: \"P502\": rule 1 names it with an IP address; serial clients have none");
}

#[test]
fn an_edit_changes_only_the_named_words() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["edit port p1 9600 retries 2", "edit port P502 idle 0 reserve 0"]);
    let text = print(&settings);
    assert!(text.contains("port P1   serial uart1 rtu client 9600 8E1 timeout 300ms retries 2\n"), "{text}");
    assert!(text.contains("port P502 tcp server 502 idle 0\n"), "{text}");
    apply_all(
        &mut settings,
        &["edit port P1 server", "edit port P1 client gap 5ms rs485", "edit port P1 gap auto rs232"],
    );
    let text = print(&settings);
    assert!(text.contains("port P1   serial uart1 rtu client 9600 8E1\n"), "{text}");
}

#[test]
fn settings_of_the_other_side_and_of_no_driver_are_forgotten() {
    let mut settings = load(PORTS);
    let lines = [
        "edit port P2 answer-within 500ms reply-delay 5ms rts driver-before 1ms driver-after 2ms echo",
        "edit port P2 client rs232 no-echo",
    ];
    apply_all(&mut settings, &lines[..1]);
    let text = print(&settings);
    let printed = "port P2   serial uart2 rtu server 9600 8N1 rts driver-before 1ms driver-after 2ms echo \
                   answer-within 500ms reply-delay 5ms\n";
    assert!(text.contains(printed), "{text}");
    apply_all(&mut settings, &lines[1..]);
    let text = print(&settings);
    assert!(text.contains("port P2   serial uart2 rtu client 9600 8N1\n"), "{text}");
    apply_all(&mut settings, &["edit port P2 server rs485"]);
    let text = print(&settings);
    assert!(text.contains("port P2   serial uart2 rtu server 9600 8N1 rs485\n"), "{text}");
}

#[test]
fn a_port_line_replaces_the_port_of_its_name_in_its_place() {
    let mut settings = load(PORTS);
    apply_all(
        &mut settings,
        &["delete port P1", "port p3 tcp server 5021", "port P9 serial uart9 rtu client"],
    );
    let names: Vec<&str> = settings.ports.iter().flatten().map(|port| port.name.as_str()).collect();
    assert_eq!(names, ["P9", "P2", "p3", "P4", "P502", "P5"]);
}

#[test]
fn rules_are_inserted_moved_and_edited_by_number() {
    let mut settings = load(PORTS);
    apply_all(
        &mut settings,
        &[
            "route P502 1 * * P1",
            "route P502 2 * * P1",
            "route P502 3 * * P1",
            "insert route 1 P502 9 * * P1",
            "move route 2 4",
            "edit route 1 P502 8 * * P1",
        ],
    );
    let units =
        |settings: &Settings| settings.routes.iter().map(|route| route.units.first).collect::<Vec<_>>();
    assert_eq!(units(&settings), [8, 2, 3, 1]);
    apply_all(&mut settings, &["move route 4 1"]);
    assert_eq!(units(&settings), [1, 8, 2, 3]);
    apply_all(&mut settings, &["delete routes"]);
    assert!(settings.routes.is_empty());
}

#[test]
fn full_tables_refuse_one_more() {
    let mut settings = Settings::new();
    for n in 0..PORTS_MAX {
        apply(&mut settings, &format!("port P{n} serial uart{n} rtu client")).unwrap();
    }
    let error = apply(&mut settings, "port Q tcp server 1").unwrap_err();
    assert_eq!(error.problem, Problem::PortsFull);
    apply(&mut settings, "port P0 tcp server 1").unwrap();
    for n in 0..ROUTES_MAX {
        apply(&mut settings, &format!("route P0 {n} * * P1")).unwrap();
    }
    let error = apply(&mut settings, "route P0 100 * * P1").unwrap_err();
    assert_eq!(error.problem, Problem::RoutesFull);
}

#[test]
fn a_gap_below_the_specification_draws_a_warning() {
    let mut settings = Settings::new();
    let applied = apply(&mut settings, "port A serial uart1 rtu client 9600 gap 0").unwrap();
    let warning = applied.warning.map(|warning| warning.to_string());
    assert_eq!(warning.as_deref(), Some("port A: gap 0 is below the specification's 4.011ms"));
    let applied = apply(&mut settings, "edit port A gap 5ms").unwrap();
    assert_eq!(applied, Applied { changed: true, warning: None });
    let applied = apply(&mut settings, "# only a comment").unwrap();
    assert_eq!(applied, Applied { changed: false, warning: None });
}

/// Other images have none.
#[cfg(feature = "web")]
#[test]
fn a_web_interface_that_nobody_can_log_in_to_draws_a_warning() {
    let mut settings = Settings::new();
    let mut warning = |line: &str| apply(&mut settings, line).unwrap().warning;
    assert!(matches!(warning("port web http server 80"), Some(Warning::NobodyLogsIn { .. })));
    let hash =
        "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";
    warning(&format!("user anna role engineer password \"{hash}\""));
    assert_eq!(warning("edit port web cleartext"), None);
}

/// Other images have no web interface.
#[cfg(feature = "web")]
#[test]
fn a_web_interface_is_a_port_and_there_is_one() {
    let line = "port web http server 127.0.0.1:80 allow 10.0.0.0/8 cleartext";
    let mut settings = load(line);
    assert_eq!(print(&settings), format!("{line}\n"));
    apply_all(&mut settings, &["edit port web no-cleartext allow * listen 8080"]);
    assert_eq!(print(&settings), "port web http server 8080\n");
    let words = if TLS {
        "\"broadcast\": expected listen, allow, cleartext, metrics, tls, certificate or trust"
    } else {
        "\"broadcast\": expected listen, allow, cleartext or metrics"
    };
    for (line, expected) in [
        ("port web http client 80", "\"client\": expected server"),
        ("port web http server", "end of line: expected a TCP port"),
        ("edit port web broadcast off", words),
        ("port other http server 81", "\"81\": there is an http server already"),
        ("port P8080 tcp server 8080", "\"8080\": another port listens there"),
    ] {
        let error = apply(&mut settings, line).unwrap_err().to_string();
        assert!(error.contains(expected), "{line}\n gives    {error}");
    }
}
