//! The ports of a chip: their state, and a frame's path from one of them through the processing unit to the next (I, Frame
//! Processing).

use crate::chip::Chip;
use crate::frame::{datagrams, is_ethercat, mark_passed};
use crate::registers::{LOST_LINK, RECEIVE_TIMES};
use crate::{Command, Nanos};

/// Bytes of preamble and FCS.
const AROUND_BYTES: Nanos = 12;
/// At 100 Mbit/s.
const NANOS_PER_BYTE: Nanos = 80;

impl Chip {
    /// Passes an intact frame through the last chip of a line, which returns it. False if it is dropped, as frames that are not
    /// EtherCAT (I, Frame Processing; "Non-EtherCAT protocols").
    pub fn pass(&mut self, at: Nanos, frame: &mut [u8]) -> bool {
        self.pass_on(at, frame, None, true)
    }

    /// Passes a frame through a chip of a line. `returned` is when it comes back from the chips behind this one, if any. Unless it
    /// is `good` at its end, it is modified without effect on the chip. False if it is dropped.
    pub fn pass_on(&mut self, at: Nanos, frame: &mut [u8], returned: Option<Nanos>, good: bool) -> bool {
        if !is_ethercat(frame) || !self.closed_port_lets_pass(frame) {
            return false;
        }
        self.frame_end = at + (frame.len() as Nanos + AROUND_BYTES) * NANOS_PER_BYTE;
        self.frame(at, datagrams(frame), good);
        if good && latches_times(frame) {
            self.clock.latch(&mut self.memory, [Some(at), returned, None, None]);
        }
        mark_passed(frame);
        true
    }

    /// Opens a port, or closes it as on link loss. Port 0 leads to the MainDevice and is initially open, port 1 leads to the next
    /// chip (I, Frame Processing, "Loop control"; II, 0110h and 0310h).
    pub fn set_port(&mut self, port: usize, open: bool) {
        if self.ports[port] != open {
            self.ports[port] = open;
            self.events.dl_status = true;
            if !open {
                let counter = LOST_LINK + port as u16;
                self.memory.set_byte(counter, self.memory.byte(counter).saturating_add(1));
            }
        }
    }

    /// Circulating frames (I, Frame Processing): a frame that passes a closed port 0 is marked; a marked frame is circulating, and
    /// is dropped.
    fn closed_port_lets_pass(&self, frame: &mut [u8]) -> bool {
        self.ports[0]
            || datagrams(frame).all(|mut datagram| {
                let first_time = !datagram.circulating();
                datagram.set_circulating();
                first_time
            })
    }
}

/// Whether a frame writes the register that latches the receive times (I, Distributed Clocks; II, 0900h).
fn latches_times(frame: &mut [u8]) -> bool {
    datagrams(frame).any(|datagram| {
        let to_all = datagram.command() == Some(Command::Bwr);
        let end = usize::from(datagram.offset()) + datagram.data().len();
        to_all && datagram.offset() <= RECEIVE_TIMES && end > usize::from(RECEIVE_TIMES)
    })
}
