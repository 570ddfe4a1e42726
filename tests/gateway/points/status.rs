//! The status word of a row, the numbers of errors, and what a row does when its device does not answer.

use mobgate::scanner::{
    BACK_OFF_FIRST, BACK_OFF_LONGEST, BACK_OFF_STEP, Device, DeviceStatus, REPEATS, SCAN,
};

use super::{
    add, answer, answered, at, checked_scanner, exchange, lose, lose_all, polled_with, row, scanner,
    scanner_with,
};
use crate::prelude::*;

fn vectors() -> toml::Table {
    include_str!("vectors/status.toml").parse().unwrap()
}

fn number(table: &toml::Value, name: &str) -> u64 {
    table[name].as_integer().unwrap() as u64
}

#[test]
fn bits_and_error_codes_are_those_of_the_vectors() {
    let bits = &vectors()["status_bits"];
    for (name, bit) in [
        ("in_progress", Status::IN_PROGRESS),
        ("last_ok", Status::LAST_OK),
        ("last_error", Status::LAST_ERROR),
        ("backing_off", Status::BACKING_OFF),
        ("read_marked", Status::READ_MARKED),
        ("write_marked", Status::WRITE_MARKED),
        ("write_blocked", Status::WRITE_BLOCKED),
        ("write_remarked", Status::WRITE_REMARKED),
        ("current_is_write", Status::CURRENT_IS_WRITE),
        ("last_was_write", Status::LAST_WAS_WRITE),
    ] {
        assert_eq!(u64::from(bit.bits()), 1 << number(bits, name), "{name}");
    }
    let names = [
        "negative_unspecified",
        "illegal_function",
        "illegal_address",
        "illegal_value",
        "unknown",
        "timeout",
        "transmission",
        "connection",
    ];
    for (code, name) in ErrorCode::ALL.into_iter().zip(names) {
        assert_eq!(code as u64, number(&vectors()["error_codes"], name), "{name}");
    }
    for (error, name) in [
        (LastError::None, "none"),
        (LastError::Port, "port_allocation"),
        (LastError::Checksum, "checksum"),
        (LastError::Length, "length"),
        (LastError::Address, "unmapped_address"),
        (LastError::Function, "unsupported_function"),
        (LastError::Response, "response_too_long"),
        (LastError::Value, "bad_value"),
        (LastError::Gap, "character_gap"),
        (LastError::Ascii, "ascii"),
        (LastError::NotStarted, "not_started"),
    ] {
        assert_eq!(error as u64, number(&vectors()["last_error"], name), "{name}");
    }
}

#[test]
fn every_status_bit_and_every_error_code_has_a_scenario() {
    let scenarios = include_str!("../../scenarios/points.toml");
    let seen = |word: &str| {
        let states = scenarios.lines().filter_map(|line| line.strip_prefix("point ")?.split_once(" is "));
        states.map(|(_, status)| status).any(|status| {
            status.split(' ').any(|flag| flag == word) || status.ends_with(&format!("({word})"))
        })
    };
    for (_, name) in Status::NAMES {
        assert!(seen(name), "{name}");
    }
    for code in ErrorCode::ALL {
        assert!(seen(code.name()), "{}", code.name());
    }
}

#[test]
fn times_are_those_of_the_vectors() {
    let backoff = &vectors()["backoff"];
    assert_eq!(u64::from(REPEATS), number(backoff, "repeats"));
    for (name, time) in [
        ("first_ms", BACK_OFF_FIRST),
        ("step_ms", BACK_OFF_STEP),
        ("max_ms", BACK_OFF_LONGEST),
        ("scan_ms", SCAN),
    ] {
        assert_eq!(time.as_millis(), number(backoff, name), "{name}");
    }
    for (name, reading) in [("low", Reading::Low), ("normal", Reading::Normal), ("high", Reading::High)] {
        let period = reading.period().unwrap().as_millis();
        assert_eq!(period, number(&backoff["read_priority_ms"], name), "{name}");
    }
}

#[test]
fn a_row_goes_from_new_to_marked_to_busy_to_ok() {
    let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    let other = add(&mut scanner, row(device, Kind::Coil, 0, 1));
    assert_eq!(scanner.status(id, at(0)).bits(), 0);
    assert_eq!(scanner.next(at(0)).unwrap().pdu, [1, 0, 0, 0, 1], "function 1 goes before function 3");
    assert_eq!(scanner.status(other, at(0)), Status::IN_PROGRESS);
    assert_eq!(scanner.status(id, at(0)), Status::READ_MARKED);
    scanner.answered(device, at(3), Ok(&[1, 1, 1]));
    assert_eq!(scanner.status(other, at(3)), Status::LAST_OK);
    assert_eq!(scanner.input(other), [1]);
    assert_eq!(exchange(&mut scanner, at(3)).unwrap().pdu, [3, 0, 0, 0, 1]);
    assert_eq!(scanner.next(at(3)), None);
    assert_eq!(scanner.age(id, at(103)), Some(100 * MS));
}

