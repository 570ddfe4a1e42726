//! What the gateway's own unit has done: the communication event counter and log (Application Protocol 6.9 and 6.10).

use heapless::Deque;

use crate::modbus::Exception;
use crate::modbus::pdu::function::{GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG};
use crate::settings::{PORTS_MAX, PortId};

/// Bytes of the event log (6.10).
const LOG_BYTES_MAX: usize = 64;
/// A message was received, and came to everybody (6.10).
const RECEIVED: u8 = 0x80;
const BROADCAST: u8 = 0x40;
/// A response was sent; an exception 1 to 3, 4, 5 or 6, or 7.
const SENT: u8 = 0x40;
const READ_EXCEPTION: u8 = 0x01;
const ABORT_EXCEPTION: u8 = 0x02;
const BUSY_EXCEPTION: u8 = 0x04;
const NAK_EXCEPTION: u8 = 0x08;
/// The own unit only listened when a message was received, has begun to, or has restarted communications.
const LISTENED: u8 = 0x20;
const BEGAN_TO_LISTEN: u8 = 0x04;
const RESTARTED: u8 = 0x00;

/// What the own unit has done last.
pub(crate) struct Events {
    /// Messages that were carried out, other than those that ask for this number.
    completed: u16,
    /// Newest last.
    log: Deque<u8, LOG_BYTES_MAX>,
    /// The ports by which the own unit only listens, a bit each.
    listens: u16,
}

const _: () = assert!(PORTS_MAX <= u16::BITS as usize, "a bit for each port");

impl Events {
    pub(crate) const fn new() -> Self {
        Self { completed: 0, log: Deque::new(), listens: 0 }
    }

    /// Notes a message to the own unit and how it ended.
    pub(crate) fn note(&mut self, request: &[u8], broadcast: bool, response: Result<(), Exception>) {
        let fetches = matches!(request, [GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG, ..]);
        if response.is_ok() && !fetches {
            self.completed = self.completed.wrapping_add(1);
        }
        self.push(RECEIVED | if broadcast { BROADCAST } else { 0 });
        let exception = match response {
            Ok(()) => 0,
            Err(Exception(1..=3)) => READ_EXCEPTION,
            Err(Exception(4)) => ABORT_EXCEPTION,
            Err(Exception(7)) => NAK_EXCEPTION,
            Err(_) => BUSY_EXCEPTION,
        };
        self.push(SENT | exception);
    }

    /// Whether the own unit only listens to what comes by `port`.
    pub(crate) fn listens_only(&self, port: PortId) -> bool {
        self.listens & bit(port) != 0
    }

    /// It only listens to `port` from now on.
    pub(crate) fn listen_only(&mut self, port: PortId) {
        self.listens |= bit(port);
        self.push(RECEIVED);
        self.push(BEGAN_TO_LISTEN);
    }

    /// It has heard a message to which it only listens.
    pub(crate) fn listened(&mut self) {
        self.push(RECEIVED | LISTENED);
    }

    /// It answers at `port` again, and counts from 0.
    pub(crate) fn restart(&mut self, port: PortId, clears_log: bool) {
        self.listens &= !bit(port);
        self.clear_count();
        if clears_log {
            self.log.clear();
        }
        self.push(RESTARTED);
    }

    /// Sets the event count to 0.
    pub(crate) fn clear_count(&mut self) {
        self.completed = 0;
    }

    fn push(&mut self, event: u8) {
        if self.log.is_full() {
            self.log.pop_front();
        }
        // There is room now.
        let _ = self.log.push_back(event);
    }

    /// Status word (no program runs) and event count.
    pub(crate) fn counter(&self) -> [u8; 4] {
        let [high, low] = self.completed.to_be_bytes();
        [0, 0, high, low]
    }

    /// Events in the log.
    pub(crate) fn len(&self) -> usize {
        self.log.len()
    }

    /// Those.
    pub(crate) fn newest_first(&self) -> impl Iterator<Item = u8> {
        self.log.iter().rev().copied()
    }
}

fn bit(port: PortId) -> u16 {
    1 << port.index()
}
