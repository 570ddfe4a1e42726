//! What a rule lets through: for every function code, as the specification says what that one does.

use mobgate::modbus::pdu::check_request;
use mobgate::routing::{Client, Decision, Onward, decide, leads_to, onward};
use mobgate::settings::{AddressRange, ClientRole, Functions, Policy};

/// What a request does to a device (Application Protocol V1.1b3, clause 6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Does {
    /// Reads the cells from the first to the last of the first pair, and writes those of the second.
    Cells(Option<(u32, u32)>, Option<(u32, u32)>),
    /// Tells what no address names, and changes nothing.
    Tells,
    /// Something that the request does not say in terms of addresses, or may be a command.
    Anything,
}

use Does::{Anything, Cells, Tells};

use crate::prelude::*;

const fn reads(first: u32, last: u32) -> Does {
    Cells(Some((first, last)), None)
}

const fn writes(first: u32, last: u32) -> Does {
    Cells(None, Some((first, last)))
}

/// Requests of all public functions; cells 10 to 19 are those that the rules here allow.
const PUBLIC: &[(&[u8], Does)] = &[
    // 6.1 to 6.4: starting address, quantity.
    (&[1, 0, 10, 0, 10], reads(10, 19)),
    (&[1, 0, 10, 0, 11], reads(10, 20)),
    (&[2, 0, 9, 0, 1], reads(9, 9)),
    (&[2, 0, 19, 0, 1], reads(19, 19)),
    (&[3, 0, 10, 0, 10], reads(10, 19)),
    (&[3, 0, 19, 0, 2], reads(19, 20)),
    (&[3, 1, 10, 0, 1], reads(266, 266)),
    (&[4, 0, 10, 0, 1], reads(10, 10)),
    (&[4, 0, 9, 0, 11], reads(9, 19)),
    // Over the end of the addresses.
    (&[4, 0xff, 0xff, 0, 2], reads(65_535, 65_536)),
    // 6.5 and 6.6: address, value.
    (&[5, 0, 10, 0xff, 0], writes(10, 10)),
    (&[5, 0, 20, 0xff, 0], writes(20, 20)),
    (&[6, 0, 19, 0, 10], writes(19, 19)),
    (&[6, 0, 9, 0, 10], writes(9, 9)),
    // 6.7: eight outputs that the device chooses.
    (&[7], Tells),
    // 6.8: a loop back, a restart, a counter.
    (&[8, 0, 0, 0, 10], Anything),
    (&[8, 0, 1, 0, 0], Anything),
    (&[8, 0, 11, 0, 0], Anything),
    // 6.9, 6.10, 6.13.
    (&[11], Tells),
    (&[12], Tells),
    (&[17], Tells),
    // 6.11 and 6.12: starting address, quantity, byte count, values.
    (&[15, 0, 10, 0, 10, 2, 0, 0], writes(10, 19)),
    (&[15, 0, 10, 0, 11, 2, 0, 0], writes(10, 20)),
    (&[15, 0, 9, 0, 11, 2, 0, 0], writes(9, 19)),
    (&[15, 0, 19, 0, 1, 1, 0], writes(19, 19)),
    (&[16, 0, 19, 0, 1, 2, 0, 0], writes(19, 19)),
    (&[16, 0, 19, 0, 2, 4, 0, 0, 0, 0], writes(19, 20)),
    (&[16, 0, 9, 0, 2, 4, 0, 0, 0, 0], writes(9, 10)),
    (&[16, 0, 18, 0, 2, 4, 0, 0, 0, 0], writes(18, 19)),
    // 6.14 and 6.15: records of files, which have numbers of their own.
    (&[20, 7, 6, 0, 1, 0, 10, 0, 1], Tells),
    (&[21, 9, 6, 0, 1, 0, 10, 0, 1, 0, 0], Anything),
    // 6.16: reference address, masks.
    (&[22, 0, 19, 0, 0xf2, 0, 0x25], writes(19, 19)),
    (&[22, 0, 20, 0, 10, 0, 10], writes(20, 20)),
    // 6.17: read address, quantity; write address, quantity, byte count, values.
    (&[23, 0, 10, 0, 10, 0, 19, 0, 1, 2, 0, 0], Cells(Some((10, 19)), Some((19, 19)))),
    (&[23, 0, 10, 0, 11, 0, 19, 0, 1, 2, 0, 0], Cells(Some((10, 20)), Some((19, 19)))),
    (&[23, 0, 9, 0, 1, 0, 19, 0, 1, 2, 0, 0], Cells(Some((9, 9)), Some((19, 19)))),
    (&[23, 0, 10, 0, 1, 0, 9, 0, 1, 2, 0, 0], Cells(Some((10, 10)), Some((9, 9)))),
    (&[23, 0, 10, 0, 1, 0, 19, 0, 2, 4, 0, 0, 0, 0], Cells(Some((10, 10)), Some((19, 20)))),
    // 6.18: the pointer's address; the count stands there, and up to 31 registers of the queue behind it.
    (&[24, 0, 10], reads(10, 41)),
    // 6.19 to 6.21: MEI type 13 carries CANopen requests, writes among them; 14 is the device identification.
    (&[43, 13, 0, 10], Anything),
    (&[43, 14, 1, 0], Tells),
    (&[43, 0, 1, 0], Anything),
];

