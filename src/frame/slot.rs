//! A slot of the pool: the memory of one frame.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::WakerRegistration;

use super::envelope::Envelope;
use super::transaction::Transaction;
use crate::modbus::PDU_BYTES_MAX;

/// How complete a frame's PDU is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fill {
    /// More bytes follow.
    Filling,
    /// All bytes have arrived.
    Complete,
    /// The writer gave up: the content must not be used.
    Broken,
}

/// Storage of one frame. Boards keep an array of them in a static; it is all zeros at start.
pub struct Slot(pub(super) Mutex<CriticalSectionRawMutex, RefCell<SlotState>>);

pub(super) struct SlotState {
    pub(super) envelope: Option<Envelope>,
    pub(super) transaction: Transaction,
    pub(super) pdu: [u8; PDU_BYTES_MAX],
    pub(super) length: u8,
    /// The final length of the PDU, or 0 while unknown.
    pub(super) expected: u8,
    /// The CRC of unit and PDU while unchecked (for an ASCII frame, one that is right or wrong as its LRC is), and how many of its
    /// bytes have arrived.
    pub(super) crc: [u8; 2],
    pub(super) crc_bytes: u8,
    /// Handles to this slot, including the writer's; 0: free.
    pub(super) handles: u8,
    pub(super) fill: Fill,
    /// Index + 1 of the next slot in the same list or channel; 0: none.
    pub(super) next: u16,
    /// Index + 1 of the first frame merged into this one; 0: none.
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

    /// Stores `pdu`, truncated to the length of a PDU.
    pub(super) fn put(&mut self, pdu: &[u8]) {
        let length = pdu.len().min(PDU_BYTES_MAX);
        if let (Some(place), Some(pdu)) = (self.pdu.get_mut(..length), pdu.get(..length)) {
            place.copy_from_slice(pdu);
        }
        self.length = length as u8;
        self.fill = Fill::Complete;
    }

    /// Number of bytes that have arrived.
    pub(super) fn arrived(&self) -> usize {
        let check = if self.fill == Fill::Complete { 0 } else { self.crc_bytes };
        usize::from(self.length) + usize::from(check)
    }
}

/// The PDU would be longer than [`PDU_BYTES_MAX`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("longer than a PDU may be")]
pub struct FrameFull;