#[test]
fn a_write_is_marked_then_on_its_way_then_the_last_one() {
    let (mut scanner, device, id) = polled_with(|device| row(device, Kind::Holding, 7, 1));
    scanner.put(id, 0, 1, &[0x12, 0x34], at(10)).unwrap();
    assert_eq!(scanner.status(id, at(10)), Status::LAST_OK.with(Status::WRITE_MARKED));
    let request = scanner.next(at(10)).unwrap();
    assert_eq!(request.pdu, [6, 0, 7, 0x12, 0x34]);
    let busy = Status::IN_PROGRESS.with(Status::CURRENT_IS_WRITE);
    assert_eq!(scanner.status(id, at(10)), Status::LAST_OK.with(busy));
    // Written again meanwhile, though with the same value: it is sent again.
    scanner.put(id, 0, 1, &[0x12, 0x34], at(11)).unwrap();
    assert!(scanner.status(id, at(11)).any(Status::WRITE_REMARKED));
    scanner.answered(device, at(12), Ok(&request.pdu));
    let done = Status::LAST_OK.with(Status::LAST_WAS_WRITE);
    assert_eq!(scanner.status(id, at(12)), done.with(Status::WRITE_MARKED));
    assert_eq!(exchange(&mut scanner, at(12)).unwrap().pdu, request.pdu);
    assert_eq!(scanner.status(id, at(12)), done);
    assert_eq!(scanner.next(at(12)), None);
}

#[test]
fn an_exception_is_an_error_with_its_code_and_no_reason_to_back_off() {
    for (exception, code) in [(1, 1), (2, 2), (3, 3), (4, 0), (6, 0)] {
        let (mut scanner, _, id) = scanner_with(|device| row(device, Kind::Input, 0, 1));
        answered(&mut scanner, at(0), &[0x84, exception]);
        let status = scanner.status(id, at(1));
        assert_eq!(status.bits(), 1 << 2 | code << 12, "{status:?}");
        assert_eq!(scanner.next(at(1)), None, "it is not repeated");
        assert!(exchange(&mut scanner, at(1_000)).is_some());
        assert_eq!(scanner.status(id, at(1_000)), Status::LAST_OK, "the code goes with the error");
    }
}

#[test]
fn a_devices_exceptions_are_counted_among_its_answers() {
    let (mut scanner, device, _) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    assert!(!scanner.serves(), "the device does");
    for count in 1..=2_u32 {
        let now = at(1_000 * u64::from(count));
        let request = scanner.next(now).unwrap();
        scanner.answered(device, now, Ok(&[request.pdu[0] | 0x80, 2]));
        let status = scanner.device_status(device, now).unwrap();
        assert_eq!((status.requests, status.responses, status.exceptions), (count, count, count));
        assert_eq!(status.exception, 2);
    }
}

#[test]
fn a_row_without_a_device_is_never_due() {
    let (mut scanner, _, _) = scanner_with(|device| Row { device: None, ..row(device, Kind::Holding, 0, 1) });
    assert!(scanner.serves(), "it is for outside clients");
    assert_eq!(scanner.due(), Instant::MAX);
    assert_eq!(scanner.next(at(5_000)), None);
}

#[test]
fn what_a_rule_forbids_is_the_rows_error_and_none_of_the_devices_exceptions() {
    for exception in [1, 2, 3] {
        let (mut scanner, device, id) = polled_with(|device| row(device, Kind::Holding, 0, 1));
        let before = scanner.device_status(device, at(0)).unwrap();
        scanner.put(id, 0, 1, &[0, 1], at(1)).unwrap();
        scanner.next(at(1)).unwrap();
        scanner.refused(device, at(2), Exception(exception));
        let status = scanner.status(id, at(2));
        assert_eq!(status.bits(), 1 << 2 | 1 << 11 | u16::from(exception) << 12, "{status:?}");
        let after = scanner.device_status(device, at(2)).unwrap();
        let same =
            |status: DeviceStatus| (status.alive, status.last_response, status.exceptions, status.responses);
        assert_eq!(same(after), same(before));
        assert_eq!((after.exception, after.failures), (0, before.failures + 1));
        assert_eq!(after.backs_off_until, None);
        assert_eq!(scanner.next(at(2)), None, "it would be forbidden again");
    }
}

