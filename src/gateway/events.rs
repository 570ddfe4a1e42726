//! The communication event counter and event log of the own unit (Application Protocol 6.9 and 6.10).

use heapless::Deque;

use crate::modbus::Exception;
use crate::modbus::pdu::function::{GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG};
use crate::settings::{PORTS_MAX, PortId};

/// Bytes of the event log (6.10).
const LOG_BYTES_MAX: usize = 64;
/// A message was received; with the flag for a broadcast (6.10).
const RECEIVED: u8 = 0x80;
const BROADCAST: u8 = 0x40;
/// A response was sent, with flags for exceptions 1 to 3, 4, 5 or 6, and 7.
const SENT: u8 = 0x40;
const READ_EXCEPTION: u8 = 0x01;
const ABORT_EXCEPTION: u8 = 0x02;
const BUSY_EXCEPTION: u8 = 0x04;
const NAK_EXCEPTION: u8 = 0x08;
/// In listen-only mode: a message was received; the mode was entered; communications were restarted.
const LISTENED: u8 = 0x20;
const BEGAN_TO_LISTEN: u8 = 0x04;
const RESTARTED: u8 = 0x00;

/// Event counter and event log.
pub(crate) struct Events {
    /// Messages completed, except those that read this counter.
    completed: u16,
    /// Newest last.
    log: Deque<u8, LOG_BYTES_MAX>,
    /// The ports in listen-only mode, one bit each.
    listens: u16,
}

const _: () = assert!(PORTS_MAX <= u16::BITS as usize, "a bit for each port");

impl Events {
    pub(crate) const fn new() -> Self {
        Self { completed: 0, log: Deque::new(), listens: 0 }
    }

    /// Logs a message to the own unit and its outcome.
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

    /// Whether `port` is in listen-only mode.
    pub(crate) fn listens_only(&self, port: PortId) -> bool {
        self.listens & bit(port) != 0
    }

    /// Puts `port` into listen-only mode.
    pub(crate) fn listen_only(&mut self, port: PortId) {
        self.listens |= bit(port);
        self.push(RECEIVED);
        self.push(BEGAN_TO_LISTEN);
    }

    /// Logs a message received in listen-only mode.
    pub(crate) fn listened(&mut self) {
        self.push(RECEIVED | LISTENED);
    }

    /// Ends listen-only mode at `port`, and resets the counter.
    pub(crate) fn restart(&mut self, port: PortId, clears_log: bool) {
        self.listens &= !bit(port);
        self.clear_count();
        if clears_log {
            self.log.clear();
        }
        self.push(RESTARTED);
    }

    /// Resets the event counter.
    pub(crate) fn clear_count(&mut self) {
        self.completed = 0;
    }

    fn push(&mut self, event: u8) {
        if self.log.is_full() {
            self.log.pop_front();
        }
        // Room was made above.
        let _ = self.log.push_back(event);
    }

    /// Status word (no program is running) and event counter.
    pub(crate) fn counter(&self) -> [u8; 4] {
        let [high, low] = self.completed.to_be_bytes();
        [0, 0, high, low]
    }

    /// Events in the log.
    pub(crate) fn len(&self) -> usize {
        self.log.len()
    }

    /// The events, newest first.
    pub(crate) fn newest_first(&self) -> impl Iterator<Item = u8> {
        self.log.iter().rev().copied()
    }
}

fn bit(port: PortId) -> u16 {
    1 << port.index()
}
