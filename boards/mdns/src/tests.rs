//! What is said, read by somebody else's DNS.

extern crate std;

use std::net::Ipv4Addr;
use std::string::String;
use std::vec::Vec;
use std::{format, vec};

use embassy_time::Instant;
use mobgate::language::apply;
use mobgate::settings::Settings;
use proptest::prelude::*;
use simple_dns::rdata::RData;
use simple_dns::{CLASS, Name, Packet, PacketFlag, QCLASS, QTYPE, Question, ResourceRecord, TYPE};

use super::{Gateway, PORT, Rate, Said, announcement, answer, farewell};

const ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 1, 5);
const SERVICES: &str = "_modbus._tcp.local";

fn settings(lines: &[&str]) -> Settings {
    let mut settings = Settings::new();
    lines.iter().for_each(|line| _ = apply(&mut settings, line).unwrap());
    settings
}

fn gateway(settings: &Settings) -> Gateway<'_> {
    Gateway { settings, own_name: "mobgate-0a1b2c", host: None, address: ADDRESS }
}

fn query(id: u16, name: &str, kind: TYPE) -> Vec<u8> {
    let mut packet = Packet::new_query(id);
    let question =
        Question::new(Name::new_unchecked(name), QTYPE::TYPE(kind), QCLASS::CLASS(CLASS::IN), false);
    packet.questions.push(question);
    packet.build_bytes_vec().unwrap()
}

fn query_of(name: &str, kind: QTYPE) -> Vec<u8> {
    let mut packet = Packet::new_query(0);
    packet.questions.push(Question::new(Name::new_unchecked(name), kind, QCLASS::CLASS(CLASS::IN), false));
    packet.build_bytes_vec().unwrap()
}

/// What a message says: name, time to live, data.
fn records(message: &[u8]) -> [Vec<String>; 2] {
    let packet = Packet::parse(message).unwrap();
    assert!(packet.has_flags(PacketFlag::RESPONSE | PacketFlag::AUTHORITATIVE_ANSWER));
    let text = |records: &[ResourceRecord]| {
        let data = |record: &ResourceRecord| match &record.rdata {
            RData::A(a) => format!("A {}", Ipv4Addr::from(a.address)),
            RData::PTR(ptr) => format!("PTR {}", ptr.0),
            RData::SRV(srv) => format!("SRV {} {} {} {}", srv.priority, srv.weight, srv.port, srv.target),
            RData::TXT(txt) => format!("TXT {:?}", txt.attributes()["product"]),
            other => panic!("{other:?}"),
        };
        records.iter().map(|record| format!("{} {} {}", record.name, record.ttl, data(record))).collect()
    };
    [text(&packet.answers), text(&packet.additional_records)]
}

/// What is said, if that is something.
fn said(gateway: Gateway<'_>, say: impl FnOnce(Gateway<'_>, &mut Said)) -> Option<Said> {
    // Of something that was said before.
    let mut said = Said::from_slice(b"before").unwrap();
    say(gateway, &mut said);
    Some(said).filter(|said| !said.is_empty())
}

fn response_to(gateway: Gateway<'_>, query: &[u8], from_port: u16) -> Option<Said> {
    said(gateway, |gateway, said| answer(gateway, query, from_port, said))
}

fn answered(settings: &Settings, query: &[u8]) -> Option<Said> {
    response_to(gateway(settings), query, PORT)
}

#[test]
fn who_looks_for_modbus_servers_finds_name_port_and_address() {
    let settings = settings(&["port P502 tcp server 502"]);
    let [answers, more] = records(&answered(&settings, &query(0, SERVICES, TYPE::PTR)).unwrap());
    assert_eq!(answers, ["_modbus._tcp.local 120 PTR mobgate-0a1b2c._modbus._tcp.local"]);
    assert!(
        more.contains(&"mobgate-0a1b2c._modbus._tcp.local 120 SRV 0 0 502 mobgate-0a1b2c.local".into()),
        "{more:?}"
    );
    assert!(more.contains(&"mobgate-0a1b2c._modbus._tcp.local 120 TXT Some(\"mobgate\")".into()), "{more:?}");
    assert!(more.contains(&"mobgate-0a1b2c.local 120 A 192.168.1.5".into()), "{more:?}");
}

#[test]
fn the_host_and_the_kinds_of_services_are_found_too() {
    let settings = settings(&["mdns on name cabinet-7", "port P502 tcp server 502"]);
    for kind in [QTYPE::TYPE(TYPE::A), QTYPE::ANY] {
        let [answers, more] = records(&answered(&settings, &query_of("CABINET-7.local", kind)).unwrap());
        assert_eq!(answers, ["cabinet-7.local 120 A 192.168.1.5"]);
        assert_eq!(more, [""; 0]);
    }
    assert_eq!(answered(&settings, &query(0, "cabinet-7.local", TYPE::AAAA)), None);
    let [answers, _] =
        records(&answered(&settings, &query(0, "_services._dns-sd._udp.local", TYPE::PTR)).unwrap());
    assert_eq!(answers, ["_services._dns-sd._udp.local 120 PTR _modbus._tcp.local"]);
    for other in ["cabinet-8.local", "_http._tcp.local", "local"] {
        assert_eq!(answered(&settings, &query(0, other, TYPE::PTR)), None, "{other}");
    }
}

