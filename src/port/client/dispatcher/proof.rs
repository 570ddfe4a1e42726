//! Proofs: what a unit is asked before a request whose response could be taken for another one.

use core::cell::Cell;

use embassy_time::Instant;

use super::{Desk, Proving};
use crate::frame::Frame;

impl<'g> Desk<'g> {
    /// Whether the [`Desk::request`] for `order` is a proof.
    pub(crate) fn is_proving(&self, order: &Frame<'g>) -> bool {
        self.proof(order).is_some()
    }

    /// What is sent before `order`.
    pub(super) fn proof(&self, order: &Frame<'g>) -> Option<Proving> {
        self.proof_place(order.target())?.get()
    }

    pub(super) fn set_proof(&self, unit: u8, proof: Option<Proving>) {
        self.proof_place(unit).into_iter().for_each(|place| place.set(proof));
    }

    /// That of the link that has the server of `unit`.
    pub(super) fn proof_place(&self, unit: u8) -> Option<&Cell<Option<Proving>>> {
        let link = if self.has_one_link() { 0 } else { self.servers().link(unit)? };
        self.proofs.get(usize::from(link))
    }

    /// `unit` has answered the proof that `order` waited for, which waits for its turn again: by then others may share its transaction.
    pub(crate) fn proved(&self, order: &Frame<'g>, unit: u8) {
        self.place.units(|units| units.proved(unit));
        self.take_back(order);
    }

    /// The proof got no answer, and so `order` gets none, unless the unit has answered something else.
    pub(crate) fn not_proved(&self, order: &Frame<'g>, unit: u8, down_after: u8, retries: u8) {
        // Who spares servers by himself is not held back.
        let down_after = if order.envelope().paced { 0 } else { down_after };
        if self.place.units(|units| units.not_proved(unit, Instant::now(), down_after)) {
            self.failed(order, retries);
        } else {
            self.take_back(order);
        }
    }

    /// `order` waits for its turn again, and so do those that ride on it, each by itself.
    pub(crate) fn take_back(&self, order: &Frame<'g>) {
        let Some((frame, errand)) = self.take(order) else { return };
        errand.part(&frame);
        self.postpone_each(frame);
    }

    /// `order` and those that ride on it wait on, each by itself.
    pub(super) fn postpone_each(&self, order: Frame<'g>) {
        while let Some(rider) = order.unload() {
            self.postpone(rider);
        }
        self.postpone(order);
    }
}
