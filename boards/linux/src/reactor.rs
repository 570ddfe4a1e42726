//! The thread's event loop: sleeps in epoll until a descriptor is ready, the next alarm is due, or another thread wakes it.
//!
//! Every descriptor is registered once, edge-triggered, for reading; for writing only while a write would block. Readiness is
//! remembered until an operation would block, so a transaction costs its reads and writes and one `epoll_pwait2` each time the
//! thread goes idle: no timer descriptor, no registration per wait, no second thread.

use std::cell::{Cell, RefCell};
use std::future::Future;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::pin::pin;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::task::{Context, Poll, Wake, Waker};

use embassy_time::Instant;
use nix::sys::epoll::{Epoll, EpollEvent, EpollTimeout};
use rustix::event::epoll::{self, CreateFlags, EventData, EventFlags};
use rustix::event::{EventfdFlags, Timespec, eventfd};
use rustix::io::Errno;
use slab::Slab;

/// Most events taken from the kernel at once.
const EVENTS_MAX: usize = 64;
/// Event key of a wake-up by another thread; no source has this number.
const WOKEN: u64 = u64::MAX;

/// Events that are always reported.
const READING: EventFlags = EventFlags::IN.union(EventFlags::RDHUP).union(EventFlags::ET);

thread_local! {
    static REACTOR: Reactor = Reactor::new().expect("the system has epoll, and descriptors left");
}

struct Reactor {
    epoll: Epoll,
    /// `epoll_pwait2` is unknown here: to Linux before 5.11, to valgrind, or to a sandbox.
    by_milliseconds: Cell<bool>,
    sources: RefCell<Slab<Rc<Source>>>,
    /// Buffer for the kernel's events.
    events: RefCell<Vec<epoll::Event>>,
    /// The same as `epoll_wait` fills it.
    found: RefCell<[EpollEvent; EVENTS_MAX]>,
    alert: Arc<Alert>,
}

/// Wakes a reactor's thread.
struct Alert {
    /// Set if there is something to poll.
    awake: AtomicBool,
    /// The thread is in `epoll_wait`, or about to be: only then does waking it need a system call.
    asleep: AtomicBool,
    bell: OwnedFd,
}

impl Wake for Alert {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.awake.store(true, SeqCst);
        if self.asleep.swap(false, SeqCst) {
            // Cannot overflow: an eventfd counts to 2^64.
            let _ = rustix::io::write(&self.bell, &1_u64.to_ne_bytes());
        }
    }
}

/// Runs `future`, and everything else that waits for descriptors and timers of this thread.
pub fn block_on<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    REACTOR.with(|reactor| {
        let waker = Waker::from(reactor.alert.clone());
        let mut context = Context::from_waker(&waker);
        // An earlier run may have cleared the flag, but this future has not been polled yet.
        reactor.alert.awake.store(true, SeqCst);
        loop {
            mobgate_clock::fire_due();
            if reactor.alert.awake.swap(false, SeqCst)
                && let Poll::Ready(value) = future.as_mut().poll(&mut context)
            {
                return value;
            }
            reactor.sleep();
        }
    })
}

impl Reactor {
    fn new() -> io::Result<Self> {
        let epoll = epoll::create(CreateFlags::CLOEXEC)?;
        let bell = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?;
        epoll::add(&epoll, &bell, EventData::new_u64(WOKEN), EventFlags::IN | EventFlags::ET)?;
        let alert = Alert { awake: AtomicBool::new(false), asleep: AtomicBool::new(false), bell };
        let events = RefCell::new(Vec::with_capacity(EVENTS_MAX));
        let found = RefCell::new([EpollEvent::empty(); EVENTS_MAX]);
        let (epoll, by_milliseconds) = (Epoll(epoll), Cell::new(false));
        Ok(Self {
            epoll,
            by_milliseconds,
            sources: RefCell::default(),
            events,
            found,
            alert: Arc::new(alert),
        })
    }