/// All of [`PUBLIC`], and for each other code something that might be meant for a cell that is allowed.
fn requests() -> Vec<(Vec<u8>, Does)> {
    let public = PUBLIC.iter().map(|(request, does)| (request.to_vec(), *does));
    let is_public = |function: &u8| PUBLIC.iter().any(|(request, _)| request[0] == *function);
    let others = (1..=127).filter(|function| !is_public(function));
    let others = others.flat_map(|function| [vec![function], vec![function, 0, 10, 0, 1]]);
    public.chain(others.map(|request| (request, Anything))).collect()
}

const ALLOWED: AddressRange = AddressRange { first: 10, last: 19 };

fn is_allowed(cells: Option<(u32, u32)>) -> bool {
    cells.is_none_or(|(first, last)| first >= 10 && last <= 19)
}

fn exception(policy: &Policy, request: &[u8]) -> Option<Exception> {
    policy.admit(request).err()
}

#[test]
fn every_function_code_is_in_the_table_and_all_its_requests_are_good_ones() {
    let requests = requests();
    for function in 1..=127 {
        assert!(requests.iter().any(|(request, _)| request[0] == function), "{function}");
    }
    for (request, _) in &requests {
        assert_eq!(check_request(request), Ok(()), "{request:?}");
    }
}

#[test]
fn addresses_let_pass_what_touches_only_them_and_nothing_that_cannot_be_judged() {
    let policy = Policy { addresses: ALLOWED, ..Policy::default() };
    for (request, does) in requests() {
        let expected = match does {
            Cells(read, written) if is_allowed(read) && is_allowed(written) => None,
            Cells(..) => Some(Exception::ILLEGAL_ADDRESS),
            Tells | Anything => Some(Exception::ILLEGAL_FUNCTION),
        };
        assert_eq!(exception(&policy, &request), expected, "{request:?}");
    }
}

#[test]
fn writes_let_pass_all_that_is_known_to_write_only_there() {
    let policy = Policy { writes: ALLOWED, ..Policy::default() };
    for (request, does) in requests() {
        let expected = match does {
            Cells(_, written) if is_allowed(written) => None,
            Cells(..) => Some(Exception::ILLEGAL_ADDRESS),
            Tells => None,
            Anything => Some(Exception::ILLEGAL_FUNCTION),
        };
        assert_eq!(exception(&policy, &request), expected, "{request:?}");
    }
}

#[test]
fn readonly_lets_pass_what_is_known_to_change_nothing() {
    let policy = Policy { functions: Functions::READ_ONLY, ..Policy::default() };
    for (request, does) in requests() {
        let passes = matches!(does, Cells(_, None) | Tells);
        let expected = (!passes).then_some(Exception::ILLEGAL_FUNCTION);
        assert_eq!(exception(&policy, &request), expected, "{request:?}");
    }
}

#[test]
fn a_rule_without_such_words_lets_everything_pass() {
    for (request, _) in requests() {
        assert_eq!(exception(&Policy::default(), &request), None, "{request:?}");
    }
}

