//! Emergencies: unsolicited messages about an error or its end (ETG.1000.6, clause 5.6.4).

use super::service::Service;
use crate::al_state::AlStatusCode;
use crate::mailbox::Payload;

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// SafeOp was refused.
    SafeOpRefused,
    /// Op was refused.
    OpRefused,
    /// Process data stopped or were reconfigured while in use.
    ProcessDataLost,
}

impl Cause {
    const ALL: [Self; 3] = [Self::SafeOpRefused, Self::OpRefused, Self::ProcessDataLost];

    const fn code(self) -> u16 {
        match self {
            Self::SafeOpRefused => 0xa000,
            Self::OpRefused => 0xa001,
            Self::ProcessDataLost => 0x8100,
        }
    }

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// An error, or its end, as an application reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emergency {
    /// The error code (CiA 301, 7.2.7.1); 0: the error has ended.
    pub code: u16,
    /// The error register.
    pub register: u8,
    /// Manufacturer-specific bytes.
    pub data: [u8; 5],
}

impl Emergency {
    pub(crate) fn message(self) -> Payload {
        Service::Emergency.message(&[&self.code.to_le_bytes(), &[self.register], &self.data])
    }
}

/// Error register: bit 0 generic, bit 4 communication.
const ERROR_REGISTER: u8 = 0x11;

/// Errors to report: one message per cause, even if it occurs repeatedly before it is sent.
#[derive(Debug, Default)]
pub struct Emergencies {
    pending: u8,
    reset: bool,
    reported: bool,
    code: u16,
}

impl Emergencies {
    /// Records an error, and the AL status code that it led to.
    pub fn raise(&mut self, cause: Cause, code: AlStatusCode) {
        self.pending |= cause.bit();
        self.code = code as u16;
    }

    /// The errors were acknowledged.
    pub fn clear(&mut self) {
        self.reset |= self.reported || self.pending != 0;
    }

    pub(super) fn is_pending(&self) -> bool {
        self.pending != 0 || self.reset
    }

    pub(super) fn next(&mut self) -> Option<Payload> {
        for cause in Cause::ALL {
            if self.pending & cause.bit() != 0 {
                self.pending &= !cause.bit();
                self.reported = true;
                return Some(message(cause.code(), ERROR_REGISTER, self.code));
            }
        }
        if core::mem::take(&mut self.reset) {
            self.reported = false;
            return Some(message(0, 0, 0));
        }
        None
    }
}

/// The AL status code comes first in the five manufacturer-specific bytes.
fn message(code: u16, register: u8, al_status_code: u16) -> Payload {
    let [low, high] = al_status_code.to_le_bytes();
    Emergency { code, register, data: [low, high, 0, 0, 0] }.message()
}

#[cfg(test)]
mod tests {
    use super::{Cause, Emergencies};
    use crate::al_state::AlStatusCode;

    #[test]
    fn a_cause_is_reported_once_until_it_comes_again() {
        let mut emergencies = Emergencies::default();
        for _ in 0..3 {
            emergencies.raise(Cause::ProcessDataLost, AlStatusCode::SyncManagerWatchdog);
        }
        assert_eq!(emergencies.next().unwrap()[..], [0x00, 0x10, 0x00, 0x81, 0x11, 0x1b, 0x00, 0, 0, 0]);
        assert!(emergencies.next().is_none());
    }

    #[test]
    fn the_end_is_reported_when_an_error_was_and_only_then() {
        let mut emergencies = Emergencies::default();
        emergencies.clear();
        assert!(!emergencies.is_pending());
        emergencies.raise(Cause::OpRefused, AlStatusCode::SyncManagerWatchdog);
        emergencies.clear();
        assert_eq!(emergencies.next().unwrap()[2..4], [0x01, 0xa0]);
        assert_eq!(emergencies.next().unwrap()[..], [0x00, 0x10, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert!(!emergencies.is_pending());
    }
}