#[test]
fn a_second_server_has_its_ports_name_and_a_host_may_have_another_one() {
    let settings = settings(&["port P502 tcp server 502", "port plant tcp server 1502"]);
    let gateway = Gateway { host: Some("pc-mobgate"), own_name: "pc", ..gateway(&settings) };
    let message = response_to(gateway, &query(0, SERVICES, TYPE::PTR), PORT).unwrap();
    let [answers, more] = records(&message);
    let pointers =
        ["pc", "pc plant"].map(|name| format!("_modbus._tcp.local 120 PTR {name}._modbus._tcp.local"));
    assert_eq!(answers, pointers);
    let is_address = |record: &&String| record.contains(" A ");
    assert_eq!(more.iter().filter(is_address).collect::<Vec<_>>(), ["pc-mobgate.local 120 A 192.168.1.5"]);
    assert!(
        more.contains(&"pc plant._modbus._tcp.local 120 SRV 0 0 1502 pc-mobgate.local".into()),
        "{more:?}"
    );
}

#[test]
fn who_asks_by_another_port_gets_the_id_and_the_question_back() {
    let settings = settings(&["port P502 tcp server 502"]);
    let asked = query(0x1234, SERVICES, TYPE::PTR);
    let message = response_to(gateway(&settings), &asked, 40_000).unwrap();
    let packet = Packet::parse(&message).unwrap();
    assert_eq!((packet.id(), packet.questions.len()), (0x1234, 1));
    let packet = answered(&settings, &asked).unwrap();
    let packet = Packet::parse(&packet).unwrap();
    assert_eq!((packet.id(), packet.questions.len()), (0, 0), "as RFC 6762, 6 and 18.1, say");
}

#[test]
fn what_is_announced_is_taken_back_with_no_time_to_live() {
    let settings = settings(&["port P502 tcp server 502"]);
    for (message, ttl) in
        [(said(gateway(&settings), announcement), 120), (said(gateway(&settings), farewell), 0)]
    {
        let [answers, _] = records(&message.unwrap());
        let pointer = format!("_modbus._tcp.local {ttl} PTR mobgate-0a1b2c._modbus._tcp.local");
        assert!(answers.contains(&pointer), "{answers:?}");
        assert!(answers.iter().all(|record| record.contains(&format!(" {ttl} "))), "{answers:?}");
    }
}

#[test]
fn a_gateway_that_is_off_or_has_no_server_there_says_nothing() {
    for lines in [
        vec!["mdns off", "port P502 tcp server 502"],
        vec!["port P502 tcp server 127.0.0.1:502"],
        vec!["port P502 tcp server 502 rtu"],
        vec![],
    ] {
        let settings = settings(&lines);
        assert_eq!(answered(&settings, &query(0, SERVICES, TYPE::PTR)), None, "{lines:?}");
        assert_eq!(said(gateway(&settings), announcement), None, "{lines:?}");
        assert_eq!(said(gateway(&settings), farewell), None, "{lines:?}");
    }
}

#[test]
fn servers_that_do_not_fit_are_left_out() {
    let lines: Vec<String> = (0..8).map(|n| format!("port n-{n}-of-eight tcp server {}", 502 + n)).collect();
    let name = format!("mdns on name {}", "n".repeat(32));
    let lines: Vec<&str> = [name.as_str()].into_iter().chain(lines.iter().map(String::as_str)).collect();
    let settings = settings(&lines);
    let [answers, _] = records(&answered(&settings, &query(0, SERVICES, TYPE::PTR)).unwrap());
    assert!(!answers.is_empty() && answers.len() < 8, "{answers:?}");
}

proptest! {
    /// Whatever comes, nothing panics, and what is said can be read.
    #[test]
    fn any_datagram_is_survived(
        mut query in prop_oneof![
            prop::collection::vec(any::<u8>(), 0..600),
            Just(query(7, SERVICES, TYPE::PTR)),
        ],
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        from_port in any::<u16>(),
    ) {
        for (at, byte) in changes {
            if !query.is_empty() {
                let at = at.index(query.len());
                query[at] = byte;
            }
        }
        let settings = settings(&["port P502 tcp server 502"]);
        response_to(gateway(&settings), &query, from_port);
        // Any other port has its question back, which may be none that can be read.
        if let Some(message) = answered(&settings, &query) {
            prop_assert!(Packet::parse(&message).is_ok());
        }
    }
}

#[test]
fn ten_are_answered_in_a_second_and_more_in_the_next() {
    let at = |ms| Instant::from_millis(5_000 + ms);
    let mut rate = Rate::new();
    let answered = |rate: &mut Rate, ms: core::ops::Range<u64>| ms.filter(|&ms| rate.admits(at(ms))).count();
    assert_eq!(answered(&mut rate, 0..1_000), 10);
    assert_eq!(answered(&mut rate, 1_000..1_009), 9);
    assert_eq!(answered(&mut rate, 1_009..2_000), 1);
}

#[test]
fn an_answer_is_no_question() {
    let settings = settings(&["port P502 tcp server 502"]);
    let message = said(gateway(&settings), announcement).unwrap();
    assert_eq!(answered(&settings, &message), None);
    assert_eq!(answered(&settings, b""), None);
    assert_eq!(answered(&settings, &query(0, SERVICES, TYPE::PTR)[..20]), None, "a part of one");
}
