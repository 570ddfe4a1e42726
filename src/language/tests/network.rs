//! The board's own network, and how it is found there.

use super::*;

#[test]
fn the_boards_own_address_is_given_by_dhcp_or_set() {
    let mut settings = load(PORTS);
    assert_eq!(settings.own_network(), OwnNetwork::DEFAULT);
    assert!(!print(&settings).contains("network"), "what was not said is not printed");
    for line in [
        "network dhcp",
        "network dhcp name cabinet-7",
        "network address 192.168.1.5/24",
        "network address 10.200.0.9/8 gateway 10.0.0.1",
        #[cfg(feature = "servers")] // Nobody asks for names without.
        "network address 10.200.0.9/8 gateway 10.0.0.1 dns 10.0.0.2",
    ] {
        apply(&mut settings, line).unwrap();
        assert!(print(&settings).starts_with(&format!("{line}\n")));
        assert_eq!(load(&print(&settings)), settings);
    }
    apply(&mut settings, "network dhcp").unwrap();
    assert_eq!(settings.own_network(), OwnNetwork::DEFAULT);
}

#[test]
fn the_gateway_is_found_by_its_name_or_not_at_all() {
    let mut settings = load(PORTS);
    assert_eq!(settings.mdns_name("host"), Some("host"));
    assert!(!print(&settings).contains("mdns"), "what is so by default is not printed");
    for (line, name) in [("mdns off", None), ("mdns on name cabinet-7", Some("cabinet-7"))] {
        apply(&mut settings, line).unwrap();
        assert_eq!(settings.mdns_name("host"), name);
        assert!(print(&settings).starts_with(&format!("{line}\n")));
        assert_eq!(load(&print(&settings)), settings);
    }
    apply(&mut settings, "mdns on").unwrap();
    apply(&mut settings, "network dhcp name cabinet-8").unwrap();
    assert_eq!(settings.mdns_name("host"), Some("cabinet-8"), "as the DHCP server knows it");
    apply(&mut settings, "mdns on name cabinet-7").unwrap();
    assert_eq!(settings.mdns_name("host"), Some("cabinet-7"));
    assert!(print(&settings).starts_with("network dhcp name cabinet-8\nmdns on name cabinet-7\n"));
    for (line, expected) in [
        ("mdns", "column 5: end of line: expected on or off"),
        ("mdns no", "\"no\": expected on or off"),
        ("mdns on cabinet-7", "\"cabinet-7\": expected name"),
        ("mdns on name cabinet_7", "\"cabinet_7\": expected a host name"),
        ("mdns off name x", "\"name\": expected the end of the line"),
    ] {
        assert!(error(line).contains(expected), "{line}: {}", error(line));
    }
}

#[test]
fn the_servers_that_are_found_are_those_of_modbus_tcp_at_that_address() {
    let mut settings = Settings::new();
    for line in [
        "port all tcp server 502",
        "port any tcp server 0.0.0.0:503",
        "port here tcp server 10.0.0.1:504",
        "port there tcp server 10.0.0.2:505",
        "port self tcp server 127.0.0.1:506",
        "port six tcp server [::1]:507",
        "port rtu tcp server 508 rtu",
        "port wire tcp server 509 capture",
        "port udp udp server 502",
        "port out tcp client 10.0.0.9:510",
    ] {
        apply(&mut settings, line).unwrap();
    }
    let found: Vec<_> = settings.modbus_servers([10, 0, 0, 1].into()).collect();
    assert_eq!(found, [("all", 502), ("any", 503), ("here", 504)]);
}

#[test]
fn an_address_that_no_host_can_have_is_refused() {
    let cases = [
        ("network", "column 8: end of line: expected dhcp or address"),
        ("network static", "\"static\": expected dhcp or address"),
        ("network dhcp nmae x", "\"nmae\": expected name; did you mean name?"),
        ("network dhcp name", "end of line: expected a host name"),
        ("network dhcp name -x", "expected a host name"),
        ("network dhcp name x y", "\"y\": expected the end of the line"),
        ("network address 192.168.1.5", "expected an address of a host and its prefix"),
        ("network address 192.168.1.0/24", "expected an address of a host"),
        ("network address 192.168.1.255/24", "expected an address of a host"),
        ("network address 224.0.0.1/24", "expected an address of a host"),
        ("network address 127.0.0.1/8", "expected an address of a host"),
        ("network address 0.0.0.1/8", "expected an address of a host"),
        ("network address 10.0.0.1/31", "expected an address of a host"),
        ("network address 10.0.0.1/0", "expected an address of a host"),
        ("network address 10.0.0.1/24 gateway", "end of line: expected the gateway's address"),
        (
            "network address 10.0.0.1/24 gateway 10.0.1.1",
            "\"10.0.1.1\": is not another host of the same network",
        ),
        ("network address 10.0.0.1/24 gateway 10.0.0.1", "is not another host of the same network"),
        ("network address 10.0.0.1/24 gateway 10.0.0.0", "is not another host of the same network"),
    ];
    for (line, expected) in cases {
        assert!(error(line).contains(expected), "{line}: {}", error(line));
    }
}

#[cfg(feature = "audit")] // Without a trail there are no such lines.
#[test]
fn syslog_and_ntp_servers_are_one_each_at_their_usual_ports() {
    let mut settings = load(PORTS);
    for (line, printed) in [
        ("syslog 192.168.1.9", "syslog udp 192.168.1.9:514"),
        ("syslog tcp 192.168.1.9:601", "syslog tcp 192.168.1.9:601"),
        ("ntp 192.168.1.1", "ntp 192.168.1.1:123"),
        ("ntp 192.168.1.1:1123", "ntp 192.168.1.1:1123"),
        #[cfg(feature = "servers")]
        ("ntp time.example", "ntp time.example:123"),
    ] {
        apply(&mut settings, line).unwrap();
        assert!(print(&settings).contains(&format!("{printed}\n")), "{}", print(&settings));
        assert_eq!(load(&print(&settings)), settings);
    }
    assert_eq!(print(&settings).matches("ntp ").count(), 1);
    apply(&mut settings, "syslog off").unwrap();
    apply(&mut settings, "ntp off").unwrap();
    assert_eq!(print(&settings), print(&load(PORTS)));
    for line in ["ntp", "ntp 192.168.1.1:0", "ntp 0.0.0.0", "ntp 192.168.1.1 192.168.1.2", "ntp off on"] {
        assert!(apply(&mut settings, line).is_err(), "{line}");
    }
}
