//! Which rule decides, under which id a unit is asked, and where a frame may be passed on while it arrives: by value.

use mobgate::modbus::pdu::{Extent, Touched, touched};
use mobgate::routing::{Client, Decision, Onward, decide, is_routed, leads_to, onward};
use mobgate::settings::{AddressRange, Functions, Policy, Tag, UnitRange};

use crate::prelude::*;

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const WRITE: [u8; 5] = [6, 0, 0, 0, 1];

fn port(settings: &Settings, name: &str) -> PortId {
    settings.find(name).unwrap_or_else(|| panic!("{name}"))
}

#[test]
fn a_changed_id_is_that_of_one_unit_or_of_the_tcp_device_itself() {
    for unit in 0..=255_u8 {
        let is_one = |id: i32| u8::try_from(id).ok().filter(|id| matches!(id, 1..=247 | 255));
        assert_eq!(Tag::Keep.apply(unit), Some(unit));
        for by in [0, 1, 8, 100, 255_u8] {
            assert_eq!(Tag::Add(by).apply(unit), is_one(i32::from(unit) + i32::from(by)), "{unit} + {by}");
            let less = Tag::Subtract(by).apply(unit);
            assert_eq!(less, is_one(i32::from(unit) - i32::from(by)), "{unit} - {by}");
        }
        assert_eq!(Tag::Set(unit).apply(9), is_one(unit.into()), "{unit}");
        let is_in = |first, last| UnitRange { first, last }.contains(unit);
        assert_eq!((is_in(7, 9), is_in(7, 7)), ((7..=9).contains(&unit), unit == 7), "{unit}");
        assert!(UnitRange::ALL.contains(unit));
    }
}

#[test]
fn a_set_of_functions_has_what_was_added_and_no_more() {
    let codes = |set: &Functions| (0..=255).filter(|&code| set.contains(code)).collect::<Vec<u8>>();
    assert_eq!(codes(&Functions::ALL), (1..=127).collect::<Vec<u8>>());
    assert!(codes(&Functions::NONE).is_empty());
    assert_eq!(codes(&Functions::READ_ONLY), [1, 2, 3, 4, 7, 11, 12, 17, 20, 24]);
    for function in 1..=127 {
        let set = Functions::NONE.with(function);
        assert_eq!(codes(&set), [function]);
        assert!(!set.contains_identification());
        assert!(set.admit(&[function, 14]) && !set.admit(&[]) && !set.admit(&[function ^ 1, 14]));
        // The identification is besides, unless all of 43 is there, in whichever order they are named.
        let both = set.with_identification();
        assert_eq!(both.contains_identification(), function != 43);
        assert_eq!(codes(&both), [function]);
        assert!(both.admit(&[43, 14, 1, 0]));
        assert_eq!(both.admit(&[43, 13, 1, 0]), function == 43);
        assert_eq!(Functions::NONE.with_identification().with(function), both);
    }
    assert!(!Functions::ALL.contains_identification() && Functions::READ_ONLY.contains_identification());
    assert_eq!(Functions::ALL.with(43).with_identification(), Functions::ALL);
    assert!(!Functions::ALL.admit(&[0]) && !Functions::ALL.admit(&[0x83]));
}

#[test]
fn a_range_has_its_first_and_last_address_and_only_that_of_all_what_runs_over_the_end() {
    let ten = AddressRange { first: 10, last: 19 };
    let has = |range: &AddressRange, first, last| range.contains(&Extent { write: false, first, last });
    for (first, last, expected) in
        [(10, 19, true), (9, 19, false), (10, 20, false), (10, 10, true), (19, 19, true)]
    {
        assert_eq!(has(&ten, first, last), expected, "{first} {last}");
    }
    let upper = AddressRange { first: 1, last: u16::MAX };
    assert!(has(&upper, 1, 65_535) && !has(&upper, 65_535, 65_536) && !has(&upper, 0, 1));
    assert!(has(&AddressRange::ALL, 65_535, 65_536));
    let lower = AddressRange { first: 0, last: u16::MAX - 1 };
    assert!(has(&lower, 0, 65_534) && !has(&lower, 65_535, 65_535));
}

