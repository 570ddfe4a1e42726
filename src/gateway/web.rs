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

use super::shared::Shared;
use super::turns::Turns;
use crate::settings::{Name, PasswordHash};

/// Simultaneous connections, each with a task.
pub(crate) const CONNECTIONS_MAX: usize = 8;
/// Connections of those that may be held for live values.
const LIVE_MAX: u8 = 4;
/// Users logged in at a time; a further one takes the place of the session that was used longest ago.
const SESSIONS_MAX: usize = 16;
/// A session ends if nobody uses it for this time,
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);
/// and at this age.
const AGE_MAX: Duration = Duration::from_secs(12 * 3_600);

/// Fits the longest piece of an answer: the 2000 bits of a point.
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
    /// Connections held for live values.
    live: AtomicU8,
    /// For pieces of answers that do not fit into a connection's own memory; held until it is sent.
    pub(crate) long_piece: mutex::Mutex<CriticalSectionRawMutex, String<PIECE_BYTES_MAX>>,
    /// Stops the long command, `scan` or `tune`. One signal is enough: a long command holds the turn for direct requests, so only one
    /// runs at a time, and `reset` at its start drops a stop that was meant for the one before.
    pub(crate) stop: Signal<CriticalSectionRawMutex, ()>,
}

/// A connection that is held for live values.
pub(crate) struct Live<'w>(&'w AtomicU8);

impl Drop for Live<'_> {
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
            live: AtomicU8::new(0),
            long_piece: mutex::Mutex::new(String::new()),
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

    /// Holds a connection for live values, unless too many are held.
    pub(crate) fn hold(&self) -> Option<Live<'_>> {
        let live = self.live.load(Relaxed);
        (live < LIVE_MAX).then(|| {
            self.live.store(live + 1, Relaxed);
            Live(&self.live)
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
    fn half_of_the_connections_may_be_held_and_each_is_given_back() {
        let web = Web::new();
        let held: std::vec::Vec<_> = (0..4).map_while(|_| web.hold()).collect();
        assert_eq!((held.len(), web.hold().is_none()), (4, true));
        drop(held);
        assert!(web.hold().is_some());
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