#[test]
fn a_check_that_a_rule_forbids_skips_the_poll_and_is_no_silence_of_the_device() {
    let mut scanner = Scanner::new();
    scanner.restart(at(0));
    let device = scanner.add_device(Device { check: true, filling: Some(9), ..super::device(5) }).unwrap();
    let id = add(&mut scanner, row(device, Kind::Input, 0, 1));
    while exchange(&mut scanner, at(0)).is_some() {}
    assert_eq!(scanner.next(at(1_000)).unwrap().pdu[0], 8);
    scanner.refused(device, at(1_000), Exception::ILLEGAL_FUNCTION);
    assert_eq!(scanner.next(at(1_000)), None, "no poll without it");
    assert_eq!(scanner.input(id), [0, 0], "what was read last stays");
    assert_eq!(scanner.device_status(device, at(1_000)).unwrap().alive, Some(true));
}

#[test]
fn what_a_full_queue_refuses_is_a_missing_way_and_waits_for_the_next_scan() {
    let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    for nth in 0..20 {
        let now = at(200 * nth);
        scanner.put(id, 0, 1, &[0, 1], now).unwrap();
        assert_eq!(scanner.next(now).unwrap().pdu, [6, 0, 0, 0, 1]);
        scanner.refused(device, now, Exception::BUSY);
        let status = scanner.status(id, now);
        assert_eq!(status.error(), Some(ErrorCode::Connection));
        assert!(status.any(Status::WRITE_MARKED), "a write keeps its mark: {status:?}");
        assert_eq!(scanner.next(now + 199 * MS), None);
    }
    let status = scanner.device_status(device, at(4_000)).unwrap();
    assert_eq!((status.alive, status.exception, status.exceptions, status.responses), (None, 0, 0, 0));
    // However often it was refused, the device has not been silent.
    assert!(lose(&mut scanner, at(4_000)).is_some());
    assert_eq!(exchange(&mut scanner, at(4_000)).unwrap().pdu, [6, 0, 0, 0, 1]);
    assert!(!scanner.status(id, at(4_000)).any(Status::LAST_ERROR));
}

#[test]
fn without_an_answer_a_frame_is_repeated_twice_and_the_error_says_why() {
    for (error, code) in [(ErrorCode::Timeout, 5), (ErrorCode::Transmission, 6), (ErrorCode::Connection, 7)] {
        let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Input, 0, 1));
        for _ in 0..3 {
            assert_eq!(scanner.next(at(0)).unwrap().pdu, [4, 0, 0, 0, 1]);
            assert!(scanner.status(id, at(0)).any(Status::IN_PROGRESS));
            scanner.answered(device, at(0), Err(error));
        }
        assert_eq!(scanner.next(at(0)), None);
        let status = scanner.status(id, at(0));
        assert_eq!(status.bits(), 1 << 2 | 1 << 4 | code << 12, "{status:?}");
    }
}

/// AMiT AP0059: "the frame is repeated 2 more times".
#[test]
fn what_is_repeated_is_that_frame_whatever_else_is_due_or_written_meanwhile() {
    let (mut scanner, device) = scanner();
    let multiple = |first, read| Row { read, multiple: true, ..row(device, Kind::Holding, first, 1) };
    let often = add(&mut scanner, multiple(0, Reading::High));
    let beside = add(&mut scanner, multiple(1, Reading::Normal));
    let apart = add(&mut scanner, row(device, Kind::Holding, 5, 1));
    while exchange(&mut scanner, at(0)).is_some() {}
    // The row that is read often is asked for alone, and marked again before each repeat, as its neighbour is.
    for ms in [200, 700, 1_200] {
        assert_eq!(scanner.next(at(ms)).unwrap().pdu, [3, 0, 0, 0, 1], "at {ms} ms");
        scanner.put(apart, 0, 1, &[0, 7], at(ms)).unwrap();
        scanner.answered(device, at(ms + 500), Err(ErrorCode::Timeout));
    }
    assert_eq!(scanner.next(at(1_700)), None);
    // It has ended in an error; the write keeps its mark, and the neighbour has not been tried.
    assert_eq!(scanner.status(often, at(1_700)).bits(), 0x5014);
    assert_eq!(scanner.status(apart, at(1_700)).bits(), 0x0092);
    assert_eq!(scanner.status(beside, at(1_700)).bits(), 0x0012);
    assert_eq!(exchange(&mut scanner, at(16_700)).unwrap().pdu, [6, 0, 5, 0, 7]);
    // A write is repeated before a read, too, and one row of its frame that is blocked holds only itself back.
    for _ in 0..2 {
        scanner.write(often).unwrap();
        scanner.write(beside).unwrap();
        assert_eq!(scanner.next(at(16_800)).unwrap().pdu, [16, 0, 0, 0, 2, 4, 0, 0, 0, 1]);
        scanner.answered(device, at(16_800), Err(ErrorCode::Timeout));
    }
    scanner.begin(beside, at(0)).unwrap();
    assert_eq!(scanner.next(at(16_800)).unwrap().pdu, [16, 0, 0, 0, 1, 2, 0, 0]);
}

