//! The frame pool: every request and its response share one slot, on the way from the port that received the request and back.
//!
//! A server-side port takes a frame, fills it with a PDU and an [`Envelope`], and sends it to the router, which passes it on to
//! the destination's queue and so to the client-side port; the response overwrites the request, and the frame returns. A
//! transaction therefore costs one slot and no other allocation, and every channel has room by construction. A [`Frame`] can be
//! passed on while its [`FrameWriter`] is still filling it: readers wait for more with [`Frame::more_than`], and a writer dropped
//! before it has finished marks the frame broken.
//!
//! The first slots are reserved, one per owner number; the rest are shared. So an owner can always have one frame, regardless of
//! how many others are in use.

use core::cell::RefCell;
use core::future::poll_fn;
use core::mem;
use core::task::Poll;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;

use crate::modbus::{PDU_BYTES_MAX, Pdu};
use crate::settings::Sharing;

mod channel;
mod envelope;
mod merged;
mod slot;
mod transaction;
mod writer;

#[doc(hidden)] // Public for tests/ only.
pub use self::channel::Channel;
#[doc(hidden)] // Public for tests/ only.
pub use self::envelope::{Cause, Envelope, Origin, ReplyTo, Stage};
pub use self::slot::Slot;
use self::slot::SlotState;
#[doc(hidden)] // Public for tests/ only.
pub use self::slot::{Fill, FrameFull};
pub(crate) use self::transaction::Transaction;
#[doc(hidden)] // Public for tests/ only.
pub use self::writer::FrameWriter;

/// The pool over a board's slots.
pub struct FramePool<'p> {
    slots: &'p [Slot],
    reserved: usize,
    shared: Mutex<CriticalSectionRawMutex, RefCell<Shared>>,
}

/// The free shared slots: those used before in a list, the others by number.
struct Shared {
    /// First of the list: index + 1; 0: empty.
    first: u16,
    /// Slots from here on have never been used.
    fresh: usize,
}

impl<'p> FramePool<'p> {
    /// A pool over `slots`, of which the first `reserved` belong to owners 0 to `reserved - 1`.
    pub const fn new(slots: &'p [Slot], reserved: usize) -> Self {
        Self { slots, reserved, shared: Mutex::new(RefCell::new(Shared { first: 0, fresh: reserved })) }
    }

    /// Like [`take`](FramePool::take), with `pdu` and `envelope` filled in; also `None` if the PDU is longer than
    /// [`PDU_BYTES_MAX`].
    pub fn fill(&'p self, owner: usize, pdu: &[u8], envelope: Envelope) -> Option<Frame<'p>> {
        if pdu.len() > PDU_BYTES_MAX {
            return None;
        }
        self.claim(owner, Some((pdu, &envelope)))
    }

    /// A frame for `owner`, empty or with this content.
    fn claim(&'p self, owner: usize, content: Option<(&[u8], &Envelope)>) -> Option<Frame<'p>> {
        let own = owner < self.reserved && self.with(owner, |slot| slot.handles) == Some(0);
        let index = if own { owner } else { self.take_shared()? };
        self.with(index, |slot| {
            slot.handles = 1;
            slot.restart();
            slot.envelope = content.map(|(_, envelope)| *envelope);
            if let Some((pdu, _)) = content {
                slot.put(pdu);
            }
        })?;
        Some(Frame { pool: self, index: index as u16 })
    }

    /// Number of free frames.
    pub fn free(&self) -> usize {
        let free = |slot: &&Slot| slot.0.lock(|slot| slot.borrow().handles == 0);
        self.slots.iter().filter(free).count()
    }

    /// Number of frames in the pool.
    pub fn capacity(&self) -> usize {
        self.slots.len()
    }

    fn take_shared(&self) -> Option<usize> {
        self.shared.lock(|shared| {
            let mut shared = shared.borrow_mut();
            if let Some(index) = usize::from(shared.first).checked_sub(1) {
                shared.first = self.with(index, |slot| mem::take(&mut slot.next))?;
                return Some(index);
            }
            let index = shared.fresh;
            (index < self.slots.len()).then(|| shared.fresh += 1)?;
            Some(index)
        })
    }

    fn release(&self, index: usize) {
        if index < self.reserved {
            return;
        }
        self.shared.lock(|shared| {
            let mut shared = shared.borrow_mut();
            self.with(index, |slot| slot.next = shared.first);
            shared.first = index as u16 + 1;
        });
    }

    fn with<R>(&self, index: usize, f: impl FnOnce(&mut SlotState) -> R) -> Option<R> {
        // `try_borrow_mut` cannot fail: no closure here calls back into the pool for the same slot.
        self.slots.get(index)?.0.lock(|slot| slot.try_borrow_mut().ok().map(|mut slot| f(&mut slot)))
    }
}

/// A handle to a frame; the slot is free again when the last one is dropped.
#[doc(hidden)] // Public for tests/ only.
pub struct Frame<'p> {
    pool: &'p FramePool<'p>,
    index: u16,
}

impl<'p> Frame<'p> {
    /// The envelope; empty only in a frame that was never addressed.
    pub fn envelope(&self) -> Envelope {
        let mut envelope = Envelope::EMPTY;
        self.with(|slot| {
            if let Some(there) = &slot.envelope {
                envelope = *there;
            }
        });
        envelope
    }

