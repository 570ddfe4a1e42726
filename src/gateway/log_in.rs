//! Failed attempts to log in, and the pauses that follow them.
//!
//! Five failures from an address, or for a user, begin a pause that doubles with each further one. An attempt within a pause is
//! refused before its password is checked, and does not count. The pause of a user is short, and does not hold for an address without
//! failures, so guessing from elsewhere locks no user out. The local console needs no password and has no pauses.

use core::net::IpAddr;

use embassy_time::{Duration, Instant};

use crate::settings::{Name, USERS, USERS_MAX};

/// Addresses whose failures are remembered; the one that failed longest ago is forgotten for another.
const ADDRESSES_MAX: usize = if USERS { 64 } else { 0 };
/// Failures without a pause.
const FREE: u8 = 5;
/// The longest pause of an address.
const ADDRESS_PAUSE_MAX: Duration = Duration::from_secs(300);
/// The longest pause of a user.
const USER_PAUSE_MAX: Duration = Duration::from_secs(30);
/// Failures are forgotten after this time without another one.
const MEMORY: Duration = Duration::from_secs(3_600);

/// The failures of an address or a user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Failures {
    count: u8,
    last: Instant,
}

impl Failures {
    /// When the next attempt is possible, with pauses of at most `longest`.
    fn until(self, longest: Duration) -> Instant {
        let Some(doublings) = self.count.checked_sub(FREE) else { return self.last };
        let pause = Duration::from_secs(1 << doublings.min(16));
        self.last + pause.min(longest)
    }
}

/// What failed lately.
pub(crate) struct Attempts {
    addresses: [Option<(IpAddr, Failures)>; ADDRESSES_MAX],
    users: [Option<(Name, Failures)>; USERS_MAX],
}

impl Attempts {
    pub(crate) const fn new() -> Self {
        Self { addresses: [None; ADDRESSES_MAX], users: [const { None }; USERS_MAX] }
    }

    /// How long `user` must wait at `address` before another attempt; `None`: not at all.
    pub(crate) fn pause(&self, now: Instant, address: IpAddr, user: &str) -> Option<Duration> {
        let of_address = find(&self.addresses, now, &network(address))?;
        let of_user = find(&self.users, now, user).map(|failures| failures.until(USER_PAUSE_MAX));
        let until = of_address.until(ADDRESS_PAUSE_MAX).max(of_user.unwrap_or(now));
        until.checked_duration_since(now).filter(|pause| pause.as_ticks() > 0)
    }

    /// Notes an attempt that failed; `is_known` tells whether there is such a user.
    pub(crate) fn failed(&mut self, now: Instant, address: IpAddr, user: &Name, is_known: bool) {
        count(&mut self.addresses, now, network(address));
        // Unknown names would displace those of users.
        if is_known {
            count(&mut self.users, now, user.clone());
        }
    }

    /// Forgets the failures of `address` and `user`, who has logged in.
    pub(crate) fn succeeded(&mut self, address: IpAddr, user: &str) {
        forget(&mut self.addresses, &network(address));
        forget(&mut self.users, user);
    }
}

/// The holder of an IPv6 address has its whole 64-bit network (RFC 6177).
fn network(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => address,
        IpAddr::V6(address) => IpAddr::V6((address.to_bits() & !u128::from(u64::MAX)).into()),
    }
}

/// Where the failures of `who` are.
fn place<K: PartialEq<Q>, Q: ?Sized>(table: &[Option<(K, Failures)>], who: &Q) -> Option<usize> {
    table.iter().position(|entry| entry.as_ref().is_some_and(|(key, _)| *key == *who))
}

/// The failures of `who`, unless they are too old.
fn find<K: PartialEq<Q>, Q: ?Sized>(
    table: &[Option<(K, Failures)>],
    now: Instant,
    who: &Q,
) -> Option<Failures> {
    let (_, failures) = table.get(place(table, who)?)?.as_ref()?;
    Some(*failures).filter(|failures| failures.last + MEMORY > now)
}

fn count<K: PartialEq>(table: &mut [Option<(K, Failures)>], now: Instant, who: K) {
    let before = find(table, now, &who).map_or(0, |failures| failures.count);
    let oldest = || {
        let last =
            |(_, entry): &(usize, &Option<(K, Failures)>)| entry.as_ref().map(|(_, failures)| failures.last);
        table.iter().enumerate().min_by_key(last).map(|(at, _)| at)
    };
    let at = place(table, &who).or_else(oldest);
    if let Some(entry) = at.and_then(|at| table.get_mut(at)) {
        *entry = Some((who, Failures { count: before.saturating_add(1), last: now }));
    }
}

fn forget<K: PartialEq<Q>, Q: ?Sized>(table: &mut [Option<(K, Failures)>], who: &Q) {
    if let Some(entry) = place(table, who).and_then(|at| table.get_mut(at)) {
        *entry = None;
    }
}

