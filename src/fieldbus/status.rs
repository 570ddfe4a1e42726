//! The status of the Modbus devices, as numbers (2031h, 2032h, 2180h and following).

use embassy_time::Instant;

use super::shared::EthercatState;
use crate::scanner::DeviceStatus;
use crate::settings::OnSilence;

/// The bit of a state that toggles with every response.
const TURNS: u16 = 1 << 7;

/// Health of a device. 0: not polled yet; 1: responds; 2: faulty.
fn health(status: &DeviceStatus) -> u8 {
    match status.alive {
        None => 0,
        Some(true) => 1,
        Some(false) => 2,
    }
}

impl EthercatState {
    /// The health of the slave `nth`.
    pub(super) fn health(&self, nth: usize) -> u8 {
        self.slave_status(nth).map_or(0, |status| health(&status))
    }

    /// State of its inputs. 0: as read; 1, 2, 3: held, cleared, substituted.
    fn inputs_are(&self, nth: usize, status: &DeviceStatus) -> u8 {
        if health(status) != 2 {
            return 0;
        }
        self.configuration(|configuration| {
            match configuration.slaves().get(nth).map(|slave| slave.on_silence) {
                None | Some(OnSilence::Hold) => 1,
                Some(OnSilence::Clear) => 2,
                Some(OnSilence::Substitute) => 3,
            }
        })
    }

    /// The complete status in 16 bits (2032h).
    pub(crate) fn state_word(&self, nth: usize) -> u16 {
        let Some(status) = self.slave_status(nth) else { return 0 };
        let inputs = self.inputs_are(nth, &status);
        let turns = if status.responses & 1 == 1 { TURNS } else { 0 };
        u16::from_le_bytes([health(&status) | inputs << 2, status.exception]) | turns
    }

    /// The entries of 2180h and following.
    pub(super) fn status_number(&self, nth: usize, sub: usize) -> Option<u32> {
        let status = self.slave_status(nth);
        // A device that does not exist has never responded.
        let never = if sub == 1 { u32::MAX } else { 0 };
        let Some(status) = status else { return (sub <= 8).then_some(never) };
        Some(match sub {
            0 => health(&status).into(),
            1 if status.last_response == Instant::MIN => never,
            1 => u32::try_from(status.last_response.elapsed().as_millis()).unwrap_or(u32::MAX),
            2 => status.exception.into(),
            3 => status.error.map_or(0, |error| error as u32),
            4 => status.requests,
            5 => status.responses,
            6 => status.exceptions,
            7 => status.failures,
            8 => self.inputs_are(nth, &status).into(),
            _ => return None,
        })
    }
}
