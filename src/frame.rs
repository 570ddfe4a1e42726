//! The frame pool: every request and its response live in one slot, from the port that received it and back to it.
//!
//! A server-side port takes a frame, fills it with a PDU and an [`Envelope`], and hands it on; the router, the
//! destination's queue and the client-side port pass the same frame along; the response is written into it and it
//! goes home. So a transaction costs one slot, nothing else is allocated on its way, and every channel has room by
//! construction. A [`Frame`] can be handed on while its [`FrameWriter`] is still filling it: readers wait for more
//! with [`Frame::more_than`], and a writer that is dropped unfinished leaves the frame broken.
//!
//! The first slots are reserved, one for each owner that asks with its number; the rest is shared. An owner can
//! always have one frame, however many the others hold.

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

pub use self::channel::Channel;
pub use self::envelope::{Cause, Envelope, Origin, ReplyTo, Stage};
use self::slot::SlotState;
pub use self::slot::{Fill, FrameFull, Slot};
pub(crate) use self::transaction::Transaction;

/// The pool over a board's slots.
pub struct FramePool<'p> {
    slots: &'p [Slot],
    reserved: usize,
    shared: Mutex<CriticalSectionRawMutex, RefCell<Shared>>,
}

/// The shared slots that are free: those that were used before in a list, those that never were by their number.
struct Shared {
    /// First of the list: index + 1; 0: empty.
    first: u16,
    /// Slots from here on have never been used.
    fresh: usize,
}

impl<'p> FramePool<'p> {
    /// A pool over `slots`, of which the first `reserved` belong to the owners 0 to `reserved - 1`.
    pub const fn new(slots: &'p [Slot], reserved: usize) -> Self {
        Self { slots, reserved, shared: Mutex::new(RefCell::new(Shared { first: 0, fresh: reserved })) }
    }

    /// A frame for `owner`: its reserved one if that is at home, else a shared one, else none.
    pub fn take(&'p self, owner: usize) -> Option<(FrameWriter<'p>, Frame<'p>)> {
        let frame = self.claim(owner, None)?;
        Some((FrameWriter { frame: frame.share() }, frame))
    }

