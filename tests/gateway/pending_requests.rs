//! Open requests of a connection and their transaction ids.

use mobgate::port::client::pending::{PENDING_MAX, PendingRequests};

use crate::prelude::*;

const TIMEOUT: Duration = Duration::from_millis(100);

#[test]
fn sixteen_requests_can_be_open_and_no_more() {
    let mut pending_requests = PendingRequests::new(65_530, TIMEOUT);
    let now = Instant::from_secs(1);
    let ids: Vec<u16> =
        (0..PENDING_MAX).map(|order| pending_requests.start(order, 1, now).unwrap()).collect();
    assert_eq!(ids[..8], [65_530, 65_531, 65_532, 65_533, 65_534, 65_535, 0, 1]);
    assert_eq!(pending_requests.room(now), None);
    assert_eq!(pending_requests.start(99, 1, now), Err(99));
    assert_eq!(pending_requests.finish(ids[3]).map(|pending| pending.request), Some(3));
    assert_eq!(pending_requests.finish(ids[3]), None, "a response is taken once");
    assert_eq!(pending_requests.room(now), Some(now));
}

#[test]
fn when_too_many_ids_are_lost_the_next_request_waits_for_the_first_windows_end() {
    let mut pending_requests = PendingRequests::new(0, TIMEOUT);
    let mut now = Instant::from_secs(1);
    let window = Duration::from_secs(3_600);
    let mut sent = 0;
    while pending_requests.room(now) == Some(now) {
        pending_requests.start((), 1, now).unwrap();
        sent += 1;
        now += TIMEOUT;
        assert!(pending_requests.expire(now, window).is_some());
    }
    assert_eq!(sent, 32);
    assert_eq!(pending_requests.room(now), Some(Instant::from_secs(1) + TIMEOUT + window));
}

proptest! {
    /// No id is given while it is open, or while a response to its last use may come; whatever is started ends once.
    #[test]
    fn an_id_is_not_used_again_while_a_response_to_it_may_come(
        first in any::<u16>(),
        window_ms in 0..400_u64,
        steps in prop::collection::vec((0..4_u8, 0..60_u64), 1..400),
    ) {
        let window = Duration::from_millis(window_ms);
        let mut pending_requests = PendingRequests::new(first, TIMEOUT);
        let mut now = Instant::from_secs(1);
        let mut open: Vec<u16> = Vec::new();
        let mut lost: Vec<(u16, Instant)> = Vec::new();
        for (step, ms) in steps {
            match step {
                0 | 1 => match pending_requests.start((), 5, now) {
                    Ok(id) => {
                        prop_assert!(!open.contains(&id));
                        prop_assert!(!lost.iter().any(|&(other, until)| other == id && until > now));
                        open.push(id);
                    }
                    Err(()) => prop_assert_ne!(pending_requests.room(now), Some(now)),
                },
                2 if !open.is_empty() => {
                    let id = open.remove(ms as usize % open.len());
                    prop_assert!(pending_requests.finish(id).is_some());
                }
                _ => {
                    now += Duration::from_millis(ms);
                    while let Some(pending) = pending_requests.expire(now, window) {
                        prop_assert!(pending.sent + TIMEOUT <= now);
                        open.retain(|id| *id != pending.id);
                        lost.push((pending.id, now + window));
                    }
                }
            }
            prop_assert_eq!(pending_requests.len(), open.len());
        }
    }
}
