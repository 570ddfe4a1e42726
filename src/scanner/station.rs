//! A device as the scanner sees it: what it was asked last, whether it answers, and when it is tried again.

use embassy_time::{Duration, Instant};

use super::byte_order::ByteOrder;
use super::status::ErrorCode;

/// How often a request is repeated that gets no response.
pub const REPEATS: u8 = 2;
/// How long a device that gives no response is left alone at first.
pub const BACK_OFF_FIRST: Duration = Duration::from_secs(15);
/// By how much that grows with every attempt that fails.
pub const BACK_OFF_STEP: Duration = Duration::from_secs(2);
/// And how long it can become.
pub const BACK_OFF_LONGEST: Duration = Duration::from_secs(30);

/// A device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Device {
    /// Its unit id, as the routing rules of the scanner's port see it.
    pub unit: u8,
    /// How values of 32 bits come from it.
    pub order: ByteOrder,
    /// Before every poll it is asked for a sign of life (function 8), and left out when it gives none.
    pub check: bool,
    /// What its inputs become when it does not answer any more: each register this, each bit its lowest one; none: they stay.
    pub filling: Option<u16>,
}

/// How a device is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceStatus {
    /// Whether it answered when it was asked last; none: it has not been asked yet.
    pub alive: Option<bool>,
    /// When it answered last; [`Instant::MIN`]: never.
    pub last_response: Instant,
    /// The exception of its last negative answer; 0: none.
    pub exception: u8,
    /// What went wrong last.
    pub error: Option<ErrorCode>,
    /// Requests sent, repeats included.
    pub requests: u32,
    /// Answers, exceptions included.
    pub responses: u32,
    /// Of the responses, the exceptions.
    pub exceptions: u32,
    /// Requests without a response, for whatever reason.
    pub failures: u32,
    /// Until when it is left alone, if it is.
    pub backs_off_until: Option<Instant>,
}

/// What a device is being asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Open {
    /// For a sign of life.
    Check,
    /// For the cells of rows from `first` on.
    Read { first: u16 },
    /// To take the cells of rows.
    Write,
    /// To change a bit of a register (function 22).
    Mask,
    /// For the register of which a bit is to be changed, since it cannot do that itself.
    Fetch,
    /// To take the register with the bit changed, which was this before.
    Store { register: u16 },
}

/// A device and what is happening to it.
pub(super) struct Station {
    pub(super) device: Device,
    pub(super) open: Option<Open>,
    /// What got no response and is repeated, or is the second part of what is under way: before anything else.
    pub(super) repeats: Option<Open>,
    /// Something may be marked.
    pub(super) pending: bool,
    /// It has refused to change single bits of registers (function 22): they are read and written instead.
    pub(super) refuses_masks: bool,
    /// Rows that were marked for reading from this turn on want a check first. It is good for all that are marked by the time
    /// that it is answered: they are one poll, however late the line is.
    pub(super) check_from: Option<u32>,
    /// Requests without a response since the last one.
    silent: u8,
    /// How long it was left alone last; zero: not at all.
    back_off: Duration,
    /// It is left alone until then.
    pub(super) held: Instant,
    pub(super) status: DeviceStatus,
}

impl Station {
    pub(super) const fn new(device: Device) -> Self {
        Self {
            device,
            open: None,
            repeats: None,
            pending: false,
            refuses_masks: false,
            check_from: None,
            silent: 0,
            back_off: Duration::from_ticks(0),
            held: Instant::MIN,
            status: DeviceStatus {
                alive: None,
                last_response: Instant::MIN,
                exception: 0,
                error: None,
                requests: 0,
                responses: 0,
                exceptions: 0,
                failures: 0,
                backs_off_until: None,
            },
        }
    }

    /// It is asked.
    pub(super) fn asked(&mut self, open: Open) {
        (self.open, self.repeats) = (Some(open), None);
        self.status.requests = self.status.requests.wrapping_add(1);
    }

    /// It has answered, by `exception` if that is not 0.
    pub(super) fn answered(&mut self, now: Instant, exception: u8) {
        self.silent = 0;
        self.back_off = Duration::from_ticks(0);
        let status = &mut self.status;
        status.alive = Some(true);
        status.last_response = now;
        status.responses = status.responses.wrapping_add(1);
        if exception != 0 {
            status.exception = exception;
            status.exceptions = status.exceptions.wrapping_add(1);
            status.error = Some(ErrorCode::of_exception(exception));
        }
    }

    /// It has not answered. Says whether the request is to be repeated; else the device is left alone.
    pub(super) fn failed(&mut self, now: Instant, error: ErrorCode) -> bool {
        self.not_sent(error);
        self.silent = self.silent.saturating_add(1);
        if self.silent <= REPEATS {
            return true;
        }
        self.status.alive = Some(false);
        self.back_off = match self.back_off.as_ticks() {
            0 => BACK_OFF_FIRST,
            _ => (self.back_off + BACK_OFF_STEP).min(BACK_OFF_LONGEST),
        };
        self.held = now + self.back_off;
        false
    }

    /// It was to be asked, and could not be.
    pub(super) fn not_sent(&mut self, error: ErrorCode) {
        self.status.failures = self.status.failures.wrapping_add(1);
        self.status.error = Some(error);
    }

    pub(super) fn is_held(&self, now: Instant) -> bool {
        self.held > now
    }
}