#[test]
fn a_rule_for_some_functions_lets_the_device_identification_pass_only_if_it_names_it() {
    for (functions, passes) in [("3", false), ("3,43/14", true), ("3,43", true)] {
        let ports = "port P tcp server 502\nport C tcp client 10.0.0.1:502";
        let settings = settings_of(&format!("{ports}\nroute P * * * C functions {functions}"));
        assert_eq!(is_forwarded(&settings, None, &[43, 14, 1, 0]), passes, "{functions}");
        assert!(is_forwarded(&settings, None, &[3, 0, 0, 0, 1]), "{functions}");
    }
}

#[test]
fn a_request_whose_addresses_are_not_all_there_is_refused() {
    // Up to the end of the last address and quantity; what follows them changes nothing about which cells are meant.
    let told_by = |function| match function {
        22 | 24 => 3,
        5 | 6 => 3,
        23 => 9,
        _ => 5,
    };
    for policy in
        [Policy { addresses: ALLOWED, ..Policy::default() }, Policy { writes: ALLOWED, ..Policy::default() }]
    {
        for (request, does) in PUBLIC {
            let Cells(..) = does else { continue };
            for end in 0..told_by(request[0]) {
                assert!(exception(&policy, &request[..end]).is_some(), "{:?}", &request[..end]);
            }
        }
        assert!(exception(&policy, &[]).is_some());
    }
    let readonly = Policy { functions: Functions::READ_ONLY, ..Policy::default() };
    assert!(exception(&readonly, &[]).is_some());
    assert!(exception(&readonly, &[43]).is_some(), "the MEI type tells");
}

/// Whether `request` from the port number 0 goes to a port.
fn is_forwarded(settings: &Settings, peer: Option<&str>, request: &[u8]) -> bool {
    let peer = peer.map(|peer| peer.parse::<IpAddr>().unwrap());
    matches!(decide(settings, PortId(0), 1, Client::at(peer), request), Decision::Forward { .. })
}

#[test]
fn a_rule_for_an_address_matches_no_master_on_a_serial_line() {
    let mut settings = settings_of(
        "port P502 tcp server 502
         port bus serial uart1 rtu client
         port plc serial uart2 rtu server
         route P502 1 10.0.0.0/8 * bus
         route P502 1 0.0.0.0/0 * discard",
    );
    let read = [3, 0, 0, 0, 1];
    assert!(is_forwarded(&settings, Some("10.1.2.3"), &read));
    assert!(!is_forwarded(&settings, Some("11.1.2.3"), &read));
    // No line says so; the types do not forbid it.
    for rule in &mut settings.routes {
        rule.source = PortId(2);
        assert!(!rule.matches(PortId(2), 1, None));
    }
    assert_eq!(decide(&settings, PortId(2), 1, Client::at(None), &read), Decision::NoRule);
}

const SECURE: &str = "certificate gw own /gw.pem key /gw.key
    certificate plant clients /plant.pem
    port secure tcp server 802 tls broadcast all
    port bus serial uart1 rtu client
    port P502 tcp server 502
    route secure 1 * * bus role viewer readonly
    route secure 1-3 10.0.0.0/8 * bus role operator
    route secure 1-2 * * nopath role visitor
    route secure 3 * * bus
    route P502 1 * * bus";

/// The decision about a request of a client of this role at 10.0.0.1, or at 11.0.0.1.
fn decided(role: &str, address: [u8; 4], unit: u8, request: &[u8]) -> Decision {
    let role = ClientRole::new(role).unwrap_or(ClientRole::NONE);
    let client = Client { peer: Some(IpAddr::from(address)), role: &|| role };
    decide(&settings_of(SECURE), PortId(0), unit, client, request)
}

#[test]
fn a_rule_with_a_role_is_for_clients_of_that_role_and_a_client_whom_it_keeps_out_gets_01() {
    let (near, far) = ([10, 0, 0, 1], [11, 0, 0, 1]);
    let (read, write) = ([3, 0, 0, 0, 1], [6, 0, 0, 0, 1]);
    let denied = Decision::Refuse(Exception::ILLEGAL_FUNCTION);
    let goes = |decision| matches!(decision, Decision::Forward { .. });
    assert!(goes(decided("viewer", near, 1, &read)));
    assert_eq!(decided("viewer", near, 1, &write), denied, "its rule says so");
    assert!(goes(decided("operator", near, 1, &write)), "the first rule is not for it");
    // Exactly: roles are text.
    for stranger in ["Viewer", "view", "viewers", "engineer", ""] {
        assert_eq!(decided(stranger, near, 1, &read), denied, "{stranger}");
    }
    // A rule for other addresses is no rule for the client, whatever the role.
    assert_eq!(decided("visitor", far, 1, &read), Decision::Refuse(Exception::GATEWAY_NO_PATH));
    assert_eq!(decided("viewer", far, 2, &read), denied);
    // A rule without a role is for everybody, and where no rule is for any role there is none.
    assert!(goes(decided("", far, 3, &write)));
    assert_eq!(decided("operator", near, 4, &read), Decision::NoRule);
}

