//! Numbers on coils and discrete inputs, and single bits of registers: how they are read, gathered and written.

use mobgate::scanner::{Form, RegisterBit, Request};

use super::{DeviceId, add, answer, answered, at, exchange, lose, manual, requests, scanner, scanner_with};
use crate::prelude::*;

/// Bit `nth` of holding register `first`, read only when asked for.
fn bit(device: DeviceId, first: u16, nth: usize) -> Row {
    Row { form: Form::Bit(RegisterBit::ALL[nth]), ..manual(device, Kind::Holding, first, 1) }
}

/// `count` coils that are numbers, read only when asked for.
fn numbers(device: DeviceId, first: u16, count: u16, form: Form) -> Row {
    Row { form, ..manual(device, Kind::Coil, first, count) }
}

fn put(scanner: &mut Scanner, id: RowId, on: bool) {
    scanner.put(id, 0, 1, &[on.into()], at(0)).unwrap();
}

#[test]
fn sixteen_coils_are_a_number_of_which_the_first_is_the_lowest_bit() {
    let (mut scanner, _, id) = scanner_with(|device| numbers(device, 16, 16, Form::Words));
    scanner.read(id, at(0)).unwrap();
    // Coils 16, 17 and 31 are on.
    assert_eq!(answered(&mut scanner, at(0), &[1, 2, 0b11, 0b1000_0000]), [1, 0, 16, 0, 16]);
    assert_eq!(scanner.input(id), 0x8003_u16.to_be_bytes());
    scanner.put(id, 0, 1, &0x0102_u16.to_be_bytes(), at(0)).unwrap();
    assert_eq!(requests(&mut scanner, 0), [[15, 0, 16, 0, 16, 2, 0x02, 0x01]]);
}

#[test]
fn thirty_two_inputs_are_a_number_and_many_coils_are_many() {
    let (mut scanner, device) = scanner();
    let long = add(&mut scanner, Row { kind: Kind::Discrete, ..numbers(device, 0, 32, Form::Longs) });
    scanner.read(long, at(0)).unwrap();
    answered(&mut scanner, at(0), &[2, 4, 4, 3, 2, 1]);
    assert_eq!(scanner.input(long), 0x0102_0304_u32.to_be_bytes());
    let two = add(&mut scanner, numbers(device, 0, 32, Form::Words));
    scanner.put(two, 1, 1, &0x0102_u16.to_be_bytes(), at(0)).unwrap();
    assert_eq!(requests(&mut scanner, 0), [[15, 0, 0, 0, 32, 4, 0, 0, 2, 1]]);
    assert!(scanner.put(two, 1, 2, &[0; 4], at(0)).is_err(), "it has two values");
}

#[test]
fn numbers_travel_with_the_coils_beside_them_wherever_they_begin() {
    let (mut scanner, device, before) = scanner_with(|device| numbers(device, 0, 3, Form::Cells));
    let number = add(&mut scanner, numbers(device, 3, 16, Form::Words));
    let coils = add(&mut scanner, numbers(device, 19, 5, Form::Cells));
    scanner.put(before, 0, 3, &[0b101], at(0)).unwrap();
    scanner.put(number, 0, 1, &0x8001_u16.to_be_bytes(), at(0)).unwrap();
    scanner.put(coils, 0, 5, &[0b10001], at(0)).unwrap();
    assert_eq!(requests(&mut scanner, 0), [[15, 0, 0, 0, 24, 3, 0b0000_1101, 0, 0b1000_1100]]);
    for id in [before, number, coils] {
        scanner.read(id, at(0)).unwrap();
    }
    answered(&mut scanner, at(0), &[1, 3, 0b0000_1101, 0, 0b1000_1100]);
    assert_eq!(scanner.input(number), 0x8001_u16.to_be_bytes());
    assert_eq!((scanner.input(before), scanner.input(coils)), (&[0b101][..], &[0b10001][..]));
}

#[test]
fn bits_of_a_register_are_read_with_it_and_its_neighbours_in_one_request() {
    let (mut scanner, device, run) = scanner_with(|device| bit(device, 40, 3));
    let high = add(&mut scanner, bit(device, 40, 15));
    let whole = add(&mut scanner, manual(device, Kind::Holding, 40, 1));
    let next = add(&mut scanner, manual(device, Kind::Holding, 41, 2));
    for id in [run, high, whole, next] {
        scanner.read(id, at(0)).unwrap();
    }
    assert_eq!(answered(&mut scanner, at(0), &[3, 6, 0x80, 0x08, 0, 1, 0, 2]), [3, 0, 40, 0, 3]);
    assert_eq!((scanner.input(run), scanner.input(high)), (&[1][..], &[1][..]));
    assert_eq!((scanner.input(whole), scanner.input(next)), (&[0x80, 8][..], &[0, 1, 0, 2][..]));
    scanner.read(run, at(0)).unwrap();
    answered(&mut scanner, at(0), &[3, 2, 0xff, 0xf7]);
    assert_eq!(scanner.input(run), [0]);
}

