//! In-step proofs: a harmless request sent ahead of one whose response could be confused with a late response.

use core::cell::Cell;

use embassy_time::Instant;

use super::{Dispatcher, Proving};
use crate::frame::Frame;

impl<'g> Dispatcher<'g> {
    /// Whether a proof goes ahead of `request`.
    pub(crate) fn is_proving(&self, request: &Frame<'g>) -> bool {
        self.proof(request).is_some()
    }

    /// The proof to send before `request`.
    pub(super) fn proof(&self, request: &Frame<'g>) -> Option<Proving> {
        self.proof_slot(|| request.target())?.get()
    }

    pub(super) fn set_proof(&self, unit: u8, proof: Option<Proving>) {
        self.proof_slot(|| unit).into_iter().for_each(|slot| slot.set(proof));
    }

    /// The slot of the connection that serves `unit`, which is only called if there are several.
    pub(super) fn proof_slot(&self, unit: impl FnOnce() -> u8) -> Option<&Cell<Option<Proving>>> {
        let connection = if self.has_one_connection() { 0 } else { self.servers().connection(unit())? };
        self.proofs.get(usize::from(connection))
    }

    /// Handles the response of `unit` to the proof for `request`. The request is queued again, since others may now share its
    /// transaction.
    pub(crate) fn proved(&self, request: &Frame<'g>, unit: u8) {
        self.port_state.units(|units| units.proved(unit));
        self.requeue(request);
    }

    /// Handles that the proof got no response: `request` fails, unless the unit has sent something else meanwhile.
    pub(crate) fn not_proved(&self, request: &Frame<'g>, unit: u8, down_after: u8, retries: u8) {
        // A requester with its own back-off is not blocked by the gateway's.
        let down_after = if request.read(|envelope| envelope.paced) { 0 } else { down_after };
        if self.port_state.units(|units| units.not_proved(unit, Instant::now(), down_after)) {
            self.failed(request, retries);
        } else {
            self.requeue(request);
        }
    }

    /// Queues `request` and the requests merged into it again, separately.
    pub(crate) fn requeue(&self, request: &Frame<'g>) {
        let Some(frame) = self.end_transaction(request) else { return };
        frame.transaction().split(&frame);
        self.postpone_each(frame);
    }

    /// Postpones `request` and the requests merged into it, separately.
    pub(super) fn postpone_each(&self, request: Frame<'g>) {
        while let Some(merged) = request.take_merged() {
            self.postpone(merged);
        }
        self.postpone(request);
    }
}
