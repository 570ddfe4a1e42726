//! Turns that have been counted to their end.

use core::net::IpAddr;

use embassy_time::Instant;

use super::{Access, Entry, Next, PortQueue, Ready, Requester};
use crate::settings::Priority;

/// A read by `connection` from `address`, or from a serial line; the request is the connection.
fn ask(queue: &mut PortQueue<u16>, connection: u16, address: Option<IpAddr>) {
    let requester = Requester::new((0, connection), address);
    let (priority, deadline, access) = (Priority::Normal, Instant::MAX, Access::Read);
    assert_eq!(queue.push(connection, Entry { requester, priority, unit: 1, deadline, access }), None);
}

fn serve(queue: &mut PortQueue<u16>) -> u16 {
    match queue.next(Instant::MIN, |_| Ready::Now) {
        Next::Serve(request, _) => request,
        other => panic!("{other:?}"),
    }
}

#[test]
fn when_the_turns_have_been_counted_to_their_end_everybody_starts_afresh() {
    let mut queue = PortQueue::new();
    (1..=3).for_each(|connection| ask(&mut queue, connection, None));
    queue.turns = u32::MAX - 1;
    // The last turn there is, and the first one.
    assert_eq!((serve(&mut queue), queue.turns), (1, u32::MAX));
    assert_eq!((serve(&mut queue), queue.turns), (2, 1));
    ask(&mut queue, 2, None);
    ask(&mut queue, 1, None);
    assert_eq!([serve(&mut queue), serve(&mut queue), serve(&mut queue)], [3, 1, 2], "2 had its turn");
}

#[test]
fn so_do_all_addresses() {
    let mut queue = PortQueue::new();
    let [one, other] = [1, 2].map(|host| Some([10, 0, 0, host].into()));
    for (connection, address) in [(1, one), (2, one), (3, other)] {
        ask(&mut queue, connection, address);
    }
    queue.turns = u32::MAX;
    assert_eq!([serve(&mut queue), serve(&mut queue)], [1, 3], "the other address has had no turn");
    assert_eq!(serve(&mut queue), 2);
}