#[test]
fn a_request_of_which_nothing_has_come_passes_where_all_rank_alike() {
    let rank = |policy: Policy, request: &[u8]| policy.admit(request).ok();
    let low = Policy { priority: Priority::Low, ..Policy::default() };
    assert_eq!(rank(low, &[]), Some(Priority::Low));
    assert_eq!(rank(Policy { urgent: Functions::NONE.with(6), ..low }, &[]), None);
    assert_eq!(rank(Policy { functions: Functions::READ_ONLY, ..low }, &[]), None);
    assert_eq!(rank(Policy { addresses: AddressRange { first: 0, last: 9 }, ..low }, &[]), None);
    assert_eq!(rank(Policy { writes: AddressRange { first: 0, last: 9 }, ..low }, &[]), None);
    assert_eq!(rank(Policy { urgent: Functions::NONE.with(6), ..low }, &WRITE), Some(Priority::High));
    // Restrictions of what is written do not hold for what is read, nor for what has no address.
    let some_writes = Policy { writes: AddressRange { first: 5, last: 9 }, ..low };
    assert_eq!((rank(some_writes, &READ), rank(some_writes, &WRITE)), (Some(Priority::Low), None));
    assert_eq!(some_writes.admit(&WRITE), Err(Exception::ILLEGAL_ADDRESS));
    assert_eq!(some_writes.admit(&[65]), Err(Exception::ILLEGAL_FUNCTION));
}

#[test]
fn what_a_request_touches_is_told_with_its_last_byte_that_matters() {
    let cells = |first, last, write| Touched::Cells([Some(Extent { write, first, last }), None]);
    for function in 0..=255_u8 {
        let request = [function, 0x01, 0x02, 0x00, 0x03, 0x04, 0x05, 0x00, 0x02, 4, 0, 0, 0, 0];
        let (told_by, expected) = match function {
            1..=4 => (5, cells(0x102, 0x104, false)),
            5 | 6 | 22 => (3, cells(0x102, 0x102, true)),
            15 | 16 => (5, cells(0x102, 0x104, true)),
            23 => {
                let read = Extent { write: false, first: 0x102, last: 0x104 };
                let written = Extent { write: true, first: 0x405, last: 0x406 };
                (9, Touched::Cells([Some(read), Some(written)]))
            }
            24 => (3, cells(0x102, 0x102 + 31, false)),
            7 | 11 | 12 | 17 | 20 => (1, Touched::Other),
            _ => (0, Touched::Unknown),
        };
        for end in 0..=request.len() {
            let expected = if end < told_by { Touched::Unknown } else { expected };
            assert_eq!(touched(&request[..end]), expected, "{function} {end}");
        }
    }
    assert_eq!(touched(&[43, 14]), Touched::Other);
    assert_eq!(touched(&[3, 0xff, 0xff, 0, 2]), cells(65_535, 65_536, false));
    assert_eq!(touched(&[3, 0, 7, 0, 0]), cells(7, 7, false), "none at all is judged like one");
}

const TABLE: &str = "port plc serial uart2 rtu server
    port bus serial uart1 rtu client
    port C tcp client 10.0.0.1:502
    port P502 tcp server 502
    route plc 1-9 * * bus
    route plc 10 * * C
    route plc 11 * * discard
    route plc 12 * * nopath
    route plc 13 * * local
    route plc 248-255 * * bus
    route bus 20 * * plc
    route plc 21 * * P502";

