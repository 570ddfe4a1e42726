//! What a program starts by numbers: whose command was taken, how it is doing, and what becomes of one whose program is gone.

use mobgate::scanner::ABANDONED_AFTER;

use super::{
    DeviceId, START, add, answered, at, device, exchange, lose_all, response, row, scanner, scanner_with,
};
use crate::prelude::*;

const READ: u16 = 1;
const WRITE: u16 = 2;
const BEGIN: u16 = 3;
const FINISH: u16 = 4;

const UNDER_WAY: u8 = 1;
const DONE: u8 = 2;
const FAILED: u8 = 3;
const BEGUN: u8 = 4;

/// A row that nobody asks for but programs.
fn manual(device: DeviceId, first: u16, count: u16) -> Row {
    Row { write: Writing::Manual, ..super::manual(device, Kind::Holding, first, count) }
}

/// Requester and what is to be done.
fn by(requester: u16, operation: u16) -> u16 {
    requester << 8 | operation
}

/// Whose command was taken last, and how it is doing.
fn command(scanner: &Scanner, id: RowId) -> (u8, u8) {
    let [requester, progress] = scanner.command(id).unwrap().to_be_bytes();
    (requester, progress)
}

#[test]
fn while_a_command_is_under_way_others_are_refused_and_see_whose_it_is() {
    let (mut scanner, _, id) = scanner_with(|device| manual(device, 0, 1));
    scanner.start(id, by(1, READ), at(0)).unwrap();
    for operation in [READ, WRITE, BEGIN, FINISH] {
        assert_eq!(scanner.start(id, by(2, operation), at(0)), Err(Refused::Taken));
    }
    assert_eq!(command(&scanner, id), (1, UNDER_WAY));
    // Whose response was lost asks again.
    scanner.start(id, by(1, READ), at(0)).unwrap();
    exchange(&mut scanner, at(0)).unwrap();
    assert_eq!(scanner.next(at(0)), None, "once");
    assert_eq!(command(&scanner, id), (1, DONE));
    scanner.start(id, by(2, READ), at(1)).unwrap();
    assert_eq!(command(&scanner, id), (2, UNDER_WAY));
}

#[test]
fn a_safe_write_whose_program_is_gone_ends_and_leaves_no_half_of_its_values() {
    let (mut scanner, device) = scanner();
    let id = add(&mut scanner, Row { write: Writing::Auto, ..manual(device, 4, 2) });
    scanner.read(id, at(0)).unwrap();
    exchange(&mut scanner, at(0)).unwrap();
    scanner.start(id, by(1, BEGIN), at(1_000)).unwrap();
    scanner.put(id, 0, 1, &[9, 9], at(2_000)).unwrap();
    let end = at(2_000) + ABANDONED_AFTER;
    assert_eq!(scanner.due(), end, "it is heard of last when it sets a value");
    assert_eq!(scanner.next(end - MS), None);
    assert!(!scanner.is_due(end - MS));
    assert_eq!(command(&scanner, id), (1, BEGUN));
    assert!(scanner.is_due(end));
    let request = scanner.next(end).unwrap();
    assert_eq!(request.pdu, [3, 0, 4, 0, 2], "no write: what the device has is read again");
    assert_eq!(scanner.age(id, end), None, "until then its values are nobody's");
    scanner.answered(device, end, Ok(&response(&request)));
    assert_eq!(scanner.input(id), [0, 4, 0, 5]);
    assert_eq!(command(&scanner, id), (1, FAILED));
    assert_eq!(scanner.status(id, end), Status::LAST_OK);
    assert_eq!(scanner.due(), Instant::MAX);
    scanner.start(id, by(2, BEGIN), end).unwrap();
}

#[test]
fn an_abandoned_safe_write_of_a_device_that_is_left_alone_is_read_when_that_is_tried_again() {
    let (mut scanner, device, id) = scanner_with(|device| manual(device, 4, 2));
    let other = add(&mut scanner, manual(device, 20, 1));
    scanner.begin(id, at(0)).unwrap();
    scanner.read(other, at(50_000)).unwrap();
    lose_all(&mut scanner, at(50_000));
    assert_eq!(scanner.next(at(60_000)), None);
    assert!(!scanner.status(id, at(60_000)).any(Status::WRITE_BLOCKED));
    assert_eq!(scanner.next(at(64_999)), None);
    assert_eq!(scanner.next(at(65_000)).unwrap().pdu, [3, 0, 4, 0, 2]);
}

#[test]
fn a_range_is_taken_as_a_whole_or_not_at_all() {
    let (mut scanner, device) = scanner();
    let ids = [0, 10, 20].map(|first| add(&mut scanner, manual(device, first, 2)));
    let only_read = Row { write: Writing::Never, ..manual(device, 30, 1) };
    add(&mut scanner, only_read);
    scanner.start(ids[2], by(2, READ), at(0)).unwrap();
    assert_eq!(scanner.start_range([by(1, 0), 3, 11, 10], at(0)), Err(Refused::Taken));
    assert_eq!(command(&scanner, ids[1]), (0, 0), "none of them");
    // MdbmMark 1, 3, 0, 12
    scanner.start_range([by(1, 0), 3, 0, 12], at(0)).unwrap();
    assert_eq!(scanner.commands_of(1), by(2, 0), "two are under way");
    assert_eq!(command(&scanner, ids[2]), (2, UNDER_WAY));
    exchange(&mut scanner, at(0)).unwrap();
    exchange(&mut scanner, at(0)).unwrap();
    answered(&mut scanner, at(0), &[0x83, 2]);
    assert_eq!((scanner.commands_of(1), scanner.commands_of(2)), (by(0, 1), 0), "one has failed");
    // MdbmMark 1, 6, 10, 12: what cannot be written is left out, and is an error alone.
    scanner.start_range([by(1, 0), 6, 10, 21], at(1)).unwrap();
    assert_eq!(scanner.commands_of(1), by(2, 0));
    assert_eq!(scanner.start_range([by(1, 0), 6, 30, 1], at(1)), Err(Refused::ReadOnly));
}

