//! Bits of registers, by value; tests/scenarios/point_bits.yaml has what goes on the line.

use mobgate::scanner::{Form, RegisterBit, RegisterBits, Request};

use super::{DeviceId, add, answered, at, manual, response, scanner, scanner_with};
use crate::prelude::*;

/// Bit `nth` of holding register `first`, read only when asked for.
fn bit(device: DeviceId, first: u16, nth: usize) -> Row {
    bits(device, first, nth, nth)
}

/// Bits `from` to `to` of holding register `first`, read only when asked for.
fn bits(device: DeviceId, first: u16, from: usize, to: usize) -> Row {
    let of_register = RegisterBits::several(from as u8, to as u8);
    let form = Form::Bits(of_register.unwrap_or(RegisterBits::one(RegisterBit::ALL[from])));
    Row { form, ..manual(device, Kind::Holding, first, 1) }
}

#[test]
fn a_register_that_was_read_before_its_port_closed_is_read_again() {
    let (mut scanner, _, id) = scanner_with(|device| Row { multiple: true, ..bit(device, 40, 3) });
    scanner.put(id, 0, 1, &[1], at(0)).unwrap();
    answered(&mut scanner, at(0), &[3, 2, 0, 1]);
    assert_eq!(scanner.next(at(0)).unwrap().pdu[0], 16, "the write is on its way");
    scanner.forget_open();
    assert_eq!(scanner.next(at(0)).unwrap().pdu, [3, 0, 40, 0, 1]);
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
            _ => return response(request),
        }
        if pdu[0] == 22 { pdu.to_vec() } else { pdu[..5].to_vec() }
    }
}

proptest! {
    #[test]
    fn whatever_is_lost_bits_become_what_was_written_last_and_no_other_bit_changes(
        knows_masks: bool,
        multiple: bool,
        writes in prop::collection::vec((0_usize..11, any::<u16>(), 1_u64..2_000), 1..40),
        seed: u64,
    ) {
        let (mut scanner, device) = scanner();
        let mut random = Random::new(seed);
        let mut registers = Registers { cells: [0x5a5a, 0xa5a5], knows_masks };
        let mut expected = registers.cells;
        // None overlap: the last write of two that do would have to be the last one sent.
        let rows = [
            (0, 0, 0), (0, 1, 1), (0, 7, 7), (0, 8, 8), (0, 15, 15), (0, 2, 5), (0, 9, 14), (1, 0, 0), (1, 3, 3),
            (1, 12, 12), (1, 4, 11),
        ];
        let ids = rows.map(|(first, from, to)| {
            add(&mut scanner, Row { multiple, write: Writing::Auto, ..bits(device, first, from, to) })
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
                        let response = registers.execute(&request);
                        scanner.answered(request.device, now, Ok(&response));
                    }
                }
            }
            registers.cells
        };
        for (nth, value, wait) in writes {
            now += Duration::from_millis(wait);
            let (register, from, to) = rows[nth];
            let expected = &mut expected[usize::from(register)];
            for place in from..=to {
                let mask = 1 << place;
                *expected = if value >> (place - from) & 1 == 1 { *expected | mask } else { *expected & !mask };
            }
            let value = value % (1 << (to - from + 1));
            let cells = if from == to { vec![value as u8] } else { value.to_be_bytes().to_vec() };
            scanner.put(ids[nth], 0, 1, &cells, now).unwrap();
            work(&mut scanner, now, true);
        }
        for _ in 0..100 {
            now += SECOND;
            work(&mut scanner, now, false);
        }
        prop_assert_eq!(work(&mut scanner, now, false), expected);
    }
}

#[test]
fn several_bits_are_a_number_that_is_read_shifted_and_refused_with_more_bits() {
    let (mut scanner, _, id) = scanner_with(|device| bits(device, 40, 4, 7));
    scanner.read(id, at(0)).unwrap();
    answered(&mut scanner, at(0), &[3, 2, 0xab, 0xcd]);
    assert_eq!(scanner.input(id), [0, 0xc]);
    assert_eq!(scanner.put(id, 0, 1, &[0, 16], at(0)), Err(Refused::Value));
    scanner.put(id, 0, 1, &[0, 9], at(0)).unwrap();
    scanner.write(id).unwrap();
    assert_eq!(scanner.next(at(0)).unwrap().pdu, [22, 0, 40, 0xff, 0x0f, 0, 0x90], "no other bit changes");
}

#[test]
fn a_client_that_writes_more_bits_than_there_are_gets_03_and_nothing_changes() {
    let (mut scanner, device) = scanner();
    let of = add(&mut scanner, Row { write: Writing::Auto, ..bits(device, 40, 4, 7) });
    let before = Row { device: None, form: Form::Cells, ..manual(device, Kind::Holding, 9, 1) };
    let own = add(&mut scanner, before);
    let shown = Row { device: None, form: Form::Cells, of: Some(of), ..manual(device, Kind::Holding, 10, 1) };
    scanner.add_row(shown, at(0)).unwrap();
    let both = |value| [16, 0, 9, 0, 2, 4, 0, 7, 0, value];
    assert_eq!(scanner.serve(&both(16), at(0)), Err(Exception::ILLEGAL_VALUE));
    assert_eq!(scanner.input(own), [0, 0]);
    assert_eq!(scanner.next(at(0)), None);
    scanner.serve(&both(15), at(0)).unwrap();
    assert_eq!(scanner.input(own), [0, 7]);
    assert_eq!(scanner.next(at(0)).unwrap().pdu, [22, 0, 40, 0xff, 0x0f, 0, 0xf0]);
}
