//! Who is served next: the pure queue of a client-side port.

use std::net::{Ipv4Addr, Ipv6Addr};

use mobgate::port::client::queue::{Access, Entry, Next, PASSED_OVER_MAX, PortQueue, Requester, WAITING_MAX};

use crate::prelude::*;

fn entry(address: u8, connection: u16) -> Entry {
    let address = Some(IpAddr::V4(Ipv4Addr::new(10, 0, 0, address)));
    let requester = Requester::new((0, connection), address);
    Entry {
        requester,
        priority: Priority::Normal,
        unit: 1,
        deadline: Instant::MAX,
        access: Access::SharedRead,
    }
}

fn ranked(priority: Priority) -> Entry {
    Entry { priority, ..entry(priority as u8, 0) }
}

fn queue_of<T>(orders: impl IntoIterator<Item = (T, Entry)>) -> PortQueue<T> {
    let mut queue = PortQueue::new();
    orders.into_iter().for_each(|(order, entry)| assert!(queue.push(order, entry).is_none()));
    queue
}

fn serve<T>(queue: &mut PortQueue<T>) -> Option<T> {
    match queue.next(Instant::MIN, |_| Ready::Now) {
        Next::Serve(order, _) => Some(order),
        Next::Wait(_) | Next::Empty => None,
    }
}

fn drain<T>(queue: &mut PortQueue<T>) -> Vec<T> {
    std::iter::from_fn(|| serve(queue)).collect()
}

#[test]
fn requests_of_one_requester_keep_their_order() {
    let mut queue = queue_of((0..10).map(|order| (order, entry(1, 1))));
    assert_eq!(drain(&mut queue), (0..10).collect::<Vec<_>>());
}

#[test]
fn a_low_order_that_was_passed_over_and_is_gone_holds_up_nobody() {
    let mut queue = queue_of([(0, ranked(Priority::Low))]);
    for order in 1..=u32::from(PASSED_OVER_MAX) {
        queue.push(order, ranked(Priority::Normal));
        assert_eq!(serve(&mut queue), Some(order));
    }
    assert!(queue.take_if(|order, _| (*order == 0).then_some(())).is_some());
    queue.push(100, ranked(Priority::Normal));
    assert_eq!(serve(&mut queue), Some(100));
}

#[test]
fn addresses_take_turns_and_within_an_address_its_connections() {
    let mut queue = PortQueue::new();
    for round in 0..2 {
        queue.push(("a1", round), entry(1, 1));
        queue.push(("a2", round), entry(1, 2));
        queue.push(("b", round), entry(2, 3));
    }
    let order: Vec<_> = drain(&mut queue).into_iter().map(|(who, _)| who).collect();
    assert_eq!(order, ["a1", "b", "a2", "b", "a1", "a2"]);
}

#[test]
fn a_client_with_nothing_queued_goes_ahead_of_those_that_keep_the_line_busy() {
    let mut queue = queue_of((0..31).map(|flooder| (flooder, entry(flooder, 0))));
    for _ in 0..100 {
        let flooder = serve(&mut queue).unwrap();
        queue.push(flooder, entry(flooder, 0));
    }
    queue.push(99, entry(99, 0));
    assert_eq!(serve(&mut queue), Some(99));
}

#[test]
fn higher_priority_goes_first() {
    let upwards = [Priority::Low, Priority::Normal, Priority::High];
    let mut queue = queue_of(upwards.map(|priority| (priority, ranked(priority))));
    assert_eq!(drain(&mut queue), [Priority::High, Priority::Normal, Priority::Low]);
}

#[test]
fn a_low_order_is_passed_over_a_bounded_number_of_times() {
    for flood in [Priority::Normal, Priority::High] {
        let mut queue = queue_of([(Priority::Low, ranked(Priority::Low))]);
        let mut turns = 0;
        loop {
            queue.push(flood, ranked(flood));
            turns += 1;
            if serve(&mut queue) == Some(Priority::Low) {
                break;
            }
            assert!(turns <= 2 * u32::from(PASSED_OVER_MAX), "starved by {flood:?}");
        }
        assert!(turns > u32::from(PASSED_OVER_MAX), "served after {turns} turns, too early to be low");
    }
}

#[test]
fn an_overdue_low_order_does_not_delay_a_high_one() {
    let mut queue = queue_of([(Priority::Low, ranked(Priority::Low))]);
    for _ in 0..PASSED_OVER_MAX {
        queue.push(Priority::Normal, ranked(Priority::Normal));
        assert_eq!(serve(&mut queue), Some(Priority::Normal));
    }
    queue.push(Priority::Normal, ranked(Priority::Normal));
    queue.push(Priority::High, ranked(Priority::High));
    assert_eq!(drain(&mut queue), [Priority::High, Priority::Low, Priority::Normal]);
}