#[test]
fn a_bit_is_changed_by_function_22_each_by_itself() {
    let (mut scanner, device) = scanner();
    let ids = [(40, 3), (40, 15), (41, 0)].map(|(first, nth)| add(&mut scanner, bit(device, first, nth)));
    put(&mut scanner, ids[0], true);
    put(&mut scanner, ids[1], true);
    put(&mut scanner, ids[2], false);
    let masks =
        [[22, 0, 40, 0xff, 0xf7, 0, 8], [22, 0, 40, 0x7f, 0xff, 0x80, 0], [22, 0, 41, 0xff, 0xfe, 0, 0]];
    assert_eq!(requests(&mut scanner, 0), masks);
    for id in ids {
        assert_eq!(scanner.status(id, at(0)), Status::LAST_OK.with(Status::LAST_WAS_WRITE));
    }
}

#[test]
fn a_device_that_refuses_function_22_is_read_and_written_from_then_on() {
    let (mut scanner, device) = scanner();
    let [run, stop] = [3, 4].map(|nth| add(&mut scanner, bit(device, 40, nth)));
    put(&mut scanner, run, true);
    put(&mut scanner, stop, true);
    assert_eq!(answered(&mut scanner, at(0), &[0x96, 1])[0], 22);
    assert_eq!(scanner.status(run, at(0)), Status::WRITE_MARKED, "it is not over");
    assert_eq!(answered(&mut scanner, at(0), &[3, 2, 0x12, 0x00]), [3, 0, 40, 0, 1]);
    assert_eq!(exchange(&mut scanner, at(0)).unwrap().pdu, [6, 0, 40, 0x12, 0x08]);
    let asked = answered(&mut scanner, at(0), &[3, 2, 0x12, 0x08]);
    assert_eq!(asked, [3, 0, 40, 0, 1], "function 22 is not tried again");
    assert_eq!(exchange(&mut scanner, at(0)).unwrap().pdu, [6, 0, 40, 0x12, 0x18]);
    assert_eq!(scanner.next(at(0)), None);
    let status = scanner.device_status(device, at(0)).unwrap();
    assert_eq!((status.exceptions, status.exception, status.error), (0, 0, None), "nothing went wrong");
}

#[test]
fn other_exceptions_to_function_22_are_the_points_error() {
    for exception in [2, 3, 4] {
        let (mut scanner, _, id) = scanner_with(|device| bit(device, 40, 3));
        put(&mut scanner, id, true);
        answered(&mut scanner, at(0), &[0x96, exception]);
        assert_eq!(scanner.next(at(0)), None);
        let error = ErrorCode::of_exception(exception);
        assert_eq!(scanner.status(id, at(0)).error(), Some(error));
    }
}

#[test]
fn a_rule_that_knows_no_function_22_is_as_good_as_a_device_that_does_not() {
    let (mut scanner, device, id) = scanner_with(|device| bit(device, 40, 3));
    put(&mut scanner, id, true);
    assert_eq!(scanner.next(at(0)).unwrap().pdu[0], 22);
    scanner.refused(device, at(0), Exception::ILLEGAL_FUNCTION);
    assert_eq!(answered(&mut scanner, at(0), &[3, 2, 0, 0]), [3, 0, 40, 0, 1]);
    assert_eq!(scanner.next(at(0)).unwrap().pdu, [6, 0, 40, 0, 8]);
    // Forbidden, too.
    scanner.refused(device, at(0), Exception::ILLEGAL_FUNCTION);
    assert_eq!(scanner.status(id, at(0)).error(), Some(ErrorCode::Function));
    assert_eq!(scanner.next(at(0)), None);
}

#[test]
fn a_bit_that_is_to_be_written_by_function_16_is_never_written_by_22() {
    let (mut scanner, _, id) = scanner_with(|device| Row { multiple: true, ..bit(device, 40, 3) });
    put(&mut scanner, id, false);
    assert_eq!(answered(&mut scanner, at(0), &[3, 2, 0xab, 0xcd]), [3, 0, 40, 0, 1]);
    assert_eq!(exchange(&mut scanner, at(0)).unwrap().pdu, [16, 0, 40, 0, 1, 2, 0xab, 0xc5]);
    assert_eq!(scanner.next(at(0)), None);
}