    /// What `of` reads from the envelope: less work than a copy of all of it.
    pub(crate) fn read<R>(&self, of: impl Fn(&Envelope) -> R) -> R {
        let there = self.with(|slot| slot.envelope.as_ref().map(&of)).flatten();
        there.unwrap_or_else(|| of(&Envelope::EMPTY))
    }

    /// The requester, which waits for the response.
    pub fn origin(&self) -> Origin {
        self.read(|envelope| envelope.origin)
    }

    /// Replaces the envelope.
    pub fn address(&self, envelope: Envelope) {
        self.with(|slot| slot.envelope = Some(envelope));
    }

    /// The unit id on the destination's side.
    pub fn target(&self) -> u8 {
        self.read(|envelope| envelope.target)
    }

    /// Whether the frame holds the request or the response.
    pub fn stage(&self) -> Stage {
        self.read(|envelope| envelope.stage)
    }

    /// How it may share transactions and cached responses.
    pub fn sharing(&self) -> Sharing {
        self.read(|envelope| envelope.sharing)
    }

    /// Sets whether the frame holds the request or the response.
    pub fn set_stage(&self, stage: Stage) {
        self.amend(|envelope| envelope.stage = stage);
    }

    /// Changes the envelope.
    pub(crate) fn amend(&self, change: impl FnOnce(&mut Envelope)) {
        self.with(|slot| slot.envelope.as_mut().map(change));
    }

    /// Records the cause of the exception that the request will get.
    pub fn blame(&self, cause: Cause) {
        self.amend(|envelope| envelope.cause = cause);
    }

    /// The client-side port's state of the transaction.
    pub(crate) fn transaction(&self) -> Transaction {
        let mut transaction = Transaction::NONE;
        self.with(|slot| transaction = slot.transaction);
        transaction
    }

    /// Changes the state of the transaction.
    pub(crate) fn amend_transaction(&self, change: impl FnOnce(&mut Transaction)) {
        self.with(|slot| change(&mut slot.transaction));
    }

    /// A second handle to the frame, with `transaction` stored in it.
    pub(crate) fn share_for(&self, transaction: Transaction) -> Self {
        self.with(|slot| {
            slot.transaction = transaction;
            slot.handles += 1;
        });
        Self { pool: self.pool, index: self.index }
    }

    /// Calls `f` with the bytes of the PDU that have arrived.
    pub fn pdu<R: Default>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.with(|slot| slot.pdu.get(..usize::from(slot.length)).map(f)).flatten().unwrap_or_default()
    }

    /// The bytes of the PDU that have arrived.
    pub fn content(&self) -> Pdu {
        let mut content = Pdu::new();
        // Fits: no longer than a PDU may be.
        self.pdu(|pdu| content.extend_from_slice(pdu).unwrap_or_default());
        content
    }

