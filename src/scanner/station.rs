//! A device as the scanner sees it: its pending request, whether it responds, and when it is tried again.

use embassy_time::{Duration, Instant};

use super::byte_order::ByteOrder;
use super::status::ErrorCode;

/// How often a request without response is repeated.
pub const REPEATS: u8 = 2;
/// How long a device that does not respond backs off at first.
pub const BACK_OFF_FIRST: Duration = Duration::from_secs(15);
/// Growth of the back-off with every failed attempt.
pub const BACK_OFF_STEP: Duration = Duration::from_secs(2);
/// The longest back-off.
pub const BACK_OFF_LONGEST: Duration = Duration::from_secs(30);

/// A device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Device {
    /// Its unit id, as the rules of the scanner's port see it.
    pub unit: u8,
    /// The order of the bytes in its 32-bit values.
    pub order: ByteOrder,
    /// Check for a sign of life (function 8) before every poll; the device is left out of the poll if there is none.
    pub check: bool,
    /// Substitute for its inputs when it does not respond: this value for each register, its lowest bit for each bit; `None`:
    /// unchanged.
    pub filling: Option<u16>,
}

/// The status of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceStatus {
    /// Whether it responded last time; `None`: not asked yet.
    pub alive: Option<bool>,
    /// When it responded last; [`Instant::MIN`]: never.
    pub last_response: Instant,
    /// The code of its last exception; 0: none.
    pub exception: u8,
    /// The last error.
    pub error: Option<ErrorCode>,
    /// Requests sent, including repeats.
    pub requests: u32,
    /// Responses, including exceptions.
    pub responses: u32,
    /// Of the responses, the exceptions.
    pub exceptions: u32,
    /// Requests without a response, for whatever reason.
    pub failures: u32,
    /// End of the back-off, if any.
    pub backs_off_until: Option<Instant>,
}

/// The kind of a pending request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Open {
    /// A check for a sign of life.
    Check,
    /// A read of rows' cells from `first` on.
    Read { first: u16 },
    /// A write of rows' cells.
    Write,
    /// A change of one bit of a register (function 22).
    Mask,
    /// A read of the register of which a bit is to change, as the device cannot do that itself.
    Fetch,
    /// A write of the register with the bit changed; its previous value.
    Store { register: u16 },
}

/// A device with its state.
pub(super) struct Station {
    pub(super) device: Device,
    pub(super) open: Option<Open>,
    /// A request to repeat, or the second half of one, ahead of anything else.
    pub(super) repeats: Option<Open>,
    /// Something may be marked.
    pub(super) pending: bool,
    /// It refuses function 22: its registers are read and written to change bits.
    pub(super) refuses_masks: bool,
    /// Rows marked for reading from this turn on need a check first. One check is good for all rows marked before it is answered:
    /// they are one poll, however slow the line is.
    pub(super) check_from: Option<u32>,
    /// Requests without response since the last response.
    silent: u8,
    /// `backs_off_until` stays when that time is over.
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

    /// Records that a request is sent.
    pub(super) fn asked(&mut self, open: Open) {
        (self.open, self.repeats) = (Some(open), None);
        self.status.requests = self.status.requests.wrapping_add(1);
    }

    /// Records a response, with `exception` if that is not 0.
    pub(super) fn answered(&mut self, now: Instant, exception: u8) {
        self.silent = 0;
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

    /// Records a missing response. Returns whether to repeat the request; otherwise the device backs off.
    pub(super) fn failed(&mut self, now: Instant, error: ErrorCode) -> bool {
        self.not_sent(error);
        self.silent = self.silent.saturating_add(1);
        let Some(before) = self.silent.checked_sub(REPEATS + 1) else { return true };
        self.status.alive = Some(false);
        let back_off = BACK_OFF_FIRST + BACK_OFF_STEP * u32::from(before);
        self.hold(now + back_off.min(BACK_OFF_LONGEST));
        false
    }

    /// Records that a request to it could not be sent.
    pub(super) fn not_sent(&mut self, error: ErrorCode) {
        self.status.failures = self.status.failures.wrapping_add(1);
        self.status.error = Some(error);
    }

    /// Lets it back off.
    pub(super) fn hold(&mut self, until: Instant) {
        self.status.backs_off_until = Some(until);
    }

    /// The end of the back-off, or of the last one.
    pub(super) fn held(&self) -> Instant {
        self.status.backs_off_until.unwrap_or(Instant::MIN)
    }

    pub(super) fn is_held(&self, now: Instant) -> bool {
        self.held() > now
    }
}