#[test]
fn a_write_without_an_answer_is_repeated_as_it_was_and_begun_anew_when_the_device_was_left_alone() {
    let (mut scanner, device, id) = scanner_with(|device| Row { multiple: true, ..bit(device, 40, 3) });
    put(&mut scanner, id, true);
    answered(&mut scanner, at(0), &[3, 2, 0, 1]);
    for _ in 0..3 {
        assert_eq!(lose(&mut scanner, at(0)).unwrap().pdu, [16, 0, 40, 0, 1, 2, 0, 9]);
    }
    assert_eq!(scanner.next(at(0)), None, "it is left alone");
    // Meanwhile somebody else has changed the register.
    assert_eq!(scanner.next(at(15_000)).unwrap().pdu, [3, 0, 40, 0, 1]);
    scanner.answered(device, at(15_000), Ok(&[3, 2, 7, 1]));
    assert_eq!(scanner.next(at(15_000)).unwrap().pdu, [16, 0, 40, 0, 1, 2, 7, 9]);
}

#[test]
fn a_register_that_was_read_before_a_pause_is_read_again() {
    for closes in [true, false] {
        let (mut scanner, _, id) = scanner_with(|device| Row { multiple: true, ..bit(device, 40, 3) });
        put(&mut scanner, id, true);
        answered(&mut scanner, at(0), &[3, 2, 0, 1]);
        if closes {
            // The port is set anew while the write is on its way.
            assert_eq!(scanner.next(at(0)).unwrap().pdu[0], 16);
            scanner.forget_open();
        } else {
            scanner.begin(id, at(0)).unwrap();
            assert_eq!(scanner.next(at(0)), None);
            scanner.finish(id).unwrap();
        }
        assert_eq!(scanner.next(at(0)).unwrap().pdu, [3, 0, 40, 0, 1]);
    }
}

/// What a device with registers does.
struct Registers {
    cells: [u16; 2],
    knows_masks: bool,
}

impl Registers {
    fn execute(&mut self, request: &Request) -> Vec<u8> {
        let pdu = &request.pdu;
        let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let cell = &mut self.cells[usize::from(word(1))];
        match pdu[0] {
            22 if !self.knows_masks => return vec![0x96, 1],
            22 => *cell = *cell & word(3) | word(5) & !word(3),
            3 => return [&[3, 2][..], &cell.to_be_bytes()].concat(),
            6 => *cell = word(3),
            16 => *cell = word(6),
            _ => return answer(request),
        }
        if pdu[0] == 22 { pdu.to_vec() } else { pdu[..5].to_vec() }
    }
}

proptest! {
    #[test]
    fn whatever_is_lost_each_bit_becomes_what_was_written_last_and_no_other_bit_changes(
        knows_masks: bool,
        multiple: bool,
        writes in prop::collection::vec((0_usize..8, any::<bool>(), 1_u64..2_000), 1..40),
        seed: u64,
    ) {
        let (mut scanner, device) = scanner();
        let mut random = Random::new(seed);
        let mut registers = Registers { cells: [0x5a5a, 0xa5a5], knows_masks };
        let mut expected = registers.cells;
        let bits = [(0, 0), (0, 1), (0, 7), (0, 8), (0, 15), (1, 0), (1, 3), (1, 12)];
        let ids = bits.map(|(first, nth)| {
            add(&mut scanner, Row { multiple, write: Writing::Auto, ..bit(device, first, nth) })
        });
        let mut now = super::START;
        let mut work = |scanner: &mut Scanner, now, lossy: bool| {
            while let Some(request) = scanner.next(now) {
                // Lost on its way, or its response is.
                match random.index(if lossy { 6 } else { 1 }) {
                    4 => scanner.answered(request.device, now, Err(ErrorCode::Timeout)),
                    5 => {
                        registers.execute(&request);
                        scanner.answered(request.device, now, Err(ErrorCode::Timeout));
                    }
                    _ => {
                        let answer = registers.execute(&request);
                        scanner.answered(request.device, now, Ok(&answer));
                    }
                }
            }
            registers.cells
        };
        for (nth, on, wait) in writes {
            now += Duration::from_millis(wait);
            let (register, place) = bits[nth];
            let mask = 1 << place;
            let expected = &mut expected[usize::from(register)];
            *expected = if on { *expected | mask } else { *expected & !mask };
            scanner.put(ids[nth], 0, 1, &[on.into()], now).unwrap();
            work(&mut scanner, now, true);
        }
        for _ in 0..100 {
            now += SECOND;
            work(&mut scanner, now, false);
        }
        prop_assert_eq!(work(&mut scanner, now, false), expected);
    }
}