#[test]
fn a_unit_is_ours_on_a_line_when_a_rule_or_its_port_says_so() {
    let routed = |words: &str| {
        let settings = settings_of(&TABLE.replace("rtu server", &format!("rtu server{words}")));
        (0..=255).filter(|&unit| is_routed(&settings, PortId(0), unit)).collect::<Vec<u8>>()
    };
    let plain: Vec<u8> = (1..=13).chain(248..=255).collect();
    let and_0 = |units: &[u8]| [&[0], units].concat();
    assert_eq!(routed(""), plain);
    assert_eq!(routed(" broadcast local"), and_0(&plain));
    assert_eq!(routed(" broadcast all"), and_0(&plain));
    assert_eq!(routed(" broadcast off"), plain);
    assert_eq!(routed(" broadcast replace 5"), and_0(&plain));
    assert_eq!(routed(" broadcast replace 77"), plain);
    assert_eq!(routed(" unit-255 off"), plain[..plain.len() - 1]);
    assert_eq!(routed(" reserved-units off"), [&plain[..13], &[255]].concat());
}

#[test]
fn each_destination_has_its_decision() {
    let settings = settings_of(TABLE);
    let decision = |unit, request: &[u8]| decide(&settings, PortId(0), unit, Client::at(None), request);
    let forward = |name, unit| {
        let Decision::Forward { port: to, unit: asked, priority, .. } = decision(unit, &READ) else {
            return false;
        };
        (to, asked, priority) == (port(&settings, name), unit, Priority::Normal)
    };
    assert!(forward("bus", 1) && forward("bus", 9) && forward("C", 10) && forward("bus", 255));
    assert_eq!(decision(11, &READ), Decision::Discard);
    assert_eq!(decision(12, &READ), Decision::Refuse(Exception::GATEWAY_NO_PATH));
    assert_eq!(decision(13, &READ), Decision::Local);
    assert_eq!(decision(14, &READ), Decision::NoRule);
    assert_eq!(decision(0, &READ), Decision::NoRule);
    assert_eq!(decision(21, &READ), Decision::NoRule, "a way back matches nothing");
}

#[test]
fn what_is_asked_of_all_units_of_a_line_must_be_a_write_and_of_unit_0_behind_tcp_may_be_anything() {
    let settings = settings_of(
        "port P502 tcp server 502
        port bus serial uart1 rtu client
        port C tcp client 10.0.0.1:502
        route P502 0 10.0.0.1 * bus
        route P502 0 * * C",
    );
    let decision = |peer: &str, request: &[u8]| {
        decide(&settings, PortId(0), 0, Client::at(Some(peer.parse::<IpAddr>().unwrap())), request)
    };
    assert_eq!(decision("10.0.0.1", &READ), Decision::Refuse(Exception::ILLEGAL_FUNCTION));
    assert!(matches!(decision("10.0.0.1", &WRITE), Decision::Forward { unit: 0, .. }));
    assert!(matches!(decision("10.0.0.2", &READ), Decision::Forward { unit: 0, .. }));
}

#[test]
fn a_write_that_is_ignored_is_answered_except_to_all_units_of_a_line() {
    let settings = settings_of(
        "port P502 tcp server 502
        port bus serial uart1 rtu client
        port C tcp client 10.0.0.1:502
        route P502 0-9 10.0.0.1 * bus readonly forbidden ignore
        route P502 0-9 10.0.0.2 * C readonly forbidden ignore
        route P502 0-9 10.0.0.3 * bus readonly
        route P502 0-9 * * local readonly forbidden ignore",
    );
    let decision = |peer: u8, unit, request: &[u8]| {
        decide(&settings, PortId(0), unit, Client::at(Some(IpAddr::from([10, 0, 0, peer]))), request)
    };
    for function in 1..=127 {
        let request = [function, 0, 0, 0, 1];
        let expected = match function {
            5 | 6 | 15 | 16 => Some(Decision::Ignore { broadcast: false }),
            1..=4 | 7 | 11 | 12 | 17 | 20 | 24 => None,
            _ => Some(Decision::Refuse(Exception::ILLEGAL_FUNCTION)),
        };
        let decided = decision(1, 5, &request);
        assert_eq!(Some(decided).filter(|decided| !matches!(decided, Decision::Forward { .. })), expected);
    }
    assert_eq!(decision(1, 0, &WRITE), Decision::Ignore { broadcast: true });
    assert_eq!(decision(2, 0, &WRITE), Decision::Ignore { broadcast: false });
    assert_eq!(decision(4, 0, &WRITE), Decision::Ignore { broadcast: false });
    assert_eq!(decision(3, 5, &WRITE), Decision::Refuse(Exception::ILLEGAL_FUNCTION));
    assert_eq!(decision(3, 0, &WRITE), Decision::Refuse(Exception::ILLEGAL_FUNCTION));
}

