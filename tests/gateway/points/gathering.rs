//! Which rows go into one frame, when they are due, and that nothing is lost.

use std::iter::from_fn;

use mobgate::scanner::{Full, Request, VALUE_BYTES_MAX};

use super::{
    START, add, answered, at, bit_of, checked_scanner, device, exchange, manual, requests, response, row,
    scanner, scanner_with,
};
use crate::prelude::*;

#[test]
fn devices_take_turns() {
    let (mut scanner, one) = scanner();
    let other = scanner.add_device(device(6)).unwrap();
    for device in [one, other] {
        add(&mut scanner, row(device, Kind::Holding, 0, 1));
        add(&mut scanner, row(device, Kind::Coil, 0, 1));
    }
    let units: Vec<u8> = from_fn(|| exchange(&mut scanner, at(0))).map(|request| request.unit).collect();
    assert_eq!(units, [5, 6, 5, 6]);
}

#[test]
fn outputs_that_differ_are_written_when_outputs_are_on_and_not_after_a_restart() {
    let (mut scanner, _) = scanner();
    scanner.set_outputs(true);
    for on in [true, false] {
        if !on {
            scanner.restart(START);
        }
        let device = scanner.add_device(device(7)).unwrap();
        let [input, output] = [0; 2].map(|_| scanner.allocate(2).unwrap());
        let write = Writing::OnChange;
        scanner.add_row(Row { input, output, write, ..row(device, Kind::Holding, 0, 1) }, START).unwrap();
        answered(&mut scanner, at(0), &[3, 2, 7, 8]);
        let written = requests(&mut scanner, 0);
        assert_eq!(written.len(), usize::from(on), "{written:?}");
    }
}

#[test]
fn what_is_read_of_a_row_with_an_output_is_kept_also_while_that_waits_to_be_written() {
    let (mut scanner, device) = scanner();
    let [input, output] = [0; 2].map(|_| scanner.allocate(2).unwrap());
    let row = Row { input, output, ..row(device, Kind::Holding, 0, 1) };
    let id = scanner.add_row(row, START).unwrap();
    scanner.next(at(0)).unwrap();
    scanner.write(id).unwrap();
    scanner.answered(device, at(0), Ok(&[3, 2, 7, 8]));
    assert_eq!(scanner.input(id), [7, 8]);
}

#[test]
fn what_is_late_is_due_again_at_the_next_point_of_its_raster() {
    const TICK: Duration = Duration::from_ticks(1);
    for (late, next) in [(at(2_000) - TICK, at(2_000)), (at(2_000), at(2_200)), (at(2_000) + TICK, at(2_200))]
    {
        let (mut scanner, _, _) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
        assert!(exchange(&mut scanner, late).is_some());
        assert_eq!(scanner.due(), next);
    }
}

#[test]
fn a_row_that_is_late_by_a_whole_period_is_read_once() {
    let (mut scanner, _, _) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    assert_eq!([0, 2_000].map(|ms| requests(&mut scanner, ms).len()), [1, 1]);
}

#[test]
fn a_row_that_is_never_written_or_has_no_device_refuses_to_be_written() {
    let (mut scanner, device) = scanner();
    let only_read = add(&mut scanner, Row { write: Writing::Never, ..row(device, Kind::Holding, 0, 1) });
    assert_eq!(scanner.write(only_read), Err(Refused::ReadOnly));
    assert_eq!(scanner.begin(only_read, START), Err(Refused::ReadOnly));
    let local = add(&mut scanner, Row { device: None, ..row(device, Kind::Holding, 1, 1) });
    assert_eq!(scanner.write(local), Err(Refused::NoDevice));
    assert_eq!(scanner.begin(local, START), Err(Refused::NoDevice));
    assert_eq!(requests(&mut scanner, 0), [[3, 0, 0, 0, 1]]);
}

#[test]
fn what_was_asked_when_the_port_closed_is_asked_again() {
    let (mut scanner, device, id) = scanner_with(|device| manual(device, Kind::Input, 7, 1));
    scanner.mark_range(device, 4, 7, 7, START).unwrap();
    let asked = scanner.next(at(0)).unwrap();
    assert_eq!(scanner.next(at(0)), None, "one request is open at a time");
    scanner.forget_open();
    assert_eq!(scanner.next(at(0)), Some(asked));
    assert!(scanner.status(id, at(0)).any(Status::IN_PROGRESS));
}

#[test]
fn after_a_restart_the_whole_memory_can_be_had_again() {
    let mut scanner = Scanner::new();
    for _ in 0..2 {
        scanner.restart(START);
        assert_eq!(scanner.allocate(VALUE_BYTES_MAX as u16), Ok(0));
        assert_eq!(scanner.allocate(1), Err(Full::Values));
    }
}

