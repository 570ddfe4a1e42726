//! The log of the last transactions.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Instant;
use heapless::Deque;

use crate::modbus::Exception;
use crate::settings::PortId;

/// Transactions in the log.
pub const LOG_ENTRIES_MAX: usize = 64;

/// One finished transaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogEntry {
    /// When it ended.
    pub at: Instant,
    /// The port that received the request.
    pub source: PortId,
    /// The destination port, if a rule named one.
    pub destination: Option<PortId>,
    /// The unit id on the requester's side.
    pub unit: u8,
    /// The unit on the destination's side.
    pub target: u8,
    /// Function code of the request.
    pub function: u8,
    /// How it ended.
    pub outcome: Outcome,
    /// From the complete request to the response, in microseconds.
    pub took_us: u32,
}

/// How a transaction ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// With a response.
    Response,
    /// With an exception, of the device or of the gateway.
    Exception(Exception),
    /// Without a response: a broadcast, or dropped by a rule.
    Silence,
    /// The requester was gone.
    RequesterGone,
}

/// The last transactions, oldest first.
pub struct Log(Mutex<CriticalSectionRawMutex, RefCell<Deque<LogEntry, LOG_ENTRIES_MAX>>>);

impl Log {
    /// An empty log.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(Deque::new())))
    }

    /// Appends `entry`, and drops the oldest one if the log is full.
    pub fn push(&self, entry: LogEntry) {
        self.0.lock(|log| {
            let mut log = log.borrow_mut();
            if log.is_full() {
                log.pop_front();
            }
            // Room was made above.
            let _ = log.push_back(entry);
        });
    }

    /// The entry `back` steps before the newest one.
    pub fn newest(&self, back: usize) -> Option<LogEntry> {
        self.0.lock(|log| log.borrow().iter().rev().nth(back).copied())
    }

    /// Clears the log.
    pub fn clear(&self) {
        self.0.lock(|log| log.borrow_mut().clear());
    }
}