#[test]
fn a_check_is_repeated_before_anything_else() {
    let (mut scanner, device) = checked_scanner();
    let id = add(&mut scanner, row(device, Kind::Holding, 0, 1));
    for _ in 0..3 {
        assert_eq!(scanner.next(at(0)).unwrap().pdu[0], 8);
        scanner.put(id, 0, 1, &[0, 7], at(0)).unwrap();
        scanner.answered(device, at(0), Err(ErrorCode::Timeout));
    }
    assert_eq!(scanner.next(at(0)), None);
}

#[test]
fn a_silent_device_is_tried_after_15_17_to_29_and_then_every_30_seconds() {
    let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    let mut now = at(0);
    lose_all(&mut scanner, now);
    // A write that waits makes every attempt happen as soon as it may.
    scanner.put(id, 0, 1, &[0, 1], now).unwrap();
    for seconds in [15, 17, 19, 21, 23, 25, 27, 29, 30, 30, 30] {
        let end = now + Duration::from_secs(seconds);
        assert_eq!(scanner.next(end - Duration::from_ticks(1)), None, "{seconds} s are not over");
        assert_eq!(scanner.due(), end);
        assert!(scanner.status(id, end - MS).any(Status::BACKING_OFF));
        assert!(scanner.status(id, end - MS).any(Status::WRITE_MARKED), "a write keeps its mark");
        assert_eq!(scanner.next(end).expect("the attempt").pdu, [6, 0, 0, 0, 1], "writes first");
        assert!(!scanner.status(id, end).any(Status::BACKING_OFF), "clear during the attempt");
        now = end + 300 * MS;
        scanner.answered(device, now, Err(ErrorCode::Timeout));
        assert_eq!(scanner.next(now), None, "one attempt only");
    }
    // A response makes all well.
    let end = now + 30 * SECOND;
    assert!(exchange(&mut scanner, end).is_some());
    assert_eq!(scanner.device_status(device, end).unwrap().alive, Some(true));
    for _ in 0..3 {
        scanner.put(id, 0, 1, &[0, 2], end).unwrap();
        assert!(lose(&mut scanner, end).is_some(), "two repeats again");
    }
    assert_eq!(scanner.due(), end + 15 * SECOND);
}

#[test]
fn a_read_loses_its_mark_and_is_due_again_at_the_first_scan_after_the_pause() {
    let (mut scanner, device) = scanner();
    let low = add(&mut scanner, Row { read: Reading::Low, ..row(device, Kind::Input, 0, 1) });
    let now = at(1_130);
    lose_all(&mut scanner, now);
    assert!(!scanner.status(low, now).any(Status::READ_MARKED));
    assert_eq!(scanner.read(low, now), Err(Refused::BackingOff(15 * SECOND)));
    // 16.13 s is the end, 16.2 s the next multiple of 200 ms.
    assert_eq!(scanner.due(), at(16_200));
    assert_eq!(scanner.next(at(16_199)), None);
    assert!(exchange(&mut scanner, at(16_200)).is_some());
    assert_eq!(scanner.due(), at(21_200));
}

#[test]
fn a_silent_device_does_not_slow_the_others() {
    let (mut scanner, silent) = scanner();
    let well = scanner.add_device(super::device(6)).unwrap();
    add(&mut scanner, row(silent, Kind::Input, 0, 1));
    let id = add(&mut scanner, Row { read: Reading::High, ..row(well, Kind::Input, 0, 1) });
    let mut answers = 0;
    // The silent one holds every request for a second.
    let mut open = None;
    for ms in (0..10_000).step_by(10) {
        if open.is_some_and(|until| at(ms) >= until) {
            scanner.answered(silent, at(ms), Err(ErrorCode::Timeout));
            open = None;
        }
        while let Some(request) = scanner.next(at(ms)) {
            if request.device == silent {
                open = Some(at(ms) + SECOND);
            } else {
                scanner.answered(well, at(ms), Ok(&[4, 2, 0, 9]));
                answers += 1;
            }
        }
    }
    assert_eq!(answers, 50);
    assert_eq!(scanner.input(id), [0, 9]);
}