#[test]
fn what_is_no_command_is_refused_and_changes_nothing() {
    let (mut scanner, device, id) = scanner_with(|device| manual(device, 0, 1));
    let own = add(&mut scanner, Row { device: None, ..row(device, Kind::Holding, 0, 1) });
    let input = add(&mut scanner, Row { kind: Kind::Input, write: Writing::Never, ..manual(device, 0, 1) });
    let shown = add(&mut scanner, Row { device: None, of: Some(id), ..manual(device, 5, 1) });
    for (row, command, refused) in [
        (RowId(99), by(1, READ), Refused::NotThere),
        (own, by(1, READ), Refused::NoDevice),
        (id, 0, Refused::Value),
        (id, by(1, 0), Refused::Value),
        (id, by(1, 5), Refused::Value),
        (id, by(32, READ), Refused::Value),
        (id, u16::MAX, Refused::Value),
        (id, by(1, FINISH), Refused::NotBlocked),
        (input, by(1, WRITE), Refused::ReadOnly),
        (input, by(1, BEGIN), Refused::ReadOnly),
    ] {
        assert_eq!(scanner.start(row, command, at(0)), Err(refused), "{row:?} {command:04x}");
    }
    for (range, refused) in [
        ([by(1, 1), 3, 0, 1], Refused::NotThere),
        ([by(1, 0), 3, 1, 9], Refused::NotThere),
        ([by(32, 0), 3, 0, 1], Refused::Value),
        ([by(1, 0), 22, 0, 1], Refused::Value),
        ([by(1, 0), 0x0103, 0, 1], Refused::Value),
        ([by(1, 0), 3, 0, 0], Refused::Value),
        ([by(1, 0), 3, 2, u16::MAX], Refused::Value),
    ] {
        assert_eq!(scanner.start_range(range, at(0)), Err(refused), "{range:x?}");
    }
    assert_eq!((scanner.next(at(0)), scanner.command(RowId(99))), (None, None));
    assert!([id, own, input].iter().all(|id| command(&scanner, *id) == (0, 0)));
    // The last address, and a row that shows another one's variable.
    scanner.start_range([by(1, 0), 3, 0, u16::MAX], at(0)).unwrap();
    exchange(&mut scanner, at(0)).unwrap();
    scanner.start(shown, by(3, READ), at(0)).unwrap();
    assert_eq!((command(&scanner, shown), command(&scanner, id)), ((3, UNDER_WAY), (3, UNDER_WAY)));
}

proptest! {
    #[test]
    fn a_command_that_was_taken_ends_and_says_done_only_after_a_request_of_its_own(
        events in prop::collection::vec((0_u8..8, 0_usize..4, 0_u16..3, 1_u16..5, 1_u64..3_000), 1..200),
    ) {
        let (mut scanner, first) = scanner();
        let second = scanner.add_device(device(6)).unwrap();
        let ids = [0, 1, 2, 3].map(|nth| {
            let device = if nth < 2 { first } else { second };
            let read = [Reading::Manual, Reading::High][usize::from(nth % 2)];
            add(&mut scanner, Row { read, ..manual(device, 10 * nth, 1) })
        });
        // When a command of each row was taken, and a request for it answered well.
        let (mut taken, mut answered) = ([START; 4], [(START, START); 4]);
        let mut open: Vec<(super::Request, Instant)> = Vec::new();
        let mut now = START;
        for (what, nth, requester, operation, wait) in events {
            now += Duration::from_millis(wait);
            if what < 3 {
                let before = command(&scanner, ids[nth]);
                match scanner.start(ids[nth], by(requester, operation), now) {
                    Ok(()) => {
                        prop_assert_eq!(command(&scanner, ids[nth]).0, requester as u8);
                        taken[nth] = now;
                    }
                    Err(_) => prop_assert_eq!(command(&scanner, ids[nth]), before),
                }
            }
            open.extend(scanner.next(now).map(|request| (request, now)));
            if what > 4 && !open.is_empty() {
                let (request, sent) = open.remove(0);
                let good = response(&request);
                let outcome = match what {
                    5 => Err(ErrorCode::Timeout),
                    6 => Ok(&[request.pdu[0] | 0x80, 4][..]),
                    _ => Ok(&good[..]),
                };
                let row = usize::from(request.pdu[2] / 10);
                if what == 7 {
                    answered[row] = (sent, now);
                }
                scanner.answered(request.device, now, outcome);
            }
            for nth in 0..4 {
                if command(&scanner, ids[nth]).1 == DONE {
                    prop_assert!(answered[nth].0 >= taken[nth], "{}", nth);
                }
            }
        }
        // All devices respond from now on, and who has begun is gone.
        for _ in 0..200 {
            now += SECOND;
            for (request, _) in open.drain(..) {
                scanner.answered(request.device, now, Ok(&response(&request)));
            }
            open.extend(scanner.next(now).map(|request| (request, now)));
        }
        for id in ids {
            let (_, progress) = command(&scanner, id);
            prop_assert!(![UNDER_WAY, BEGUN].contains(&progress), "{}", progress);
        }
    }
}
