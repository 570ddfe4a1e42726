//! Periodic writes, by value; tests/scenarios/watchdogs.yaml has what goes on the line.

use mobgate::scanner::Period;

use super::{DeviceId, answered, at, manual, response, scanner};
use crate::prelude::*;

const AGAIN_MS: u64 = 3_000;

/// Two registers that are written every three seconds, read only when asked for.
fn periodic(scanner: &mut Scanner, device: DeviceId) -> RowId {
    let input = scanner.allocate(8).unwrap();
    let write = Writing::Every(Period(AGAIN_MS as u32));
    let row = Row { input, output: input + 4, write, ..manual(device, Kind::Holding, 7, 2) };
    scanner.add_row(row, at(0)).unwrap()
}

/// Sends all that is due at `now`, and answers it; returns the values written.
fn written(scanner: &mut Scanner, now: Instant) -> Vec<[u8; 4]> {
    let mut values = Vec::new();
    while let Some(request) = scanner.next(now) {
        if let [16, 0, 7, 0, 2, 4, value @ ..] = &request.pdu[..] {
            values.push(value.try_into().unwrap());
        }
        scanner.answered(request.device, now, Ok(&response(&request)));
    }
    values
}

#[test]
fn nothing_is_written_before_the_first_write_and_then_its_value_again_and_again() {
    let (mut scanner, device) = scanner();
    let id = periodic(&mut scanner, device);
    assert_eq!((scanner.due(), scanner.is_written_again(id)), (Instant::MAX, false));
    assert_eq!(written(&mut scanner, at(60_000)), [[0; 4]; 0]);
    scanner.put(id, 0, 2, &[1, 2, 3, 4], at(60_000)).unwrap();
    assert_eq!(written(&mut scanner, at(60_000)), [[1, 2, 3, 4]]);
    assert!(scanner.is_written_again(id));
    for nth in 1..5 {
        let now = at(60_000 + nth * AGAIN_MS);
        assert_eq!(scanner.due(), now);
        assert_eq!(written(&mut scanner, now - Duration::from_millis(1)), [[0; 4]; 0]);
        assert_eq!(written(&mut scanner, now), [[1, 2, 3, 4]]);
    }
    // A write meanwhile counts.
    scanner.put(id, 0, 2, &[5; 4], at(73_000)).unwrap();
    assert_eq!(written(&mut scanner, at(73_000)), [[5; 4]]);
    assert_eq!(scanner.due(), at(76_000));
    scanner.restart(at(75_000));
    assert_eq!(scanner.due(), Instant::MAX);
}

#[test]
fn what_a_device_says_of_its_own_is_shown_and_never_written_back() {
    let (mut scanner, device) = scanner();
    let id = periodic(&mut scanner, device);
    scanner.put(id, 0, 2, &[1, 2, 3, 4], at(0)).unwrap();
    assert_eq!(written(&mut scanner, at(0)), [[1, 2, 3, 4]]);
    scanner.read(id, at(100)).unwrap();
    answered(&mut scanner, at(100), &[3, 4, 0, 0, 0, 0]);
    assert_eq!(scanner.input(id), [0; 4]);
    assert_eq!(written(&mut scanner, at(AGAIN_MS)), [[1, 2, 3, 4]]);
    // Whoever asks for a write means what is shown.
    scanner.write(id).unwrap();
    assert_eq!(written(&mut scanner, at(3_100)), [[0; 4]]);
}

#[test]
fn values_of_a_safe_write_that_is_abandoned_are_never_sent() {
    let (mut scanner, device) = scanner();
    let id = periodic(&mut scanner, device);
    scanner.put(id, 0, 2, &[1, 2, 3, 4], at(0)).unwrap();
    assert_eq!(written(&mut scanner, at(0)), [[1, 2, 3, 4]]);
    scanner.begin(id, at(1_000)).unwrap();
    scanner.put(id, 0, 1, &[9, 9], at(1_000)).unwrap();
    assert_eq!(written(&mut scanner, at(4_000)), [[0; 4]; 0], "not within a safe write");
    assert!(scanner.due() > at(4_000), "it is not asked for again and again");
    assert_eq!(written(&mut scanner, at(61_000)), [[1, 2, 3, 4]]);
    scanner.begin(id, at(62_000)).unwrap();
    scanner.put(id, 0, 1, &[9, 9], at(62_000)).unwrap();
    scanner.put(id, 1, 1, &[8, 8], at(62_000)).unwrap();
    scanner.finish(id).unwrap();
    assert_eq!(written(&mut scanner, at(62_000)), [[9, 9, 8, 8]]);
    assert_eq!(written(&mut scanner, at(65_000)), [[9, 9, 8, 8]]);
}

#[test]
fn a_device_that_comes_back_gets_its_value_at_once_and_then_again() {
    let (mut scanner, device) = scanner();
    let id = periodic(&mut scanner, device);
    scanner.put(id, 0, 2, &[7; 4], at(0)).unwrap();
    assert_eq!(written(&mut scanner, at(0)), [[7; 4]]);
    for _ in 0..3 {
        let request = scanner.next(at(AGAIN_MS)).unwrap();
        scanner.answered(request.device, at(AGAIN_MS), Err(ErrorCode::Timeout));
    }
    assert!(scanner.status(id, at(AGAIN_MS)).any(Status::LAST_ERROR));
    assert_eq!(scanner.next(at(17_000)), None);
    assert_eq!(scanner.due(), at(18_000));
    assert_eq!(written(&mut scanner, at(18_000)), [[7; 4]]);
    assert_eq!(written(&mut scanner, at(21_000)), [[7; 4]]);
}