    /// The function code; 0 before it has arrived.
    pub fn function(&self) -> u8 {
        self.pdu(|pdu| pdu.first().copied().unwrap_or(0))
    }

    /// Number of bytes that have arrived, and the fill state. The CRC of an incomplete frame counts.
    pub fn filled(&self) -> (usize, Fill) {
        self.with(|slot| (slot.arrived(), slot.fill)).unwrap_or((0, Fill::Broken))
    }

    /// The final length of the PDU, once the writer knows it.
    pub fn expected(&self) -> Option<usize> {
        self.with(|slot| usize::from(slot.expected)).filter(|&length| length > 0)
    }

    /// The part of the CRC that has arrived, for a frame that is being cut through.
    pub fn crc(&self) -> ([u8; 2], usize) {
        self.with(|slot| (slot.crc, usize::from(slot.crc_bytes))).unwrap_or_default()
    }

    /// The received CRC of a cut-through frame, if its unit id is not translated.
    pub(crate) fn own_crc(&self) -> Option<u16> {
        let is_translated = self.read(|envelope| envelope.unit != envelope.target);
        let (crc, there) = self.crc();
        (there == crc.len() && !is_translated).then(|| u16::from_le_bytes(crc))
    }

    /// Marks the frame broken if it is still being filled, for a destination that needs a complete frame; returns whether it was.
    pub fn abandon(&self) -> bool {
        let abandoned = self.with(|slot| {
            let filling = slot.fill == Fill::Filling;
            if filling {
                slot.fill = Fill::Broken;
                slot.waiting.wake();
            }
            filling
        });
        abandoned == Some(true)
    }

    /// Waits until more than `length` bytes have arrived, or filling has ended. One waiter at a time.
    pub fn more_than(&self, length: usize) -> impl Future<Output = (usize, Fill)> {
        poll_fn(move |cx| {
            let (filled, fill) = self.filled();
            if filled > length || fill != Fill::Filling {
                return Poll::Ready((filled, fill));
            }
            self.with(|slot| slot.waiting.register(cx.waker()));
            Poll::Pending
        })
    }

    /// Replaces the content by `pdu`, which must fit.
    pub fn replace(&self, pdu: &[u8]) -> Result<(), FrameFull> {
        let replaced = self.with(|slot| {
            slot.restart();
            if pdu.len() <= PDU_BYTES_MAX {
                slot.put(pdu);
            } else {
                slot.fill = Fill::Broken;
            }
            slot.waiting.wake();
            slot.fill == Fill::Complete
        });
        if replaced == Some(true) { Ok(()) } else { Err(FrameFull) }
    }

    /// Whether both are handles to the same frame.
    pub fn is(&self, other: &Self) -> bool {
        self.index == other.index
    }

    /// Whether both are complete, with the same PDU.
    pub fn same_pdu(&self, other: &Self) -> bool {
        let complete = |frame: &Self| frame.filled().1 == Fill::Complete;
        complete(self) && complete(other) && self.pdu(|pdu| other.pdu(|twin| pdu == twin))
    }

    /// A second handle to the same frame.
    pub fn share(&self) -> Self {
        self.with(|slot| slot.handles += 1);
        Self { pool: self.pool, index: self.index }
    }

    /// Drops this handle and returns how many are left; `None` if it is the last of a frame with merged ones, which go first.
    fn release_handle(&self) -> Option<u8> {
        self.with(|slot| {
            let has_merged = slot.handles == 1 && slot.merged != 0;
            slot.handles = slot.handles.saturating_sub(u8::from(!has_merged));
            (!has_merged).then_some(slot.handles)
        })
        .flatten()
    }

    fn with<R>(&self, f: impl FnOnce(&mut SlotState) -> R) -> Option<R> {
        self.pool.with(usize::from(self.index), f)
    }
}

impl Drop for Frame<'_> {
    fn drop(&mut self) {
        let left = self.release_handle().or_else(|| {
            while self.take_merged().is_some() {}
            self.release_handle()
        });
        if left == Some(0) {
            self.pool.release(usize::from(self.index));
        }
    }
}