#[test]
fn priorities_and_periods_are_kept_over_a_minute() {
    let (mut scanner, device) = scanner();
    let readings = [
        (Reading::Low, 12),
        (Reading::Normal, 60),
        (Reading::High, 300),
        (Reading::Every(250), 240),
        (Reading::Every(7), 8_572),
        (Reading::Manual, 0),
    ];
    for (nth, (read, _)) in readings.iter().enumerate() {
        add(&mut scanner, Row { read: *read, ..row(device, Kind::Input, 10 * nth as u16, 1) });
    }
    let mut counts = [0; 6];
    let mut now = START;
    while now < at(60_000) {
        while let Some(request) = exchange(&mut scanner, now) {
            counts[usize::from(request.pdu[2] / 10)] += 1;
        }
        let due = scanner.due();
        assert!(due > now, "it would spin");
        now = due;
    }
    assert_eq!(counts, readings.map(|(_, count)| count));
}

#[test]
fn a_device_that_is_slower_than_its_periods_is_asked_all_the_time_and_every_row_gets_its_turn() {
    let (mut scanner, device) = scanner();
    for first in 0..4 {
        let read = Reading::Every(1);
        add(&mut scanner, Row { read, ..row(device, Kind::Input, 10 * first, 1) });
    }
    let mut asked = [0; 4];
    for turn in 0..400 {
        let request = exchange(&mut scanner, at(50 * turn)).expect("always something due");
        asked[usize::from(request.pdu[2] / 10)] += 1;
    }
    assert_eq!(asked, [100; 4]);
}

