//! A TCP client with several servers, by value: who is connected, who has to go, and what numbers units have there.

use mobgate::port::client::servers::{Choice, RETRY_FIRST, Servers};
use mobgate::settings::{Tag, UnitRange};

use crate::prelude::*;

#[test]
fn a_free_link_takes_who_is_wanted_before_who_is_to_be_tried_again_before_who_is_kept() {
    let at = Instant::from_secs;
    let unit = |n| (UnitRange { first: n, last: n }, Tag::Keep);
    let mut servers = Servers::new([unit(1), unit(2), unit(3)]);
    assert_eq!(servers.choose(0, None, false, at(0)), Choice::Wait(Instant::MAX));
    assert_eq!(servers.choose(0, Some(1), true, at(0)), Choice::Connect(1));
    let connected = (servers.connection(2), servers.unconnected(2), servers.connected_count());
    assert_eq!(connected, (Some(0), None, 1));
    servers.failed(1, at(0));
    servers.release(1);
    assert!(!servers.takes(2, false) && servers.takes(2, true), "only who spares servers himself may ask");
    assert_eq!(servers.choose(0, None, false, at(0)), Choice::Wait(at(0) + RETRY_FIRST));
    assert_eq!(servers.choose(1, None, true, at(0)), Choice::Connect(0), "kept");
    assert_eq!(servers.choose(0, None, true, at(1)), Choice::Connect(1), "due");
    assert!(
        !servers.takes(2, false) && servers.takes(2, true),
        "whoever spares servers waits for the attempt"
    );
    servers.opened(1);
    assert!(servers.takes(2, false));
    // Each pause is longer than the one before, up to ten seconds.
    let pauses = (0..7).map(|_| {
        servers.failed(1, at(100));
        servers.release(1);
        servers.retries(at(100)).1 - at(100)
    });
    let ms: Vec<u64> = pauses.map(|pause| pause.as_millis()).collect();
    assert_eq!(ms, [1_000, 2_000, 4_000, 8_000, 10_000, 10_000, 10_000]);
    servers.well(1);
    servers.failed(1, at(200));
    assert_eq!(servers.retries(at(200)), (0, at(200) + RETRY_FIRST));
    assert_eq!(servers.retries(at(201)).0, 0b10);
}

#[test]
fn units_have_other_numbers_on_the_way_out_and_their_own_on_the_way_back() {
    let units = |first, last| UnitRange { first, last };
    let servers = Servers::new([
        (units(1, 5), Tag::Keep),
        (units(7, 7), Tag::Set(255)),
        (units(11, 15), Tag::Subtract(10)),
        (units(20, 21), Tag::Add(100)),
    ]);
    for (server, unit, outside) in [(0, 3, 3), (1, 7, 255), (2, 12, 2), (3, 21, 121)] {
        assert_eq!((servers.of(unit), servers.outside(unit)), (Some(server), Some(outside)));
        assert_eq!(servers.inside(server, outside), Some(unit));
    }
    for (server, outside) in [(0, 6), (1, 7), (2, 6), (2, 12), (3, 20), (3, 90), (4, 1)] {
        assert_eq!(servers.inside(server, outside), None, "{outside} is none of {server}");
    }
    assert_eq!((servers.of(6), servers.outside(6), servers.connection(6)), (None, None, None));
}