#[test]
fn a_broadcast_goes_where_rules_for_the_clients_role_lead() {
    let settings = settings_of(SECURE);
    let goes = |role: &str, address: [u8; 4]| {
        let role = ClientRole::new(role).unwrap_or(ClientRole::NONE);
        let client = Client { peer: Some(IpAddr::from(address)), role: &|| role };
        let only_unit_3 = settings.routes[3];
        let mut settings = settings.clone();
        settings.routes.retain(|route| *route != only_unit_3);
        leads_to(&settings, PortId(0), client, &[6, 0, 0, 0, 1], PortId(1)).is_some()
    };
    assert!(goes("operator", [10, 0, 0, 1]));
    assert!(!goes("operator", [11, 0, 0, 1]));
    assert!(!goes("viewer", [10, 0, 0, 1]) && !goes("", [10, 0, 0, 1]));
}

#[test]
fn urgent_functions_rank_high_and_others_as_the_rule_says() {
    let settings = settings_of(
        "port P502 tcp server 502
         port bus serial uart1 rtu client
         route P502 * * * bus priority low urgent 5,6,43/14",
    );
    let rank = |request: &[u8]| match decide(&settings, PortId(0), 1, Client::at(None), request) {
        Decision::Forward { priority, .. } => priority,
        other => panic!("{other:?}"),
    };
    assert_eq!(rank(&[6, 0, 0, 0, 1]), Priority::High);
    assert_eq!(rank(&[5, 0, 0, 0, 0]), Priority::High);
    assert_eq!(rank(&[43, 14, 1, 0]), Priority::High);
    assert_eq!(rank(&[43, 13, 1, 0]), Priority::Low);
    assert_eq!(rank(&[3, 0, 0, 0, 1]), Priority::Low);
}

#[test]
fn a_frame_is_passed_on_as_soon_as_its_rule_can_judge_it() {
    let settings = settings_of(
        "port plc serial uart2 rtu server
         port bus serial uart1 rtu client
         route plc 1 * * bus cut on
         route plc 2 * * bus cut on readonly
         route plc 3 * * bus cut on addresses 10-19",
    );
    let judged = |unit, so_far: &[u8]| match onward(&settings, PortId(0), unit, so_far, false) {
        Onward::Whole => "whole",
        Onward::Later => "later",
        Onward::To(_) => "to",
    };
    assert_eq!(judged(1, &[]), "to");
    for (so_far, expected) in [
        (&[][..], "later"),
        (&[3], "to"),
        (&[6], "whole"),
        (&[43], "later"),
        (&[43, 14], "to"),
        (&[43, 13], "whole"),
    ] {
        assert_eq!(judged(2, so_far), expected, "{so_far:?}");
    }
    for (request, does) in PUBLIC {
        let Cells(read, written) = does else { continue };
        let verdicts: Vec<_> = (0..=request.len()).map(|end| judged(3, &request[..end])).collect();
        let decided = if request[0] == 24 { "whole" } else { "later" };
        assert!(verdicts[1..3].iter().all(|verdict| *verdict == decided), "{request:?} {verdicts:?}");
        let passes = is_allowed(*read) && is_allowed(*written) && request[0] != 24;
        assert_eq!(verdicts.last(), Some(&if passes { "to" } else { "whole" }), "{request:?} {verdicts:?}");
    }
    for function in [7, 8, 17, 20, 21, 43, 65] {
        assert_ne!(judged(3, &[function]), "to", "{function}");
        assert_eq!(judged(3, &[function, 14, 0, 10]), "whole", "{function}");
    }
}