    /// Sleeps until an event; only polls for events if more work is pending.
    fn sleep(&self) {
        self.alert.asleep.store(true, SeqCst);
        let patience = if self.alert.awake.load(SeqCst) { Some(0) } else { until_next_alarm() };
        let mut events = self.events.borrow_mut();
        self.wait(&mut events, patience);
        self.alert.asleep.store(false, SeqCst);
        for event in events.drain(..) {
            let (number, flags) = (event.data.u64(), event.flags);
            let source = usize::try_from(number).ok().and_then(|key| self.sources.borrow().get(key).cloned());
            // The number may belong to a new source by now, which then retries once in vain.
            if let Some(source) = source {
                source.notice(flags);
            }
        }
    }

    /// Waits for events, for so many microseconds at most. A signal ends it without events; epoll reports them again.
    fn wait(&self, events: &mut Vec<epoll::Event>, micros: Option<u64>) {
        if !self.by_milliseconds.get() {
            let timeout = micros.map(|micros| Timespec {
                tv_sec: (micros / 1_000_000).try_into().unwrap_or(i64::MAX),
                tv_nsec: (micros % 1_000_000 * 1_000) as i64,
            });
            let waited = epoll::wait(&self.epoll.0, rustix::buffer::spare_capacity(events), timeout.as_ref());
            // Some sandboxes refuse what they do not know.
            let is_unknown = matches!(waited, Err(Errno::NOSYS | Errno::PERM));
            self.by_milliseconds.set(is_unknown);
            if !is_unknown {
                return;
            }
        }
        let timeout = micros.map_or(EpollTimeout::NONE, |micros| {
            // Rounded up: no alarm is early.
            i32::try_from(micros.div_ceil(1_000))
                .ok()
                .and_then(|ms| ms.try_into().ok())
                .unwrap_or(EpollTimeout::MAX)
        });
        let mut found = self.found.borrow_mut();
        let count = self.epoll.wait(&mut *found, timeout).unwrap_or(0);
        events.extend(found.iter().take(count).map(|event| epoll::Event {
            flags: EventFlags::from_bits_retain(event.events().bits().cast_unsigned()),
            data: EventData::new_u64(event.data()),
        }));
    }
}

/// Microseconds until the thread's next alarm; `None` if no alarm is set.
fn until_next_alarm() -> Option<u64> {
    mobgate_clock::next_alarm().map(|at| at.saturating_sub(Instant::now().as_ticks()))
}

/// A registered descriptor.
#[derive(Debug, Default)]
struct Source {
    reading: Direction,
    writing: Direction,
    /// Set while readable events are not reported.
    muted: Cell<bool>,
}

/// One direction of a descriptor.
#[derive(Debug, Default)]
pub(crate) struct Direction {
    /// An operation would have blocked, and no event was reported since.
    blocked: Cell<bool>,
    /// The peer closed it, or it failed: no further event will be reported.
    over: Cell<bool>,
    waiting: RefCell<Option<Waker>>,
}

impl Source {
    fn notice(&self, flags: EventFlags) {
        let broken = EventFlags::HUP | EventFlags::ERR;
        self.reading.notice(flags, EventFlags::IN, EventFlags::RDHUP | broken);
        self.writing.notice(flags, EventFlags::OUT, broken);
    }
}

impl Direction {
    fn notice(&self, flags: EventFlags, more: EventFlags, over: EventFlags) {
        if flags.intersects(over) {
            self.over.set(true);
        }
        if flags.intersects(more | over) {
            self.blocked.set(false);
            if let Some(waker) = self.waiting.take() {
                waker.wake();
            }
        }
    }

    /// An operation would have blocked: the next one waits for an event.
    pub(crate) fn block(&self) {
        self.blocked.set(true);
    }

    /// A short read or write: the next operation would block, unless it is to report the end.
    pub(crate) fn block_unless_over(&self) {
        self.blocked.set(!self.over.get());
    }