/// What becomes of what has come of a request for `unit` at the port `plc`.
fn passed_on(settings: &Settings, unit: u8, so_far: &[u8], auto: bool) -> &'static str {
    match onward(settings, port(settings, "plc"), unit, so_far, auto) {
        Onward::Whole => "whole",
        Onward::Later => "later",
        Onward::To(_) => "to",
    }
}

#[test]
fn a_rule_judges_a_frame_with_the_byte_that_tells_all_it_asks_for() {
    let settings = settings_of(
        "port plc serial uart2 rtu server
        port bus serial uart1 rtu client
        route plc 1 * * bus cut on
        route plc 2 * * bus cut on urgent 6
        route plc 3 * * bus cut on functions 1-127
        route plc 4 * * bus cut on addresses 0-9999
        route plc 5 * * bus cut on writes 0-9999",
    );
    for function in 1..=127_u8 {
        let request = [function, 0, 1, 0, 2, 0, 3, 0, 4, 8, 0, 0];
        let by_address = match function {
            1..=6 | 15 | 16 | 22 => Some(5),
            23 => Some(9),
            43 => Some(2),
            _ => None,
        };
        let by_function = if function == 43 { 2 } else { 1 };
        for end in 0..=request.len() {
            let expected = |told: usize| if end < told { "later" } else { "to" };
            let judged = |unit| passed_on(&settings, unit, &request[..end], false);
            assert_eq!(judged(1), "to");
            assert_eq!(judged(2), expected(by_function), "{function} {end}");
            for unit in [4, 5] {
                let expected = match (by_address, end) {
                    (_, 0) => "later",
                    (Some(told), _) if end < told => "later",
                    (Some(_), _) if function != 43 => "to",
                    _ => "whole",
                };
                assert_eq!(judged(unit), expected, "{function} {end}");
            }
        }
    }
}

#[test]
fn frames_are_passed_on_between_lines_that_allow_it_to_one_unit() {
    let at = |plc: &str, bus: &str, rule: &str, unit, auto| {
        let settings = settings_of(&format!(
            "port plc serial uart2 rtu server{plc}
            port bus serial uart1 rtu client{bus}
            port C tcp client 10.0.0.1:502
            {rule}"
        ));
        passed_on(&settings, unit, &READ, auto)
    };
    for (plc, bus, rule, unit, auto, expected) in [
        ("", "", "route plc 0-9 * * bus", 1, true, "to"),
        ("", "", "route plc 0-9 * * bus", 1, false, "whole"),
        ("", "", "route plc 0-9 * * bus cut on", 1, false, "to"),
        ("", "", "route plc 0-9 * * bus cut off", 1, true, "whole"),
        ("", "", "route plc 0-9 * * bus", 0, true, "whole"),
        ("", "", "route plc 1-9 * +100 bus", 1, true, "to"),
        ("", "", "route plc 0-9 * * bus", 10, true, "whole"),
        ("", "", "route plc 0-9 * * C", 1, true, "whole"),
        ("", "", "route plc 0-9 * * local", 1, true, "whole"),
        ("", "", "route plc 0-9 * * bus functions 6", 1, true, "whole"),
        (" echo", "", "route plc 0-9 * * bus", 1, true, "whole"),
        ("", " echo", "route plc 0-9 * * bus", 1, true, "whole"),
        (" rts", "", "route plc 0-9 * * bus", 1, true, "whole"),
        ("", " rts", "route plc 0-9 * * bus", 1, true, "whole"),
        (" broadcast replace 5", "", "route plc 1-9 * * bus", 0, true, "to"),
        (" broadcast off", "", "route plc 0-9 * * bus", 0, true, "whole"),
        (" unit-255 off", "", "route plc 255 * * bus", 255, true, "whole"),
        (" unit-255 local", "", "route plc 255 * * bus", 255, true, "whole"),
        ("", "", "route plc 255 * * bus", 255, true, "to"),
    ] {
        assert_eq!(at(plc, bus, rule, unit, auto), expected, "{plc:?} {bus:?} {rule:?} {unit} {auto}");
    }
    let settings = settings_of(TABLE);
    assert!(matches!(onward(&settings, port(&settings, "P502"), 1, &READ, true), Onward::Whole));
    assert!(matches!(onward(&settings, port(&settings, "bus"), 20, &READ, true), Onward::Whole));
}