#[test]
fn a_held_unit_lets_the_others_pass() {
    let mut queue = queue_of([7, 8].map(|unit| (unit, Entry { unit, ..entry(1, 1) })));
    let held = Instant::from_secs(5);
    let ready = |unit| if unit == 7 { Ready::At(held) } else { Ready::Now };
    assert!(matches!(queue.next(Instant::MIN, ready), Next::Serve(8, _)));
    assert_eq!(queue.next(Instant::MIN, ready), Next::Wait(held));
    assert!(matches!(queue.next(held, ready), Next::Serve(7, _)));
    assert_eq!(queue.next(held, ready), Next::Empty);
}

#[test]
fn a_full_queue_makes_room_at_the_cost_of_whoever_has_most() {
    let mut queue = queue_of((0..WAITING_MAX).map(|order| (order, entry(1, 1))));
    assert_eq!(queue.push(1000, entry(1, 1)), Some(1000), "the flooder itself is refused");
    let gone = queue.push(2000, entry(2, 2));
    assert_eq!(gone, Some(WAITING_MAX - 1), "its newest order goes for another address");
    let gone = queue.push(3000, entry(1, 3));
    assert_eq!(gone, Some(WAITING_MAX - 2), "and for another connection of its address");
    assert_eq!(queue.len(), WAITING_MAX);
}