#[test]
fn outputs_of_an_image_are_written_when_they_differ_from_what_was_read_back() {
    let (mut scanner, device) = scanner();
    let (input, output) = (scanner.allocate(8).unwrap(), scanner.allocate(8).unwrap());
    let (read, write) = (Reading::Every(100), Writing::OnChange);
    let image = Row { input, output, read, write, ..row(device, Kind::Holding, 9005, 4) };
    let id = scanner.add_row(image, START).unwrap();
    assert_eq!(requests(&mut scanner, 0).len(), 1, "outputs are off after a restart");
    scanner.set_outputs(true);
    scanner.image_mut(output, 8).copy_from_slice(&[0, 1, 0, 2, 0, 3, 0, 4]);
    assert_eq!(requests(&mut scanner, 100)[1], [16, 0x23, 0x2d, 0, 4, 8, 0, 1, 0, 2, 0, 3, 0, 4]);
    assert_eq!(scanner.input(id)[..2], 9005_u16.to_be_bytes(), "the image has what was read");
    assert_eq!(requests(&mut scanner, 200).len(), 2, "written again: the device has not taken it");
    let own = scanner.image(input, 8).to_vec();
    scanner.image_mut(output, 8).copy_from_slice(&own);
    assert_eq!(requests(&mut scanner, 300).len(), 1);
    scanner.image_mut(output, 8).fill(7);
    answered(&mut scanner, at(400), &[3, 8, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert!(scanner.status(id, at(400)).any(Status::WRITE_MARKED));
    scanner.set_outputs(false);
    assert_eq!(scanner.next(at(400)), None, "what waits is dropped with the outputs");
}

#[test]
fn every_output_bit_counts_and_what_stands_behind_the_last_one_does_not() {
    let (mut scanner, device) = scanner();
    let (input, output) = (scanner.allocate(2).unwrap(), scanner.allocate(2).unwrap());
    let image = Row { input, output, write: Writing::OnChange, ..row(device, Kind::Coil, 0, 11) };
    scanner.add_row(image, START).unwrap();
    requests(&mut scanner, 0);
    scanner.set_outputs(true);
    let own = scanner.image(input, 2).to_vec();
    for (bit, writes) in (0..16).map(|bit| (bit, usize::from(bit < 11))) {
        scanner.image_mut(output, 2).copy_from_slice(&own);
        scanner.image_mut(output, 2)[bit / 8] ^= 1 << (bit % 8);
        let frames = requests(&mut scanner, 1_000 + 1_000 * bit as u64);
        assert_eq!(frames.iter().filter(|pdu| pdu[0] == 15).count(), writes, "bit {bit}");
    }
}

#[test]
fn on_a_line_that_is_slower_than_the_polling_a_device_is_still_checked_once_before_a_poll() {
    let (mut scanner, device) = checked_scanner();
    for kind in Kind::ALL {
        add(&mut scanner, Row { read: Reading::Every(1), ..row(device, kind, 0, 1) });
    }
    // Each exchange takes 10 ms, in which all that was read before is due again.
    let functions: Vec<u8> =
        (0..500).filter_map(|nth| Some(exchange(&mut scanner, at(10 * nth))?.pdu[0])).collect();
    let polls: Vec<&[u8]> = functions.chunks(5).collect();
    assert_eq!(polls, vec![[8, 1, 2, 4, 3]; 100], "a check, then all of the device");
}

/// The frames of rows that do not overlap, all of one table and due at once: sorted by address, each frame as long as rows
/// follow each other and it is within the limit.
fn model(mut rows: Vec<(u16, u16)>, most: u16) -> Vec<(u16, u16)> {
    rows.sort_unstable();
    let mut frames: Vec<(u16, u16)> = Vec::new();
    for (first, count) in rows {
        match frames.last_mut() {
            Some((start, length)) if *start + *length == first && *length + count <= most => *length += count,
            _ => frames.push((first, count)),
        }
    }
    frames
}

proptest! {
    #[test]
    fn gathering_equals_an_independent_model_and_every_row_gets_its_own_cells(
        kind in prop::sample::select(Kind::ALL.to_vec()),
        parts in prop::collection::vec((0_u16..3, 1_u16..34), 1..30),
        seed: u64,
    ) {
        let most = kind.cells_max(false);
        let mut rows = Vec::new();
        let mut next = 0;
        for (hole, count) in parts {
            rows.push((next + hole, count));
            next += hole + count;
        }
        let expected = model(rows.clone(), most);
        let (mut scanner, device) = scanner();
        let mut random = Random::new(seed);
        let mut ids = Vec::new();
        while !rows.is_empty() {
            let (first, count) = rows.swap_remove(random.index(rows.len()));
            ids.push((add(&mut scanner, row(device, kind, first, count)), first, count));
        }
        let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let frames: Vec<_> =
            requests(&mut scanner, 0).iter().map(|pdu| (word(pdu, 1), word(pdu, 3))).collect();
        prop_assert_eq!(frames, expected);
        for (id, first, count) in ids {
            let cells = scanner.input(id);
            for nth in 0..count {
                let at = usize::from(nth);
                if kind.is_bits() {
                    prop_assert_eq!(cells[at / 8] >> (at % 8) & 1 == 1, bit_of(first + nth));
                } else {
                    prop_assert_eq!(word(cells, 2 * at), first + nth);
                }
            }
        }
    }

    #[test]
    fn whatever_happens_no_mark_is_lost_and_no_request_left_open(
        events in prop::collection::vec((0_u8..8, 0_usize..6, 1_u64..3_000), 1..200),
    ) {
        let (mut scanner, first) = scanner();
        let second = scanner.add_device(device(6)).unwrap();
        let mut ids = Vec::new();
        for nth in 0..6 {
            let device = if nth % 2 == 0 { first } else { second };
            let write = if nth < 4 { Writing::Auto } else { Writing::Manual };
            ids.push(add(&mut scanner, Row { write, ..row(device, Kind::Holding, nth, 1) }));
        }
        let mut now = START;
        let mut last = [None; 6];
        let mut device_has = [None; 6];
        let mut open = Vec::new();
        for (value, (what, nth, wait)) in events.into_iter().enumerate() {
            now += Duration::from_millis(wait);
            let value = value as u8;
            match what {
                0 | 1 => {
                    // A second put before the first is sent replaces it.
                    let put = scanner.put(ids[nth], 0, 1, &[0, value], now).and_then(|()| scanner.write(ids[nth]));
                    if scanner.put(ids[nth], 0, 1, &[0, value], now).is_ok() && put.is_ok() {
                        last[nth] = Some(value);
                    }
                }
                2 => { let _ = scanner.read(ids[nth], now); }
                _ => {}
            }
            open.extend(scanner.next(now));
            prop_assert!(open.len() <= 2, "one for each device");
            if what >= 4 && !open.is_empty() {
                settle(&mut scanner, &mut device_has, open.remove(0), now, what == 4);
            }
        }
        // All devices respond from now on.
        for _ in 0..400 {
            open.extend(scanner.next(now));
            match open.pop() {
                Some(request) => settle(&mut scanner, &mut device_has, request, now, false),
                None => now = (now + Duration::from_millis(200)).max(now),
            }
        }
        for (nth, value) in last.iter().enumerate() {
            prop_assert_eq!(device_has[nth], *value, "what was written last has arrived: row {}", nth);
            let waits = Status::WRITE_MARKED.with(Status::WRITE_REMARKED);
            prop_assert!(!scanner.status(ids[nth], now).any(waits));
        }
    }
}

/// Answers a request, or loses it; `device_has` is what the devices have been given.
fn settle(
    scanner: &mut Scanner,
    device_has: &mut [Option<u8>; 6],
    request: Request,
    now: Instant,
    lose: bool,
) {
    if lose {
        return scanner.answered(request.device, now, Err(ErrorCode::Timeout));
    }
    if let [6, 0, address, 0, value] = request.pdu[..] {
        device_has[usize::from(address)] = Some(value);
    }
    scanner.answered(request.device, now, Ok(&response(&request)));
}
