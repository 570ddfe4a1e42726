//! Channels that carry frames from task to task.

use core::cell::RefCell;
use core::future::poll_fn;
use core::mem;
use core::task::Poll;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::waitqueue::WakerRegistration;

use super::{Frame, FramePool};

/// A channel of frames: many senders, one receiver, first in, first out.
///
/// The links are in the slots, so a channel takes a few bytes and has room for every frame of the pool, and sending is a plain
/// function that cannot fail, block, or be cancelled half-way. `embassy_sync::channel` would need an array in each channel.
pub struct Channel(Mutex<CriticalSectionRawMutex, RefCell<Ends>>);

struct Ends {
    /// Index + 1 of the first and last frame; 0: none.
    first: u16,
    last: u16,
    receiver: WakerRegistration,
}

impl Channel {
    /// An empty channel.
    pub const fn new() -> Self {
        Self(Mutex::new(RefCell::new(Ends { first: 0, last: 0, receiver: WakerRegistration::new() })))
    }

    /// Appends `frame`. All frames of one channel belong to one pool.
    pub fn send(&self, frame: Frame<'_>) {
        self.0.lock(|ends| {
            let mut ends = ends.borrow_mut();
            let link = frame.index + 1;
            frame.with(|slot| slot.next = 0);
            match usize::from(ends.last).checked_sub(1) {
                Some(last) => {
                    frame.pool.with(last, |slot| slot.next = link);
                }
                None => ends.first = link,
            }
            ends.last = link;
            ends.receiver.wake();
            // The channel now owns the handle, as an index.
            mem::forget(frame);
        });
    }

    /// The first frame, if any.
    pub fn try_receive<'p>(&self, pool: &'p FramePool<'p>) -> Option<Frame<'p>> {
        self.0.lock(|ends| ends.borrow_mut().take_first(pool))
    }

    /// Drops all frames, which have no receiver any more.
    pub(crate) fn clear(&self, pool: &FramePool<'_>) {
        while self.try_receive(pool).is_some() {}
    }

    /// Waits for the first frame.
    pub fn receive<'p>(&self, pool: &'p FramePool<'p>) -> impl Future<Output = Frame<'p>> {
        poll_fn(move |cx| {
            self.0.lock(|ends| {
                let mut ends = ends.borrow_mut();
                match ends.take_first(pool) {
                    Some(first) => Poll::Ready(first),
                    None => {
                        ends.receiver.register(cx.waker());
                        Poll::Pending
                    }
                }
            })
        })
    }
}

impl Ends {
    fn take_first<'p>(&mut self, pool: &'p FramePool<'p>) -> Option<Frame<'p>> {
        let index = self.first.checked_sub(1)?;
        self.first = pool.with(usize::from(index), |slot| mem::take(&mut slot.next))?;
        if self.first == 0 {
            self.last = 0;
        }
        Some(Frame { pool, index })
    }
}
