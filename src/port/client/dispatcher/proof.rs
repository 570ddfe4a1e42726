//! Proofs: what a unit is asked before a request whose response could be taken for another one.

use core::cell::Cell;

use embassy_time::Instant;

use super::{Dispatcher, Proving};
use crate::frame::Frame;

impl<'g> Dispatcher<'g> {
    /// Whether the [`Dispatcher::request`] for `request` is a proof.
    pub(crate) fn is_proving(&self, request: &Frame<'g>) -> bool {
        self.proof(request).is_some()
    }

    /// What is sent before `request`.
    pub(super) fn proof(&self, request: &Frame<'g>) -> Option<Proving> {
        self.proof_slot(request.target())?.get()
    }

    pub(super) fn set_proof(&self, unit: u8, proof: Option<Proving>) {
        self.proof_slot(unit).into_iter().for_each(|slot| slot.set(proof));
    }

    /// That of the connection that has the server of `unit`.
    pub(super) fn proof_slot(&self, unit: u8) -> Option<&Cell<Option<Proving>>> {
        let connection = if self.has_one_connection() { 0 } else { self.servers().connection(unit)? };
        self.proofs.get(usize::from(connection))
    }

    /// `unit` has answered the proof that `request` waited for, which waits for its turn again: by then others may share its transaction.
    pub(crate) fn proved(&self, request: &Frame<'g>, unit: u8) {
        self.port_state.units(|units| units.proved(unit));
        self.take_back(request);
    }

    /// The proof got no response, and so `request` gets none, unless the unit has answered something else.
    pub(crate) fn not_proved(&self, request: &Frame<'g>, unit: u8, down_after: u8, retries: u8) {
        // Who spares servers by himself is not held back.
        let down_after = if request.envelope().paced { 0 } else { down_after };
        if self.port_state.units(|units| units.not_proved(unit, Instant::now(), down_after)) {
            self.failed(request, retries);
        } else {
            self.take_back(request);
        }
    }

    /// `request` waits for its turn again, and so do those that ride on it, each by itself.
    pub(crate) fn take_back(&self, request: &Frame<'g>) {
        let Some((frame, transaction)) = self.take(request) else { return };
        transaction.split(&frame);
        self.postpone_each(frame);
    }

    /// `request` and those that ride on it wait on, each by itself.
    pub(super) fn postpone_each(&self, request: Frame<'g>) {
        while let Some(merged) = request.unload() {
            self.postpone(merged);
        }
        self.postpone(request);
    }
}