#[test]
fn a_safe_write_sends_several_cells_in_one_frame_and_keeps_reads_off() {
    let (mut scanner, _, id) = polled_with(|device| row(device, Kind::Holding, 0, 3));
    scanner.begin(id, at(0)).unwrap();
    assert!(scanner.status(id, at(1)).any(Status::WRITE_BLOCKED));
    assert_eq!(scanner.begin(id, at(0)), Err(Refused::Blocked));
    assert_eq!(scanner.read(id, at(1)), Err(Refused::Blocked));
    scanner.put(id, 0, 1, &[0, 8], at(1)).unwrap();
    scanner.put(id, 2, 1, &[0, 9], at(1)).unwrap();
    assert_eq!(scanner.next(at(5_000)), None);
    scanner.finish(id).unwrap();
    assert_eq!(scanner.finish(id), Err(Refused::NotBlocked));
    assert_eq!(exchange(&mut scanner, at(5_000)).unwrap().pdu, [16, 0, 0, 0, 3, 6, 0, 8, 0, 1, 0, 9]);
}

#[test]
fn a_safe_write_that_begins_while_a_frame_is_repeated_holds_the_repeat_back() {
    let (mut scanner, device, id) = polled_with(|device| row(device, Kind::Holding, 0, 2));
    scanner.put(id, 0, 1, &[0, 8], at(1)).unwrap();
    scanner.next(at(1)).unwrap();
    scanner.begin(id, at(0)).unwrap();
    scanner.put(id, 0, 1, &[0, 9], at(2)).unwrap();
    scanner.answered(device, at(2), Err(ErrorCode::Timeout));
    assert_eq!(scanner.next(at(2)), None, "half of the change must not go out");
    scanner.finish(id).unwrap();
    assert_eq!(exchange(&mut scanner, at(3)).unwrap().pdu, [16, 0, 0, 0, 2, 4, 0, 9, 0, 1]);
}

#[test]
fn what_the_program_has_written_is_not_overwritten_by_a_read_that_was_on_its_way() {
    let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    let read = scanner.next(at(0)).unwrap();
    scanner.put(id, 0, 1, &[0, 77], at(1)).unwrap();
    scanner.answered(device, at(2), Ok(&answer(&read)));
    assert_eq!(scanner.input(id), [0, 77]);
    assert_eq!(exchange(&mut scanner, at(2)).unwrap().pdu, [6, 0, 0, 0, 77]);
}

#[test]
fn a_row_that_is_written_on_change_is_written_when_its_value_differs_or_could_not_be_written() {
    let (mut scanner, device) = scanner();
    let on_change = |kind, first| Row { write: Writing::OnChange, ..row(device, kind, first, 2) };
    let id = add(&mut scanner, on_change(Kind::Holding, 0));
    let bits = add(&mut scanner, on_change(Kind::Coil, 8));
    while exchange(&mut scanner, at(0)).is_some() {}
    // The registers hold their addresses.
    scanner.put(id, 0, 2, &[0, 0, 0, 1], at(1)).unwrap();
    assert_eq!(scanner.next(at(1)), None, "as it was read");
    scanner.put(id, 1, 1, &[0, 9], at(1)).unwrap();
    assert_eq!(exchange(&mut scanner, at(1)).unwrap().pdu, [16, 0, 0, 0, 2, 4, 0, 0, 0, 9]);
    scanner.put(id, 1, 1, &[0, 9], at(1)).unwrap();
    assert_eq!(scanner.next(at(1)), None, "as it was written");
    scanner.put(id, 1, 1, &[0, 8], at(1)).unwrap();
    answered(&mut scanner, at(1), &[0x90, 3]);
    scanner.put(id, 1, 1, &[0, 8], at(1)).unwrap();
    assert!(exchange(&mut scanner, at(1)).is_some(), "the device has not taken it");
    let second = scanner.input(bits)[0] >> 1 & 1;
    scanner.put(bits, 1, 1, &[second], at(1)).unwrap();
    assert_eq!(scanner.next(at(1)), None);
    scanner.put(bits, 1, 1, &[1 - second], at(1)).unwrap();
    assert_eq!(exchange(&mut scanner, at(1)).unwrap().pdu[..5], [15, 0, 8, 0, 2]);
}
