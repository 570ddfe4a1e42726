//! `explain` against what the router decides, for random rules and requests; which rule decides is searched here by itself.

use std::fmt::Write as _;
use std::net::Ipv4Addr;

use mobgate::routing::{Client, Decision, decide};

use crate::prelude::*;

const PORTS: &str = "port bus serial uart1 rtu client 19200 8E1
port line serial uart2 rtu server 19200 8E1
port net tcp client 10.0.1.1:502
port P502 tcp server 502
";
const SOURCES: [&str; 2] = ["P502", "line"];
const PEERS: [(&str, u32, u32); 4] = [
    ("*", 0, 0),
    ("10.0.0.0/8", 0x0a00_0000, 0xff00_0000),
    ("10.1.0.0/16", 0x0a01_0000, 0xffff_0000),
    ("10.1.2.3", 0x0a01_0203, u32::MAX),
];
const TAGS: [&str; 3] = ["*", "=17", "=255"];
const DESTINATIONS: [&str; 5] = ["bus", "net", "local", "discard", "nopath"];
const POLICIES: [&str; 6] =
    ["", "readonly", "addresses 0-99", "functions 3,6", "writes 10-19", "readonly forbidden ignore"];
/// Tables of rules, and requests for each: 100 000 in all.
const TABLES: u64 = 400;
const REQUESTS: usize = 250;

/// A rule, as far as it tells whether it matches.
struct Rule {
    source: usize,
    units: (u8, u8),
    peer: usize,
}

impl Rule {
    fn random(random: &mut Random, lines: &mut String) -> Self {
        let (one, other) = (random.byte(), random.byte());
        let units = (one.min(other), one.max(other));
        let source = random.index(SOURCES.len());
        // A serial master has no address.
        let peer = if source == 0 { random.index(PEERS.len()) } else { 0 };
        let mut word = |words: &[&'static str]| words[random.index(words.len())];
        let (tag, destination, policy) = (word(&TAGS), word(&DESTINATIONS), word(&POLICIES));
        let (from, to) = units;
        let (name, ip) = (SOURCES[source], PEERS[peer].0);
        writeln!(lines, "route {name} {from}-{to} {ip} {tag} {destination} {policy}").unwrap();
        Self { source, units, peer }
    }

    fn matches(&self, source: usize, unit: u8, peer: Option<Ipv4Addr>) -> bool {
        let (_, prefix, mask) = PEERS[self.peer];
        let is_peer = mask == 0 || peer.is_some_and(|peer| u32::from(peer) & mask == prefix);
        self.source == source && (self.units.0..=self.units.1).contains(&unit) && is_peer
    }
}

/// A request by the letter of the specification.
fn pdu(function: u8, address: u16, count: u16) -> Vec<u8> {
    let mut pdu = [&[function][..], &address.to_be_bytes()].concat();
    let cells = usize::from(count);
    match function {
        5 | 6 => pdu.extend([0, 0]),
        15 => pdu.extend(
            [&count.to_be_bytes()[..], &[cells.div_ceil(8) as u8], &vec![0; cells.div_ceil(8)]].concat(),
        ),
        16 => pdu.extend([&count.to_be_bytes()[..], &[2 * cells as u8], &vec![0; 2 * cells]].concat()),
        _ => pdu.extend(count.to_be_bytes()),
    }
    pdu
}

/// What `explain` should say.
fn told(decision: Decision, rule: Option<usize>, settings: &Settings) -> String {
    let what = match decision {
        Decision::NoRule => {
            return "no rule is for it: 0A to a TCP client, silence on a serial line".to_owned();
        }
        Decision::Forward { port, unit, .. } => format!("to {} as unit {unit}", settings.name(port)),
        Decision::Local => "to the gateway's own unit".to_owned(),
        Decision::Discard => "discarded, without a response".to_owned(),
        Decision::Refuse(exception) => format!("refused, {exception}"),
        Decision::Ignore { .. } => "confirmed, but not executed".to_owned(),
        Decision::AllLines => "to all lines that rules lead to".to_owned(),
    };
    format!("rule {}: {what}", rule.expect("a rule decides") + 1)
}

#[test]
fn explain_says_what_the_router_decides_and_by_which_rule() {
    let mut random = Random::new(20);
    for table in 0..TABLES {
        let mut lines = PORTS.to_owned();
        let rules: Vec<Rule> = (0..random.index(12)).map(|_| Rule::random(&mut random, &mut lines)).collect();
        let settings = settings_of(&lines);
        let (mut typing, mut expected) = (String::new(), Vec::new());
        for _ in 0..REQUESTS {
            let (source, unit) = (random.index(SOURCES.len()), random.byte());
            let function = [1, 2, 3, 4, 5, 6, 15, 16][random.index(8)];
            let (address, count) = (random.within(0..=150) as u16, random.within(1..=20) as u16);
            let peer = (source == 0)
                .then(|| Ipv4Addr::new(10, random.index(2) as u8, 2, random.within(2..=4) as u8));
            let port = settings.find(SOURCES[source]).unwrap();
            let ip = peer.map(IpAddr::V4);
            let decision = decide(&settings, port, unit, Client::at(ip), &pdu(function, address, count));
            let rule = rules.iter().position(|rule| rule.matches(source, unit, peer));
            expected.push(told(decision, rule, &settings));
            let from = peer.map_or(String::new(), |peer| format!(" from {peer}"));
            let name = SOURCES[source];
            writeln!(typing, "explain {name} {unit} {function} {address} {count}{from}").unwrap();
        }
        let printed =
            rig::with_gateway(table, &lines, |world, rig| world.run_until(typed(rig.gateway, &typing)));
        for ((line, request), expected) in printed.lines().zip(typing.lines()).zip(&expected) {
            assert_eq!(line, expected, "{request}\n{lines}");
        }
        assert_eq!(printed.lines().count(), REQUESTS, "{printed}");
    }
}

#[test]
fn explain_takes_the_role_of_a_clients_certificate() {
    let lines = "certificate gw own /gw.pem key /gw.key
        certificate plant clients /plant.pem
        port secure tcp server 802 tls
        port bus serial uart1 rtu client
        route secure 1 * * bus role operator";
    let typing = "explain secure 1 6 role operator\nexplain secure 1 6 role viewer\nexplain secure 1 6\n\
                  explain secure 2 6 role operator\n";
    let printed = rig::with_gateway(1, lines, |world, rig| world.run_until(typed(rig.gateway, typing)));
    let denied = "no rule is for its role: refused, illegal function (01h)";
    let expected = ["rule 1: to bus as unit 1", denied, denied, "no rule is for it"];
    assert_eq!(printed.lines().count(), expected.len(), "{printed}");
    for (line, expected) in printed.lines().zip(expected) {
        assert!(line.starts_with(expected), "{printed}");
    }
}
