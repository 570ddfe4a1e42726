//! Single bits of registers, by value; tests/scenarios/point_bits.yaml has what goes on the line.

use mobgate::scanner::{Form, RegisterBit, Request};

use super::{DeviceId, add, answered, at, manual, response, scanner, scanner_with};
use crate::prelude::*;

/// Bit `nth` of holding register `first`, read only when asked for.
fn bit(device: DeviceId, first: u16, nth: usize) -> Row {
    Row { form: Form::Bit(RegisterBit::ALL[nth]), ..manual(device, Kind::Holding, first, 1) }
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
                        let response = registers.execute(&request);
                        scanner.answered(request.device, now, Ok(&response));
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