#[test]
fn a_full_queue_makes_room_only_where_that_leaves_the_newcomer_with_no_more_than_the_others() {
    // A newcomer's address and connection, how many wait of each before, and whose newest order goes: none where the newcomer is refused.
    type Case = ((u8, u16), &'static [((u8, u16), usize)], Option<(u8, u16)>);
    const HALF: usize = WAITING_MAX / 2;
    let cases: &[Case] = &[
        ((1, 1), &[((1, 1), HALF - 1), ((2, 2), HALF + 1)], Some((2, 2))),
        ((1, 1), &[((1, 1), HALF), ((2, 2), HALF)], None),
        ((1, 1), &[((1, 1), HALF - 12), ((2, 2), HALF + 12)], Some((2, 2))),
        // So within an address, also where all of it have one and the same number.
        ((1, 1), &[((1, 1), HALF - 1), ((1, 2), HALF + 1)], Some((1, 2))),
        ((1, 1), &[((1, 1), HALF), ((1, 2), HALF)], None),
        ((1, 3), &[((1, 1), HALF), ((1, 2), HALF)], Some((1, 2))),
    ];
    for (newcomer, waiting, goes) in cases {
        let mut queue = PortQueue::new();
        for ((address, connection), count) in *waiting {
            (0..*count).for_each(|_| {
                assert_eq!(queue.push((*address, *connection), entry(*address, *connection)), None)
            });
        }
        let (address, connection) = *newcomer;
        let gone = queue.push((9, 9), entry(address, connection));
        assert_eq!(gone, Some(goes.unwrap_or((9, 9))), "{newcomer:?} {waiting:?}");
    }
    // Two of each connection, or of each address, are one more than a new one would have.
    for apart in [false, true] {
        let mut queue = PortQueue::new();
        for order in 0..WAITING_MAX as u16 {
            let connection = order / 2;
            let address = if apart { connection as u8 } else { 1 };
            assert_eq!(queue.push(order, entry(address, connection)), None);
        }
        let newcomer = if apart { entry(200, 1000) } else { entry(1, 1000) };
        assert_eq!(queue.push(1000, newcomer), Some(WAITING_MAX as u16 - 1));
    }
}

#[test]
fn who_had_a_turn_comes_behind_who_had_none() {
    for (had, none) in [(entry(1, 1), entry(1, 2)), (entry(1, 1), entry(2, 2))] {
        let mut queue = PortQueue::new();
        queue.push("first", had);
        assert_eq!(serve(&mut queue), Some("first"));
        queue.push("had", had);
        queue.push("none", none);
        assert_eq!(drain(&mut queue), ["none", "had"]);
    }
}

#[test]
fn the_first_unit_that_may_be_asked_is_waited_for() {
    let mut queue = queue_of([3, 2, 4].map(|unit| (unit, Entry { unit, ..entry(1, 1) })));
    let at = |unit: u8| Instant::from_secs(unit.into());
    assert_eq!(queue.next(Instant::MIN, |unit| Ready::At(at(unit))), Next::Wait(at(2)));
}

#[test]
fn addresses_of_version_6_that_differ_in_one_bit_are_told_from_each_other() {
    let bits = u128::from_be_bytes(*b"an IPv6 address.");
    let of = |bits: u128| Requester::new((0, 0), Some(IpAddr::from(Ipv6Addr::from_bits(bits))));
    for bit in 0..128 {
        assert!(!of(bits).shares_address(&of(bits ^ 1 << bit)), "{bit}");
    }
}

#[test]
fn addresses_of_both_kinds_are_told_from_each_other() {
    let of = |text: &str| Requester::new((0, 0), Some(text.parse().unwrap()));
    let others = ["10.0.0.1", "10.0.1.0", "0.0.0.0", "fe80::1", "fe80::1:0:1", "fe80:0:1::1", "fe82::1"];
    for (at, one) in others.iter().enumerate() {
        for (with, other) in others.iter().enumerate() {
            assert_eq!(of(one).shares_address(&of(other)), at == with, "{one} {other}");
        }
    }
    let serial = Requester::new((3, 0), None);
    assert!(serial.shares_address(&Requester::new((4, 0), None)) && !serial.shares_address(&of("10.0.0.1")));
}

#[test]
fn an_order_that_comes_back_goes_first_and_finds_no_room_in_a_full_queue() {
    let mut queue = PortQueue::new();
    assert!(queue.is_empty() && queue.first_deadline().is_none());
    (1..WAITING_MAX).for_each(|order| assert_eq!(queue.push(order, entry(1, 1)), None));
    assert_eq!(queue.push_front(1000, entry(1, 1)), None);
    assert!(!queue.is_empty() && queue.len() == WAITING_MAX);
    assert_eq!(queue.push_front(2000, entry(1, 1)), Some(2000));
    let expected: Vec<_> = std::iter::once(1000).chain(1..WAITING_MAX).collect();
    assert_eq!(drain(&mut queue), expected);
}

#[test]
fn it_is_known_of_each_unit_whether_a_write_waits() {
    let mut queue = queue_of([(1, entry(1, 1))]);
    assert!(!queue.writes_to(1));
    queue.push(2, Entry { access: Access::Write, ..entry(1, 1) });
    assert!(queue.writes_to(1) && !queue.writes_to(2));
    queue.push(3, Entry { access: Access::Write, unit: 0, ..entry(1, 1) });
    assert!(queue.writes_to(2), "a broadcast");
}

#[test]
fn the_last_turns_of_all_who_may_wait_are_remembered() {
    let all = 0..WAITING_MAX as u16;
    let mut queue = queue_of(all.clone().map(|requester| (requester, entry(1, requester))));
    assert_eq!(drain(&mut queue), all.clone().collect::<Vec<_>>());
    // The one served longest ago is forgotten for another one, who is first as he has had no turn.
    for requester in all.clone().rev() {
        queue.push(requester, entry(1, requester));
    }
    assert_eq!(queue.take_if(|order, _| (*order == 0).then_some(())), Some((0, ())));
    queue.push(1000, entry(1, 1000));
    let expected: Vec<_> = std::iter::once(1000).chain(all.skip(1)).collect();
    assert_eq!(drain(&mut queue), expected);
}

#[test]
fn unwanted_orders_are_taken_out_with_the_reason() {
    let mut queue = PortQueue::new();
    queue.push(1, Entry { deadline: Instant::from_secs(1), ..entry(1, 1) });
    queue.push(2, Entry { deadline: Instant::from_secs(3), ..entry(1, 1) });
    assert_eq!(queue.first_deadline(), Some(Instant::from_secs(1)));
    let late = |_: &i32, entry: &Entry| (entry.deadline <= Instant::from_secs(2)).then_some("late");
    assert_eq!(queue.take_if(late), Some((1, "late")));
    assert_eq!(queue.take_if(late), None);
    assert_eq!(drain(&mut queue), [2]);
}

/// Orders are pairs of who asks and what; the first one's companions, in the order of arrival.
fn served_together(orders: &[(&'static str, u8, Entry)]) -> Vec<&'static str> {
    let mut queue = queue_of(orders.iter().map(|(who, what, entry)| ((*who, *what), *entry)));
    let Next::Serve((leader, asked), entry) = queue.next(Instant::MIN, |_| Ready::Now) else {
        panic!("nothing to serve");
    };
    let mut together: Vec<_> = std::iter::from_fn(|| queue.companion(&entry, |(_, what)| *what == asked))
        .map(|(who, _)| who)
        .collect();
    together.push(leader);
    together.reverse();
    together
}

#[test]
fn identical_reads_are_served_together() {
    let other_unit = Entry { unit: 2, ..entry(4, 0) };
    let alone = Entry { access: Access::Read, ..entry(5, 0) };
    let orders = [
        ("a", 3, entry(1, 0)),
        ("b", 3, entry(2, 0)),
        ("asks something else", 4, entry(3, 0)),
        ("asks another unit", 3, other_unit),
        ("wants its own response", 3, alone),
        ("again a", 3, entry(1, 0)),
    ];
    assert_eq!(served_together(&orders), ["a", "b", "again a"]);
    let first = [("wants its own response", 3, alone), ("a", 3, entry(1, 0))];
    assert_eq!(served_together(&first), ["wants its own response"]);
}

#[test]
fn no_read_is_served_before_a_write_that_came_earlier_by_riding_on_another() {
    let write = |unit| Entry { unit, access: Access::Write, ..entry(3, 0) };
    for unit in [1, 0] {
        let orders = [
            ("before", 3, entry(1, 0)),
            ("also before", 3, entry(2, 0)),
            ("the write", 6, write(unit)),
            ("behind it", 3, entry(4, 0)),
        ];
        assert_eq!(served_together(&orders), ["before", "also before"], "unit {unit}");
    }
    let orders = [("a", 3, entry(1, 0)), ("the write", 6, write(9)), ("b", 3, entry(4, 0))];
    assert_eq!(served_together(&orders), ["a", "b"], "a write to another unit");
}

#[test]
fn companions_go_with_the_most_urgent_of_them_and_cost_no_turn() {
    let mut queue = PortQueue::new();
    queue.push("low", ranked(Priority::Low));
    queue.push("normal", ranked(Priority::Normal));
    let high = ranked(Priority::High);
    queue.push("high", high);
    assert_eq!(serve(&mut queue), Some("high"));
    assert_eq!(queue.companion(&high, |_| true), Some("normal"));
    assert_eq!(queue.companion(&high, |_| true), Some("low"));
    assert_eq!(queue.companion(&high, |_| true), None);
    // The one whose turn it was comes after one that only rode along.
    queue.push("again", Entry { priority: Priority::Low, ..high });
    queue.push("low", ranked(Priority::Low));
    assert_eq!(drain(&mut queue), ["low", "again"]);
}

proptest! {
    /// Whatever is pushed comes out exactly once, by being served, evicted or refused; and of two orders of one requester
    /// and rank the earlier one is served first.
    #[test]
    fn every_order_comes_out_once(
        steps in prop::collection::vec((any::<bool>(), 0_u8..6, 0_u16..3, 0_usize..3), 1..400),
    ) {
        let priorities = [Priority::High, Priority::Normal, Priority::Low];
        let mut queue = PortQueue::new();
        let mut inside = std::collections::BTreeMap::new();
        for (number, (push, address, connection, priority)) in steps.into_iter().enumerate() {
            if push {
                let entry = Entry { priority: priorities[priority], ..entry(address, connection) };
                inside.insert(number, entry);
                if let Some(out) = queue.push(number, entry) {
                    prop_assert!(inside.remove(&out).is_some());
                    prop_assert_eq!(inside.len(), WAITING_MAX);
                }
            } else if let Some(out) = serve(&mut queue) {
                let entry = inside.remove(&out);
                prop_assert!(entry.is_some(), "{} was not inside", out);
                prop_assert!(inside.iter().all(|(other, twin)| Some(*twin) != entry || *other > out));
            } else {
                prop_assert!(inside.is_empty());
            }
            prop_assert_eq!(queue.len(), inside.len());
        }
        prop_assert_eq!(drain(&mut queue).len(), inside.len());
    }

    /// However many requesters come and go, a request keeps the entry with which it was pushed.
    #[test]
    fn who_asked_is_known_of_every_order_that_waits(steps in prop::collection::vec(0_u16..300, 1..400)) {
        let mut queue = PortQueue::new();
        for (number, who) in steps.into_iter().enumerate() {
            let entry = Entry { unit: (who % 7) as u8, ..entry((who % 5) as u8, who) };
            queue.push((number, entry), entry);
            if number % 3 == 0 {
                let Next::Serve((_, own), given) = queue.next(Instant::MIN, |_| Ready::Now) else { continue };
                prop_assert_eq!(own, given);
            }
            prop_assert!(queue.take_if(|(_, own), given| (own != given).then_some(())).is_none());
        }
    }

    /// Against any backlog of others, an address that was not served within the last turns of all is next.
    #[test]
    fn a_sparse_address_is_served_next(backlog in prop::collection::vec((0_u8..20, 0_u16..3), 1..60)) {
        let mut queue = PortQueue::new();
        for (address, connection) in &backlog {
            queue.push(*address, entry(*address, *connection));
        }
        for _ in 0..backlog.len() / 2 {
            serve(&mut queue);
        }
        // Whoever was not served yet arrived earlier and goes first; with all served once, the newcomer is next.
        let unserved: std::collections::BTreeSet<_> = backlog.iter().map(|(address, _)| *address).collect();
        queue.push(99, entry(99, 0));
        let position = drain(&mut queue).iter().position(|address| *address == 99).unwrap();
        prop_assert!(position <= unserved.len());
    }
}