#[cfg(test)]
// Used only with the feature `users`.
#[cfg(feature = "users")]
mod tests {
    use super::*;

    fn name(text: &str) -> Name {
        Name::try_from(text).unwrap()
    }

    fn at_ms(ms: u64) -> Instant {
        Instant::MIN + Duration::from_millis(ms)
    }

    const HERE: IpAddr = IpAddr::V4(core::net::Ipv4Addr::LOCALHOST);

    /// Fails as soon as it is possible, `count` times; returns the pauses in seconds.
    fn pauses(attempts: &mut Attempts, address: IpAddr, user: &str, count: usize) -> heapless::Vec<u64, 20> {
        let mut now = at_ms(1_000_000);
        let mut waited = heapless::Vec::new();
        for _ in 0..count {
            let pause = attempts.pause(now, address, user);
            now += pause.unwrap_or_default();
            assert_eq!(attempts.pause(now, address, user), None, "the pause is over at its end");
            waited.push(pause.map_or(0, |pause| pause.as_secs())).unwrap();
            attempts.failed(now, address, &name(user), false);
        }
        waited
    }

    #[test]
    fn after_five_failures_the_pauses_of_an_address_double_up_to_five_minutes() {
        let mut attempts = Attempts::new();
        let waited = pauses(&mut attempts, HERE, "anna", 16);
        assert_eq!(waited[..], [0, 0, 0, 0, 0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300]);
        assert_eq!(attempts.pause(at_ms(1_000_000), IpAddr::from([10, 0, 0, 1]), "anna"), None, "elsewhere");
    }

    #[test]
    fn a_success_and_an_hour_forget_the_failures() {
        let mut attempts = Attempts::new();
        for _ in 0..8 {
            attempts.failed(at_ms(0), HERE, &name("anna"), true);
        }
        assert_eq!(attempts.pause(at_ms(0), HERE, "anna"), Some(Duration::from_secs(8)));
        assert_eq!(attempts.pause(at_ms(0), HERE, "other"), Some(Duration::from_secs(8)), "of the address");
        attempts.failed(at_ms(3_600_000), HERE, &name("anna"), true);
        assert_eq!(attempts.pause(at_ms(3_600_000), HERE, "anna"), None, "it is the first again");
        for _ in 0..8 {
            attempts.failed(at_ms(3_600_000), HERE, &name("anna"), true);
        }
        attempts.succeeded(HERE, "anna");
        assert_eq!(attempts.pause(at_ms(3_600_000), HERE, "anna"), None);
    }

    #[test]
    fn a_network_of_ipv6_is_one_address() {
        let mut attempts = Attempts::new();
        for host in 0..6_u16 {
            attempts.failed(
                at_ms(0),
                IpAddr::from([0x2001, 0xdb8, 0, 1, 0, 0, 0, host]),
                &name("anna"),
                false,
            );
        }
        assert!(attempts.pause(at_ms(0), IpAddr::from([0x2001, 0xdb8, 0, 1, 9, 9, 9, 9]), "anna").is_some());
        assert!(attempts.pause(at_ms(0), IpAddr::from([0x2001, 0xdb8, 0, 2, 0, 0, 0, 0]), "anna").is_none());
    }

    #[test]
    fn a_hundred_thousand_attempts_from_fifty_addresses_keep_the_owner_out_nowhere() {
        let mut attempts = Attempts::new();
        let (owner, mut checked) = (name("owner"), 0);
        let mut now = at_ms(0);
        for nth in 0..100_000_u32 {
            now += Duration::from_millis(20);
            let address = IpAddr::from([10, 0, 0, (nth % 50) as u8]);
            if attempts.pause(now, address, &owner).is_none() {
                attempts.failed(now, address, &owner, true);
                checked += 1;
            }
        }
        // One at each address, and then one in 30 s.
        assert!((50..=130).contains(&checked), "{checked} passwords were checked in 2000 s");
        assert_eq!(attempts.pause(now, IpAddr::from([10, 0, 1, 1]), &owner), None, "another address");
        let guessing = attempts.pause(now, IpAddr::from([10, 0, 0, 7]), &owner).unwrap_or_default();
        assert!(guessing <= ADDRESS_PAUSE_MAX, "within the pause at one of theirs");
    }

    #[test]
    fn more_addresses_than_are_remembered_displace_the_oldest() {
        let mut attempts = Attempts::new();
        for nth in 0..=ADDRESSES_MAX {
            for _ in 0..6 {
                attempts.failed(at_ms(nth as u64), IpAddr::from([10, 0, 0, nth as u8]), &name("x"), false);
            }
        }
        assert_eq!(attempts.pause(at_ms(100), IpAddr::from([10, 0, 0, 0]), "x"), None, "forgotten");
        assert!(attempts.pause(at_ms(100), IpAddr::from([10, 0, 0, 1]), "x").is_some());
    }
}
