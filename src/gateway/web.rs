//! What the tasks of the web interface share: who is logged in, and what they wait for.

use core::cell::RefCell;
use core::sync::atomic::AtomicU8;
use core::sync::atomic::Ordering::Relaxed;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};
use heapless::String;

use super::hour::Hour;
use super::shared::Shared;
use super::turns::Turns;
use crate::settings::{Name, PasswordHash};

/// Simultaneous connections, each with a task.
pub(crate) const CONNECTIONS_MAX: usize = 8;
/// Connections of those that may be held for the events of pages, and for frames. What is left is for calls.
const PAGES_MAX: u8 = 4;
const CAPTURES_MAX: u8 = 2;
const _: () = assert!(((PAGES_MAX + CAPTURES_MAX) as usize) < CONNECTIONS_MAX, "calls get through");
/// Users logged in at a time; a further one takes the place of the session that was used longest ago.
const SESSIONS_MAX: usize = 16;
/// A session ends if nobody uses it for this time,
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);
/// and at this age.
const AGE_MAX: Duration = Duration::from_secs(12 * 3_600);

/// Fits the longest piece of a response: the 2000 bits of a point.
const PIECE_BYTES_MAX: usize = 6_144;

/// The secret of a session, random.
pub(crate) type Token = [u8; 16];

/// A user who has logged in.
#[derive(Clone)]
struct Session {
    token: Token,
    user: Name,
    /// That of the log-in: another one ends the session.
    password: PasswordHash,
    began: Instant,
    used: Instant,
}

impl Session {
    /// When it ends unless it is used.
    fn end(&self) -> Instant {
        (self.used + IDLE_MAX).min(self.began + AGE_MAX)
    }
}

/// The shared state.
pub(crate) struct Web {
    sessions: Shared<[Option<Session>; SESSIONS_MAX]>,
    changed: [Signal<CriticalSectionRawMutex, ()>; CONNECTIONS_MAX],
    /// Held while a password is checked, which takes memory and time: one at a time.
    pub(crate) log_in: mutex::Mutex<CriticalSectionRawMutex, ()>,
    /// Limits the rate of requests.
    pub(crate) turns: Turns,
    /// For pieces of responses that do not fit into a connection's own memory; held until it is sent.
    pub(crate) long_piece: mutex::Mutex<CriticalSectionRawMutex, String<PIECE_BYTES_MAX>>,
    /// Connections held, by what for.
    held: [AtomicU8; 2],
    /// The errors of units in the last hour.
    pub(crate) hour: Hour,
    /// Stops the long command, `scan` or `tune`. One signal is enough: a long command holds the turn for direct requests, so only one
    /// runs at a time, and `reset` at its start drops a stop that was meant for the one before.
    pub(crate) stop: Signal<CriticalSectionRawMutex, ()>,
}

/// What a connection is held for.
#[derive(Clone, Copy)]
pub(crate) enum Hold {
    Events,
    Frames,
}

/// A connection that is held.
pub(crate) struct Held<'w>(&'w AtomicU8);

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.0.store(self.0.load(Relaxed).saturating_sub(1), Relaxed);
    }
}

impl Web {
    pub(super) const fn new() -> Self {
        Self {
            sessions: Mutex::new(RefCell::new([const { None }; SESSIONS_MAX])),
            changed: [const { Signal::new() }; CONNECTIONS_MAX],
            log_in: mutex::Mutex::new(()),
            turns: Turns::new(),
            long_piece: mutex::Mutex::new(String::new()),
            held: [const { AtomicU8::new(0) }; 2],
            hour: Hour::new(),
            stop: Signal::new(),
        }
    }

    /// Tells all tasks that other settings are in force.
    pub(super) fn settings_changed(&self) {
        self.changed.iter().for_each(|changed| changed.signal(()));
    }

    /// What task number `nth` waits for; `None` if there are fewer.
    pub(crate) fn changed(&self, nth: usize) -> Option<&Signal<CriticalSectionRawMutex, ()>> {
        self.changed.get(nth)
    }

