//! A slot of the pool: the memory of one frame.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::WakerRegistration;

use super::envelope::Envelope;
use super::transaction::Transaction;
use crate::modbus::PDU_BYTES_MAX;

/// How far a frame's PDU is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// More bytes come.
    Filling,
    /// All bytes are there.
    Complete,
    /// The writer gave up: what is there must not be used.
    Broken,
}

/// Storage of one frame. Boards keep an array of them in a static; it is all zeros at start.
pub struct Slot(pub(super) Mutex<CriticalSectionRawMutex, RefCell<SlotState>>);

pub(super) struct SlotState {
    pub(super) envelope: Option<Envelope>,
    pub(super) transaction: Transaction,
    pub(super) pdu: [u8; PDU_BYTES_MAX],
    pub(super) length: u8,
    /// How long the PDU will be, once that is known; else 0.
    pub(super) expected: u8,
    /// The CRC of unit and PDU, as long as nobody knows whether it is good: as it came, or, of an ASCII frame, one that is as
    /// right or wrong as its LRC; and how much of it is there.
    pub(super) crc: [u8; 2],
    pub(super) crc_bytes: u8,
    /// Handles to this slot, the writer's included; 0: free.
    pub(super) handles: u8,
    pub(super) fill: Fill,
    /// The next slot in the list or channel that this one is in: its index + 1; 0: the last one.
    pub(super) next: u16,
    /// The first of the frames that ride on this one: its index + 1; 0: none.
    pub(super) merged: u16,
    pub(super) waiting: WakerRegistration,
}

impl Slot {
    /// A free slot.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(SlotState {
            envelope: None,
            transaction: Transaction::NONE,
            pdu: [0; PDU_BYTES_MAX],
            length: 0,
            expected: 0,
            crc: [0; 2],
            crc_bytes: 0,
            handles: 0,
            fill: Fill::Filling,
            next: 0,
            merged: 0,
            waiting: WakerRegistration::new(),
        })))
    }
}

impl SlotState {
    pub(super) fn restart(&mut self) {
        self.length = 0;
        self.expected = 0;
        self.crc_bytes = 0;
        self.fill = Fill::Filling;
    }

    /// Puts all of `pdu` here, of which what is longer than a PDU may be is left out.
    pub(super) fn put(&mut self, pdu: &[u8]) {
        let length = pdu.len().min(PDU_BYTES_MAX);
        if let (Some(place), Some(pdu)) = (self.pdu.get_mut(..length), pdu.get(..length)) {
            place.copy_from_slice(pdu);
        }
        self.length = length as u8;
        self.fill = Fill::Complete;
    }

    /// What is there.
    pub(super) fn arrived(&self) -> usize {
        let check = if self.fill == Fill::Complete { 0 } else { self.crc_bytes };
        usize::from(self.length) + usize::from(check)
    }
}

impl Default for Slot {
    fn default() -> Self {
        Self::new()
    }
}

/// The PDU would be longer than [`PDU_BYTES_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("longer than a PDU may be")]
pub struct FrameFull;
