//! A board that takes new firmware, for tests of updates by console and by the web interface.

use std::cell::Cell;

use mobgate::hal::{FirmwareState, System};

/// A board that counts its restarts.
#[derive(Default)]
pub(crate) struct Board {
    pub(crate) restarts: Cell<u32>,
    pub(crate) tokens: Cell<u8>,
    pub(crate) firmware: Option<FirmwareState>,
}

impl System for Board {
    fn name(&self) -> &str {
        "board"
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        hash.is_some() && password == "let me in"
    }

    fn random(&self, into: &mut [u8]) -> bool {
        self.tokens.set(self.tokens.get() + 1);
        into.fill(self.tokens.get());
        true
    }

    fn firmware(&self) -> Option<FirmwareState> {
        self.firmware.clone()
    }

    fn reboot(&self) {
        self.restarts.set(self.restarts.get() + 1);
    }
}

/// Bytes of an image.
pub(crate) fn image(length: usize) -> Vec<u8> {
    (0..length).map(|at| (at * 31 + at / 256) as u8).collect()
}
