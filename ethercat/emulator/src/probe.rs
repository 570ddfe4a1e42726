//! Single datagrams for tests: sent through a segment now, with their response.

use super::frame::{Builder, datagrams};
use super::{Command, Fate, Segment, now};

/// A returned datagram.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    /// Its data.
    pub data: Vec<u8>,
    /// Its working counter.
    pub counter: u16,
    /// Its interrupt field.
    pub interrupts: u16,
    /// Its device address, incremented by position and broadcast commands.
    pub device: u16,
}

impl Segment {
    /// Sends a datagram with the address in two halves.
    pub fn send(&mut self, command: Command, device: u16, offset: u16, data: &[u8]) -> Response {
        self.send_frame(Builder::default().device(command, device, offset, data)).remove(0)
    }

    /// Sends a datagram with a logical address.
    pub fn send_logical(&mut self, command: Command, address: u32, data: &[u8]) -> Response {
        self.send_frame(Builder::default().logical(command, address, data)).remove(0)
    }

    /// Sends a frame; returns a response per datagram.
    ///
    /// # Panics
    /// If the frame does not come back.
    pub fn send_frame(&mut self, frame: Builder) -> Vec<Response> {
        let mut bytes = frame.build();
        assert!(self.pass(now(), &mut bytes, Fate::Intact), "the frame comes back");
        let response = |datagram: super::frame::Datagram<'_>| Response {
            data: datagram.data().to_vec(),
            counter: datagram.counter(),
            interrupts: datagram.interrupts(),
            device: datagram.device(),
        };
        datagrams(&mut bytes).map(response).collect()
    }

    /// Writes to device number `nth`; returns the working counter.
    pub fn poke(&mut self, nth: u16, offset: u16, data: &[u8]) -> u16 {
        self.send(Command::Apwr, nth.wrapping_neg(), offset, data).counter
    }

    /// Reads `bytes` from device number `nth`; `None` if it did not respond.
    pub fn fetch(&mut self, nth: u16, offset: u16, bytes: usize) -> Option<Vec<u8>> {
        let response = self.send(Command::Aprd, nth.wrapping_neg(), offset, &vec![0; bytes]);
        (response.counter == 1).then_some(response.data)
    }
}