    /// Ready unless the operation is known to block.
    pub(crate) fn poll_ready(&self, context: &Context<'_>) -> Poll<()> {
        if !self.blocked.get() {
            return Poll::Ready(());
        }
        let mut waiting = self.waiting.borrow_mut();
        if !waiting.as_ref().is_some_and(|waker| waker.will_wake(context.waker())) {
            *waiting = Some(context.waker().clone());
        }
        Poll::Pending
    }
}

/// A descriptor's registration with the reactor of its thread; must be dropped there, before the descriptor is closed.
#[derive(Debug)]
pub(crate) struct Registration {
    key: usize,
    source: Rc<Source>,
}

impl Registration {
    /// Registers the non-blocking `descriptor`. Fails if epoll does not support it, as with files.
    pub(crate) fn new(descriptor: impl AsFd) -> io::Result<Self> {
        REACTOR.with(|reactor| {
            let source = Rc::new(Source::default());
            let key = reactor.sources.borrow_mut().insert(source.clone());
            let added = epoll::add(&reactor.epoll.0, descriptor, EventData::new_u64(key as u64), READING);
            // Dropped on an error, which frees the key.
            let registration = Self { key, source };
            added.map(|()| registration).map_err(io::Error::from)
        })
    }

    /// Suppresses readable events of `descriptor` until a read would block. The next read is attempted.
    pub(crate) fn mute(&self, descriptor: impl AsFd) -> io::Result<()> {
        if !self.source.muted.replace(true) {
            self.report(descriptor, EventFlags::ET)?;
        }
        self.source.reading.blocked.set(false);
        Ok(())
    }

    /// A read would have blocked: the next one waits for an event, which is reported if it has happened meanwhile.
    pub(crate) fn unmute(&self, descriptor: impl AsFd) -> io::Result<()> {
        if self.source.muted.replace(false) { self.report(descriptor, READING) } else { Ok(()) }
    }

    /// Turns writable events of `descriptor` on or off. They stay off otherwise, because a tty reports one after every write.
    pub(crate) fn watch_writing(&self, descriptor: impl AsFd, watch: bool) -> io::Result<()> {
        self.source.muted.set(false);
        self.report(descriptor, if watch { READING | EventFlags::OUT } else { READING })
    }

    fn report(&self, descriptor: impl AsFd, flags: EventFlags) -> io::Result<()> {
        let data = EventData::new_u64(self.key as u64);
        REACTOR.with(|reactor| Ok(epoll::modify(&reactor.epoll.0, descriptor, data, flags)?))
    }

    /// Unregisters `descriptor`.
    pub(crate) fn remove(&self, descriptor: impl AsFd) {
        // It is registered, so this cannot fail.
        let _ = REACTOR.try_with(|reactor| epoll::delete(&reactor.epoll.0, descriptor));
    }

    pub(crate) fn reading(&self) -> &Direction {
        &self.source.reading
    }

    pub(crate) fn writing(&self) -> &Direction {
        &self.source.writing
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        // At thread exit the reactor may already be gone.
        let _ = REACTOR.try_with(|reactor| reactor.sources.borrow_mut().try_remove(self.key));
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;
    use std::time::{Duration, Instant};

    use embassy_time::Timer;

    use super::{REACTOR, Registration, block_on};

    #[test]
    fn a_system_without_epoll_pwait2_wakes_for_bytes_and_no_alarm_early() {
        REACTOR.with(|reactor| reactor.by_milliseconds.set(true));
        let start = Instant::now();
        block_on(Timer::after_micros(1_750));
        assert!(start.elapsed() >= Duration::from_micros(1_750));

        let (ours, theirs) = UnixStream::pair().unwrap();
        let registration = Registration::new(&ours).unwrap();
        registration.reading().blocked.set(true);
        rustix::io::write(&theirs, b"x").unwrap();
        block_on(async {
            while registration.reading().blocked.get() {
                Timer::after_micros(100).await;
            }
        });
    }
}