    /// A frame for `owner`, as [`take`](FramePool::take) finds it, which holds all of `pdu` in its `envelope`; none also when the
    /// PDU is longer than [`PDU_BYTES_MAX`].
    pub fn fill(&'p self, owner: usize, pdu: &[u8], envelope: Envelope) -> Option<Frame<'p>> {
        if pdu.len() > PDU_BYTES_MAX {
            return None;
        }
        self.claim(owner, Some((pdu, envelope)))
    }

    /// A frame for `owner`, empty or with this content.
    fn claim(&'p self, owner: usize, content: Option<(&[u8], Envelope)>) -> Option<Frame<'p>> {
        let own = owner < self.reserved && self.with(owner, |slot| slot.handles) == Some(0);
        let index = if own { owner } else { self.take_shared()? };
        self.with(index, |slot| {
            slot.handles = 1;
            slot.restart();
            slot.envelope = content.map(|(_, envelope)| envelope);
            if let Some((pdu, _)) = content {
                slot.put(pdu);
            }
        })?;
        Some(Frame { pool: self, index: index as u16 })
    }

    /// Frames that nobody holds.
    pub fn free(&self) -> usize {
        let free = |slot: &&Slot| slot.0.lock(|slot| slot.borrow().handles == 0);
        self.slots.iter().filter(free).count()
    }

    /// Frames in the pool.
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
pub struct Frame<'p> {
    pool: &'p FramePool<'p>,
    index: u16,
}

impl<'p> Frame<'p> {
    /// The envelope. Only a frame that was never addressed has an empty one.
    pub fn envelope(&self) -> Envelope {
        let mut envelope = Envelope::EMPTY;
        self.with(|slot| {
            if let Some(there) = &slot.envelope {
                envelope = *there;
            }
        });
        envelope
    }

    fn read<R>(&self, of: impl Fn(&Envelope) -> R) -> R {
        let there = self.with(|slot| slot.envelope.as_ref().map(&of)).flatten();
        there.unwrap_or_else(|| of(&Envelope::EMPTY))
    }

    /// Who waits for the response.
    pub fn origin(&self) -> Origin {
        self.read(|envelope| envelope.origin)
    }

    /// Writes the envelope anew.
    pub fn address(&self, envelope: Envelope) {
        self.with(|slot| slot.envelope = Some(envelope));
    }

    /// The unit id on the destination's side.
    pub fn target(&self) -> u8 {
        self.read(|envelope| envelope.target)
    }

    /// Whether it is the request or the response.
    pub fn stage(&self) -> Stage {
        self.read(|envelope| envelope.stage)
    }

    /// Whose answers will do for it.
    pub fn sharing(&self) -> Sharing {
        self.read(|envelope| envelope.sharing)
    }

    /// Notes whether it is the request or the response from now on.
    pub fn set_stage(&self, stage: Stage) {
        self.amend(|envelope| envelope.stage = stage);
    }

    fn amend(&self, change: impl FnOnce(&mut Envelope)) {
        self.with(|slot| slot.envelope.as_mut().map(change));
    }

    /// Notes what is behind the exception that the request is going to get.
    pub fn blame(&self, cause: Cause) {
        self.amend(|envelope| envelope.cause = cause);
    }

    /// What the port notes that carries the frame's order out.
    pub(crate) fn transaction(&self) -> Transaction {
        let mut transaction = Transaction::NONE;
        self.with(|slot| transaction = slot.transaction);
        transaction
    }

    /// Changes that.
    pub(crate) fn amend_transaction(&self, change: impl FnOnce(&mut Transaction)) {
        self.with(|slot| change(&mut slot.transaction));
    }

    /// A second handle to the same frame, whose holder notes `transaction` of it.
    pub(crate) fn share_for(&self, transaction: Transaction) -> Self {
        self.with(|slot| {
            slot.transaction = transaction;
            slot.handles += 1;
        });
        Self { pool: self.pool, index: self.index }
    }

    /// Calls `f` with the bytes of the PDU that are there.
    pub fn pdu<R: Default>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.with(|slot| slot.pdu.get(..usize::from(slot.length)).map(f)).flatten().unwrap_or_default()
    }

    /// The bytes of the PDU that are there.
    pub fn content(&self) -> Pdu {
        let mut content = Pdu::new();
        // There is room: it is no longer than a PDU may be.
        self.pdu(|pdu| content.extend_from_slice(pdu).unwrap_or_default());
        content
    }

    /// The function code; 0 while there is none.
    pub fn function(&self) -> u8 {
        self.pdu(|pdu| pdu.first().copied().unwrap_or(0))
    }

    /// Bytes that are there, and whether more come; of a frame that is not complete the CRC counts.
    pub fn filled(&self) -> (usize, Fill) {
        self.with(|slot| (slot.arrived(), slot.fill)).unwrap_or((0, Fill::Broken))
    }

    /// How long the PDU of a frame that is being filled will be, once its writer knows.
    pub fn expected(&self) -> Option<usize> {
        self.with(|slot| usize::from(slot.expected)).filter(|&length| length > 0)
    }

    /// What has come of the CRC of a frame that was filled while it arrived.
    pub fn crc(&self) -> ([u8; 2], usize) {
        self.with(|slot| (slot.crc, usize::from(slot.crc_bytes))).unwrap_or_default()
    }

    /// The CRC with which the frame came while it was passed on, if it goes on under the same unit id.
    pub(crate) fn own_crc(&self) -> Option<u16> {
        let Envelope { unit, target, .. } = self.envelope();
        let (crc, there) = self.crc();
        (there == crc.len() && unit == target).then(|| u16::from_le_bytes(crc))
    }

    /// Breaks the frame if it is still being filled: nobody here wants it that way. Says whether it was.
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

    /// Waits until more than `length` bytes are there or no more come. One waiter at a time.
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

    /// Empties the frame and gives a writer for its new content (a response in the request's place).
    pub fn rewrite(&self) -> FrameWriter<'p> {
        self.with(|slot| {
            slot.restart();
        });
        FrameWriter { frame: self.share() }
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

    /// Whether this is a handle to the same frame as `other`, of the same pool.
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

    /// Gives this handle up, unless it is the last one of a frame on which others ride; how many are left.
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

/// Fills a frame; dropped before [`FrameWriter::finish`] it leaves the frame broken.
pub struct FrameWriter<'p> {
    frame: Frame<'p>,
}

impl<'p> FrameWriter<'p> {
    /// The frame that is being filled.
    pub fn frame(&self) -> &Frame<'p> {
        &self.frame
    }

    /// Appends `bytes`, all or none of them, and wakes the reader.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), FrameFull> {
        let appended = self.frame.with(|slot| {
            let length = usize::from(slot.length);
            slot.pdu.get_mut(length..length + bytes.len())?.copy_from_slice(bytes);
            slot.length += bytes.len() as u8;
            slot.waiting.wake();
            Some(())
        });
        appended.flatten().ok_or(FrameFull)
    }

    /// The PDU will have `length` bytes.
    pub fn expect(&mut self, length: usize) {
        self.frame.with(|slot| slot.expected = length.min(PDU_BYTES_MAX) as u8);
    }

    /// Appends a byte of the CRC behind the PDU, of which it is not known yet whether it is good.
    pub fn push_crc(&mut self, byte: u8) {
        self.frame.with(|slot| {
            if let Some(place) = slot.crc.get_mut(usize::from(slot.crc_bytes)) {
                *place = byte;
                slot.crc_bytes += 1;
                slot.waiting.wake();
            }
        });
    }

    /// Marks the frame complete; the PDU is good. Says whether anybody wants it: it may have been
    /// [abandoned](Frame::abandon).
    pub fn finish(self) -> bool {
        let finished = self.frame.with(|slot| {
            let wanted = slot.fill == Fill::Filling;
            if wanted {
                slot.fill = Fill::Complete;
                slot.waiting.wake();
            }
            wanted
        });
        finished == Some(true)
    }
}

impl Drop for FrameWriter<'_> {
    fn drop(&mut self) {
        self.frame.abandon();
    }
}