    /// Begins a session of `user`; returns when it ends unless it is used.
    pub(crate) fn begin(&self, token: Token, user: Name, password: PasswordHash, now: Instant) -> Instant {
        let session = Session { token, user, password, began: now, used: now };
        let end = session.end();
        self.sessions.lock(|sessions| {
            let mut sessions = sessions.borrow_mut();
            // `None` sorts first, and what has ended before what has not.
            let place = sessions.iter_mut().min_by_key(|session| session.as_ref().map(Session::end));
            place.into_iter().for_each(|place| *place = Some(session.clone()));
        });
        end
    }

    /// The user of the session with this `token`, who `uses` it now or not, and the password that it began with.
    pub(crate) fn find(&self, token: &Token, now: Instant, uses: bool) -> Option<(Name, PasswordHash)> {
        self.sessions.lock(|sessions| {
            let mut sessions = sessions.borrow_mut();
            let session = sessions.iter_mut().flatten().find(|session| is_same(&session.token, token))?;
            if session.end() <= now {
                return None;
            }
            if uses {
                session.used = now;
            }
            Some((session.user.clone(), session.password.clone()))
        })
    }

    /// Holds a connection, unless too many are held for the same.
    pub(crate) fn hold(&self, hold: Hold) -> Option<Held<'_>> {
        let [events, frames] = &self.held;
        let (held, most) = match hold {
            Hold::Events => (events, PAGES_MAX),
            Hold::Frames => (frames, CAPTURES_MAX),
        };
        let count = held.load(Relaxed);
        (count < most).then(|| {
            held.store(count + 1, Relaxed);
            Held(held)
        })
    }

    /// Ends the session with this `token`.
    pub(crate) fn end(&self, token: &Token) {
        self.sessions.lock(|sessions| {
            let mut sessions = sessions.borrow_mut();
            let is_it = |session: &Option<Session>| {
                session.as_ref().is_some_and(|session| is_same(&session.token, token))
            };
            sessions.iter_mut().filter(|session| is_it(session)).for_each(|session| *session = None);
        });
    }
}

/// Whether two tokens are the same, in a time that does not tell where they differ.
fn is_same(one: &Token, other: &Token) -> bool {
    one.iter().zip(other).fold(0, |differences, (one, other)| differences | (one ^ other)) == 0
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const HOUR: Duration = Duration::from_secs(3_600);

    fn begin(web: &Web, token: u8, now: Instant) {
        web.begin([token; 16], "anna".try_into().unwrap(), PasswordHash::new(), now);
    }

    #[test]
    fn four_pages_and_two_captures_are_held_apart_and_each_connection_is_given_back() {
        let web = Web::new();
        let pages: std::vec::Vec<_> = (0..8).map_while(|_| web.hold(Hold::Events)).collect();
        let captures: std::vec::Vec<_> = (0..8).map_while(|_| web.hold(Hold::Frames)).collect();
        assert_eq!((pages.len(), captures.len()), (4, 2));
        drop(pages);
        assert!(web.hold(Hold::Events).is_some() && web.hold(Hold::Frames).is_none());
    }

    fn is_found(web: &Web, token: u8, now: Instant) -> bool {
        web.find(&[token; 16], now, true).is_some()
    }

    #[test]
    fn a_session_ends_half_an_hour_after_its_last_use_and_at_twelve_hours() {
        let (web, mut now) = (Web::new(), Instant::MIN + HOUR);
        begin(&web, 1, now);
        assert!(!is_found(&web, 2, now), "another token");
        for _ in 0..35 {
            now += Duration::from_secs(1_200);
            assert!(is_found(&web, 1, now));
        }
        assert!(!is_found(&web, 1, now + Duration::from_secs(1_200)), "it is too old");
        begin(&web, 1, now);
        assert!(!is_found(&web, 1, now + IDLE_MAX), "nobody used it");
    }

    #[test]
    fn one_more_takes_the_place_of_the_session_used_longest_ago_and_ended_ones_are_gone() {
        let (web, now) = (Web::new(), Instant::MIN + HOUR);
        let at = |second: u8| now + Duration::from_secs(second.into());
        (0..16).for_each(|token| begin(&web, token, at(token)));
        assert!(is_found(&web, 0, at(20)));
        begin(&web, 16, at(21));
        assert!(!is_found(&web, 1, at(22)) && is_found(&web, 0, at(22)) && is_found(&web, 16, at(22)));
        web.end(&[16; 16]);
        assert!(!is_found(&web, 16, at(23)));
    }
}
