//! The status word of a row, the numbers of errors, and what a row does when its device does not respond.

use mobgate::scanner::{BACK_OFF_FIRST, BACK_OFF_LONGEST, BACK_OFF_STEP, DeviceStatus, REPEATS, SCAN};

use super::{add, at, exchange, lose, lose_all, polled_with, row, scanner, scanner_with};
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
    let names = "negative_unspecified illegal_function illegal_address illegal_value unknown timeout \
                 transmission connection";
    for (code, name) in ErrorCode::ALL.iter().zip(names.split(' ')) {
        assert_eq!(*code as u64, number(&vectors()["error_codes"], name), "{name}");
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
    let scenarios = include_str!("../../scenarios/points.yaml");
    let seen = |word: &str| {
        let states = scenarios.lines().filter_map(|line| line.split_once("point ")?.1.split_once(" is "));
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
