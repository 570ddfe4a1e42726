//! A drive on the first line: a register that is written, and one that has its inverse.

use std::cell::Cell;
use std::rc::Rc;

use mobgate_stm32_emulator::{Machine, Uart};

use crate::clients::{FAST, crc};
use crate::lines::bytes;

pub(crate) struct Drive {
    value: Rc<Cell<u16>>,
    asked: Vec<u8>,
}

impl Drive {
    pub(crate) const UNIT: u8 = 5;
    /// Its holding register, and the input register that has the inverse of it.
    pub(crate) const VALUE: u16 = 20;
    pub(crate) const INVERSE: u16 = 66;

    /// A drive, and the value that it has.
    pub(crate) fn new() -> (Self, Rc<Cell<u16>>) {
        let value = Rc::new(Cell::new(0));
        (Self { value: value.clone(), asked: Vec::new() }, value)
    }

    /// Answers what it was asked, once that is whole.
    pub(crate) fn step(&mut self, machine: &mut Machine) {
        self.asked.extend(bytes(&machine.sent(Uart::Line1)));
        let is_many = self.asked.get(1) == Some(&16);
        let length = if is_many { 11 } else { 8 };
        if self.asked.len() < length {
            return;
        }
        let asked = std::mem::take(&mut self.asked);
        assert_eq!(asked[length - 2..], crc(&asked[..length - 2]), "{asked:x?}");
        let word = |at: usize| u16::from_be_bytes([asked[at], asked[at + 1]]);
        let (mut response, address) = (asked[..2].to_vec(), word(2));
        assert_eq!(asked[0], Self::UNIT);
        match asked[1] {
            3 | 4 => {
                let value = self.value.get();
                let read = if asked[1] == 3 { (Self::VALUE, value) } else { (Self::INVERSE, !value) };
                assert_eq!((address, word(4)), (read.0, 1));
                response.push(2);
                response.extend(read.1.to_be_bytes());
            }
            _ => {
                assert_eq!(address, Self::VALUE);
                self.value.set(word(length - 4));
                response.extend(&asked[2..6]);
            }
        }
        response.extend(crc(&response));
        machine.send(Uart::Line1, &response, FAST);
    }
}