#[test]
fn a_broadcast_goes_to_the_lines_that_rules_for_its_sender_lead_to_unless_one_of_them_refuses_it() {
    let head = "port P502 tcp server 502 broadcast all
        port Q502 tcp server 503
        port bus serial uart1 rtu client
        port C tcp client 10.0.0.1:502
        port plc serial uart2 rtu server";
    let rank = |rules: &str, to: &str| {
        let settings = settings_of(&format!("{head}\n{rules}"));
        let peer = Some(IpAddr::from([10, 0, 0, 1]));
        leads_to(&settings, PortId(0), Client::at(peer), &WRITE, port(&settings, to))
    };
    let normal = Some(Priority::Normal);
    for (rules, to, expected) in [
        ("route P502 5 * * bus", "bus", normal),
        ("route P502 5 * * bus priority low", "bus", Some(Priority::Low)),
        ("route P502 5 * * bus urgent 6", "bus", Some(Priority::High)),
        ("route P502 5 10.0.0.1 * bus", "bus", normal),
        ("route P502 5 10.0.0.2 * bus", "bus", None),
        ("route Q502 5 * * bus", "bus", None),
        ("route P502 5 * * C", "bus", None),
        // No line.
        ("route P502 5 * * C", "C", None),
        ("route P502 5 * * plc", "plc", None),
        ("route P502 5 * * bus readonly", "bus", None),
        ("route P502 5 * * bus\nroute P502 6 * * bus readonly", "bus", None),
        ("route P502 5 * * bus readonly\nroute P502 6 * * bus", "bus", None),
        ("route P502 5 * * bus priority low\nroute P502 6 * * bus", "bus", Some(Priority::Low)),
        // Rules above that take all its units: it never decides.
        ("route P502 5 * * C\nroute P502 5 * * bus", "bus", None),
        ("route P502 5 * * C\nroute P502 5-6 * * bus", "bus", normal),
        ("route P502 4 * * C\nroute P502 5 * * bus", "bus", normal),
        ("route P502 5-8 * * C\nroute P502 9-12 * * C\nroute P502 6-11 * * bus", "bus", None),
        ("route P502 5-8 * * C\nroute P502 10-12 * * C\nroute P502 6-11 * * bus", "bus", normal),
        ("route P502 5-9 * * C\nroute P502 5-10 * * bus", "bus", normal),
        ("route P502 6-10 * * C\nroute P502 5-10 * * bus", "bus", normal),
        ("route P502 5 10.0.0.2 * C\nroute P502 5 * * bus", "bus", normal),
        ("route P502 5 10.0.0.1 * C\nroute P502 5 * * bus", "bus", None),
        ("route Q502 5 * * C\nroute P502 5 * * bus", "bus", normal),
        ("route P502 5 * * plc\nroute P502 5 * * bus", "bus", normal),
        // Unit 0 is none of those that rules are asked for here.
        ("route P502 0 * * bus", "bus", None),
        ("route P502 1-5 * * C\nroute P502 0-5 * * bus", "bus", None),
        ("route P502 * * * C\nroute P502 * * * bus", "bus", None),
    ] {
        assert_eq!(rank(rules, to), expected, "{rules}");
    }
}
