//! The input and output buffers, in the scanner's memory.

use core::cell::Cell;

use super::ranges::INPUTS;
use super::room::Room;
use super::shared::EthercatState;
use crate::settings::OnLoss;

impl EthercatState {
    /// Sizes of the buffers.
    pub fn most(&self) -> Room {
        // A constant on boards.
        if cfg!(feature = "long-images") && self.long { Room::LONG } else { Room::MOST }
    }

    /// Calls `f` with the last inputs read.
    pub fn inputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.scanner.with(|scanner| f(scanner.image(INPUTS, self.most().inputs)))
    }

    /// Calls `f` with the outputs to write.
    pub fn outputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        let Room { inputs, outputs } = self.most();
        self.scanner.with(|scanner| f(scanner.image(inputs, outputs)))
    }

    /// Takes outputs from a MainDevice in Op, written by `put`.
    pub(super) fn put_outputs(&self, put: impl FnOnce(&mut [u8])) {
        self.scanner.with(|scanner| {
            let Room { inputs, outputs } = self.most();
            put(scanner.image_mut(inputs, outputs));
            scanner.set_outputs(true);
        });
    }

    /// Applies the loss reaction, as no more outputs arrive.
    pub(super) fn outputs_stopped(&self) {
        let on_loss = self.state.lock(Cell::get).on_loss;
        self.scanner.with(|scanner| match on_loss {
            OnLoss::Hold => {}
            OnLoss::Clear => {
                let Room { inputs, outputs } = self.most();
                scanner.image_mut(inputs, outputs).fill(0);
            }
            OnLoss::Stop => scanner.set_outputs(false),
        });
    }
}
