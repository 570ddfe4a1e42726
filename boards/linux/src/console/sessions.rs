//! The concurrent console sessions: a new client gets a free slot, or that of the session idle for longest.

use std::cell::Cell;
use std::io;

use embassy_futures::select::{Either3, select3};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::console::{self, Ended, Mode};
use mobgate::gateway::Gateway;
use mobgate::hal::System;

use super::by_package;
use super::guest::Guest;
use super::hello::{Hello, farewell};
use crate::ssh::Who;
use crate::store::FileStore;

/// Concurrent sessions at the socket and the TCP port. SSH has its own.
pub const SESSIONS_MAX: usize = 4;
/// A session without input or output for this long ends.
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);

/// Session slots, each served by a task.
pub struct Sessions {
    slots: Vec<Slot>,
    idle_max: Duration,
}

/// A session slot.
struct Slot {
    /// Last input or output; `None` while the slot is free.
    last: Cell<Option<Instant>>,
    /// The next client of this slot; it displaces the current one at once.
    next: Signal<NoopRawMutex, Guest>,
}

impl Default for Slot {
    fn default() -> Self {
        Self { last: Cell::new(None), next: Signal::new() }
    }
}

/// How a session ended.
enum End {
    Ended(io::Result<Ended>),
    Idle,
    Displaced(Guest),
}

impl Sessions {
    /// A fixed number of slots.
    pub fn new(count: usize) -> Self {
        Self { slots: (0..count).map(|_| Slot::default()).collect(), idle_max: IDLE_MAX }
    }

    /// Gives `guest` a free slot, or that of the session idle for longest.
    pub fn admit(&self, guest: Guest) {
        // `None` sorts first. There is at least one slot.
        let Some(slot) = self.slots.iter().min_by_key(|slot| slot.last.get()) else { return };
        slot.last.set(Some(Instant::now()));
        slot.next.signal(guest);
    }

    /// Serves slot `number`; never returns.
    pub async fn serve(&self, number: usize, gateway: &Gateway<'_>, store: FileStore, system: &impl System) {
        let slot = &self.slots[number];
        let mut guest = slot.next.wait().await;
        loop {
            log::info!("console session of {}", guest.who);
            let end = {
                let session = session(&mut guest, &slot.last, gateway, store.clone(), system);
                match select3(session, slot.next.wait(), idle(&slot.last, self.idle_max)).await {
                    Either3::First(ended) => End::Ended(ended),
                    Either3::Second(next) => End::Displaced(next),
                    Either3::Third(()) => End::Idle,
                }
            };
            let next = end_of(guest, end, self.slots.len()).await;
            if next.is_none() && !slot.next.signaled() {
                slot.last.set(None);
            }
            guest = match next {
                Some(next) => next,
                None => slot.next.wait().await,
            };
        }
    }
}

/// Runs a guest's session.
async fn session(
    guest: &mut Guest,
    last: &Cell<Option<Instant>>,
    gateway: &Gateway<'_>,
    mut store: FileStore,
    system: &impl System,
) -> io::Result<Ended> {
    let user = guest.user.clone();
    let mode = match &user {
        Some(Who { user: name, peer, port }) => {
            Mode::User { name, peer: *peer, port: *port, edits: guest.hello == Hello::Terminal }
        }
        None => guest.begin().await?,
    };
    console::run(gateway, &mut Watched { guest, last }, &mut store, &mut by_package(), system, mode).await
}

/// Ends a session and tells its user why; returns the guest that displaced it.
async fn end_of(guest: Guest, end: End, count: usize) -> Option<Guest> {
    let who = guest.who.clone();
    let (last, next) = match end {
        // The audit trail has it.
        End::Ended(Ok(Ended::Foreign(_))) => (Vec::new(), None),
        End::Ended(Ok(ended)) if guest.hello != Hello::None => (vec![farewell(ended)], None),
        End::Ended(ended) => {
            log::debug!("console session of {who} has ended: {ended:?}");
            (Vec::new(), None)
        }
        End::Idle => (word(&guest, "idle for too long"), None),
        End::Displaced(next) => {
            let reason = format!("{count} at a time, and {} is newer than this idle one", next.who);
            (word(&guest, &reason), Some(next))
        }
    };
    guest.dismiss(&last).await;
    next
}

