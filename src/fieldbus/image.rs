//! The buffers of inputs and outputs, as the scanner has them.

use core::cell::Cell;

use super::ranges::INPUTS;
use super::room::Room;
use super::shared::EthercatState;
use crate::settings::OnLoss;

impl EthercatState {
    /// Bytes of the buffers.
    pub fn most(&self) -> Room {
        // On boards it is a constant.
        if cfg!(feature = "long-images") && self.long { Room::LONG } else { Room::MOST }
    }

    /// Calls `f` with what was read last.
    pub fn inputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.scanner.with(|scanner| f(scanner.image(INPUTS, self.most().inputs)))
    }

    /// Calls `f` with what is to be written.
    pub fn outputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        let Room { inputs, outputs } = self.most();
        self.scanner.with(|scanner| f(scanner.image(inputs, outputs)))
    }

    /// Takes outputs of a MainDevice in Op, which `put` writes.
    pub(super) fn put_outputs(&self, put: impl FnOnce(&mut [u8])) {
        self.scanner.with(|scanner| {
            let Room { inputs, outputs } = self.most();
            put(scanner.image_mut(inputs, outputs));
            scanner.set_outputs(true);
        });
    }

    /// No outputs come any more.
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