/// Logs why a session ends, and returns the message for its user.
fn word(guest: &Guest, reason: &str) -> Vec<u8> {
    log::info!("console session of {} ended: {reason}", guest.who);
    // An echoing client's terminal is raw, with a prompt on the current line.
    let line_end = if guest.hello.mode() == Mode::Echo { "\r\n" } else { "\n" };
    format!("{line_end}session ended: {reason}{line_end}").into_bytes()
}

/// Completes when the session has been idle for `limit`.
async fn idle(last: &Cell<Option<Instant>>, limit: Duration) {
    while let Some(end) = last.get().map(|last| last + limit)
        && end > Instant::now()
    {
        Timer::at(end).await;
    }
}

/// A guest that records the time of its last input or output.
struct Watched<'g> {
    guest: &'g mut Guest,
    last: &'g Cell<Option<Instant>>,
}

impl Watched<'_> {
    fn note<T>(&self, done: io::Result<T>) -> io::Result<T> {
        self.last.set(Some(Instant::now()));
        done
    }
}

impl ErrorType for Watched<'_> {
    type Error = io::Error;
}

impl Read for Watched<'_> {
    async fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.guest.read(into).await;
        self.note(read)
    }
}

impl Write for Watched<'_> {
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        let written = self.guest.write(from).await;
        self.note(written)
    }

    async fn flush(&mut self) -> io::Result<()> {
        self.guest.flush().await
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::io::Read as _;
    use std::os::unix::net::UnixStream;

    use embassy_futures::select::select;
    use embassy_time::{Duration, Instant, Timer};
    use mobgate::frame::FramePool;
    use mobgate::gateway::{Gateway, Ports};
    use mobgate::hal::System;
    use mobgate_simulator::World;

    use super::{IDLE_MAX, Sessions, idle};
    use crate::console::guest::Guest;
    use crate::console::peer::Peer;
    use crate::reactor::block_on;
    use crate::store::FileStore;

    #[test]
    fn a_session_is_idle_when_nothing_has_happened_for_the_limit_and_not_before() {
        World::new(1).run_until(async {
            let last = Cell::new(Some(Instant::now()));
            let work = async {
                Timer::after(IDLE_MAX - Duration::from_secs(1)).await;
                last.set(Some(Instant::now()));
                std::future::pending::<()>().await;
            };
            select(idle(&last, IDLE_MAX), work).await;
            assert_eq!(Instant::now(), Instant::MIN + IDLE_MAX * 2 - Duration::from_secs(1));
        });
    }

    struct Nothing;

    impl System for Nothing {
        fn name(&self) -> &str {
            "test"
        }

        fn reboot(&self) {}
    }

    #[test]
    fn an_idle_session_ends_and_says_so() {
        let (pool, ports) = (FramePool::new(&[], 0), Ports::<0>::new());
        let gateway = Gateway::new(&pool, &ports, &[]);
        let sessions = Sessions { idle_max: Duration::from_millis(50), ..Sessions::new(1) };
        let (mut ours, theirs) = UnixStream::pair().unwrap();
        let peer = Peer::of(&theirs).unwrap();
        sessions.admit(Guest::by_socket(theirs, &peer).unwrap());
        let free_again = async {
            while sessions.slots.iter().any(|slot| slot.last.get().is_some()) {
                Timer::after_millis(5).await;
            }
        };
        block_on(select(sessions.serve(0, &gateway, FileStore::new(None), &Nothing), free_again));
        let mut said = String::new();
        ours.read_to_string(&mut said).unwrap();
        assert!(said.contains("session ended: idle for too long"), "{said:?}");
    }
}
