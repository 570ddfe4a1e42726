//! Responses that are passed on while they arrive: where something else comes before them, or they are none, and beside reads that
//! share them. What is arriving shares nothing, and what waits is as right as ever.

use embassy_futures::join::{join, join3};
use mobgate::stats::Outcome;

use super::cut_through::{ASCII_OVERDUE, FRESH, PAIRS, SPEEDS, VALUE, between, counts, is_well, pairs};
use crate::prelude::*;

const EVEN: (u32, u32) = (19_200, 19_200);
/// Silence between two frames of a unit.
const PAUSE: Duration = Duration::from_millis(10);
/// Between a master and a client that ask one after the other.
const TURN: Duration = Duration::from_millis(50);
const READ_FRESH: [u8; 5] = [3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8];
/// What register 7 has, and then.
const OLD: [u8; 4] = VALUE;
const NEW: [u8; 4] = [3, 2, 0, 9];
const WRITE: [u8; 5] = [6, 0, 7, 0, 9];

/// A unit on the line below that answers the next request by these `frames`.
async fn responses(unit: &mut Master, frames: &[Vec<u8>]) {
    unit.receive().await.expect("a request");
    for frame in frames {
        unit.send_bytes(frame).await;
        Timer::after(PAUSE).await;
    }
}

/// What a master hears that asks unit 7, which responds by `frames`.
fn asked(speeds: (u32, u32), frames: &[Vec<u8>], check: impl for<'w> FnOnce(&Rig<'w>, Option<Vec<u8>>)) {
    between((Framing::Rtu, speeds.0), (Framing::Rtu, speeds.1), "", |world, rig, _| {
        let (mut master, mut unit) = (rig.master("up"), rig.master("down"));
        let asks = async {
            master.send(107, &READ).await;
            master.receive().await.map(|heard| heard.bytes)
        };
        let (heard, ()) = world.run_until(join(asks, responses(&mut unit, frames)));
        world.run_for(Duration::from_millis(200));
        check(rig, heard);
    });
}

/// Frames that the gateway has sent to the master.
fn sent_up(rig: &Rig<'_>) -> usize {
    let end = rig.end("up").number();
    rig.wire("up").frames().iter().filter(|frame| frame.from == end).count()
}

/// In all pairs of framings, on lines as fast as each other, and with a master's line that is slower, so that a copy begins when
/// nearly all is there. All rules have this `policy`.
fn shared(policy: &str, mut play: impl for<'w> FnMut(&str, &mut World<'w>, &Rig<'w>, &Device)) {
    pairs(&PAIRS, &SPEEDS[..2], policy, |case, _, world, rig, [device, _]| play(case, world, rig, device));
}

/// The fresh values in `response`, which were read after `asked`.
fn fresh(case: &str, response: &Response, asked: Instant) -> Fresh {
    let Response::Pdu(pdu) = response else { panic!("{case}: {response:?}") };
    let fresh = Fresh::from_response(pdu).unwrap_or_else(|| panic!("{case}: {pdu:02x?}"));
    assert!(u64::from(fresh.at_us) >= asked.as_micros(), "{case}: read before it was asked for");
    fresh
}

async fn after(wait: Duration, client: &mut Client, request: &[u8]) -> (Instant, Response) {
    Timer::after(wait).await;
    let asked = Instant::now();
    (asked, client.request(5, request).await)
}

async fn master_asks(master: &mut Master, request: &[u8]) -> (Instant, Response) {
    let asked = Instant::now();
    (asked, master.request(105, request).await)
}

/// The master asks at once for the fresh values, and each of the clients after its wait.
async fn all_ask(master: &mut Master, clients: [(Duration, &mut Client); 2]) -> [(Instant, Response); 3] {
    let [one, two] = clients.map(|(wait, client)| after(wait, client, &READ_FRESH));
    join3(master_asks(master, &READ_FRESH), one, two).await.into()
}

#[test]
fn a_response_is_passed_on_while_it_arrives_though_another_units_frame_came_before_it() {
    asked(EVEN, &[rtu::frame(6, &VALUE), rtu::frame(7, &VALUE)], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &VALUE)));
        assert_eq!(counts(rig, "S"), [1, 0, 0]);
    });
}

#[test]
fn nothing_follows_a_response_that_was_begun_and_proved_to_be_none() {
    asked(EVEN, &[rtu::frame(7, &[3, 4, 1, 2, 3, 4]), rtu::frame(7, &VALUE)], |rig, heard| {
        // The board relays as much as a good response has, but for the last character.
        assert!(heard.is_some_and(|heard| heard.len() < rtu::frame(107, &VALUE).len()));
        assert_eq!((counts(rig, "S"), sent_up(rig)), ([1, 0, 1], 1));
        let entry = rig.gateway.log().newest(0).expect("an entry");
        assert_eq!(entry.outcome, Outcome::Silence, "the master has got no response");
    });
}

#[test]
fn an_exception_that_may_be_to_something_else_is_broken_off_and_not_mixed_with_the_response() {
    // What nobody asked for is one byte short, and an exception might be to that as well.
    let frames = [rtu::frame(7, &[3, 0]), rtu::frame(7, &[0x83, 2]), rtu::frame(7, &VALUE)];
    asked((115_200, 9_600), &frames, |rig, heard| {
        let exception = rtu::frame(107, &[0x83, 2]);
        assert_eq!(heard.as_deref(), Some(&exception[..4]), "all but the last character");
        assert_eq!((counts(rig, "S"), sent_up(rig)), ([1, 0, 1], 1));
    });
}

#[test]
fn a_response_with_a_wrong_byte_count_is_not_begun_where_there_is_time_to_see_that() {
    asked((115_200, 9_600), &[rtu::frame(7, &[3, 4, 1, 2, 3, 4])], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &[0x83, 0x0b])));
        assert_eq!(counts(rig, "S")[0], 0);
    });
}

#[test]
fn noise_longer_than_any_frame_is_not_begun_though_a_response_may_seem_to_begin_in_it() {
    // What is kept of it when it is too long begins with the unit.
    let noise: Vec<u8> = [7, 3, 2, 0].into_iter().cycle().take(300).collect();
    asked(EVEN, &[[&[6][..], &noise[1..]].concat()], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &[0x83, 0x0b])));
        assert_eq!(counts(rig, "S")[0], 0);
    });
}

#[test]
fn no_response_that_was_corrupt_or_does_not_fit_is_taken_for_a_good_one() {
    let write = [6, 0, 50, 1, 2];
    pairs(&PAIRS, &SPEEDS, "", |case, _, world, rig, devices| {
        let kinds =
            [&Fault::CORRUPTING[..], &[Fault::WrongUnit], &Fault::MISFITS, &[Fault::WrongEcho]].concat();
        let mut master = rig.master("up").with_patience(Duration::from_secs(2));
        for (fault, nth) in kinds.into_iter().flat_map(|fault| (0..8).map(move |nth| (fault, nth))) {
            devices[0].set_faults(Faults::new(nth).with(When::Always, fault));
            let response = world.run_until(master.request(105, &write));
            let taken = matches!(&response, Response::Pdu(pdu) if *pdu != [0x86, 0x0b]);
            assert!(!taken, "{case}, {fault:?}: {response:?}");
            devices[0].set_faults(Faults::none());
            world.run_for(ASCII_OVERDUE);
            is_well(case, world, &mut master);
        }
        assert!(counts(rig, "S")[2] > 0, "{case}: responses were broken off");
    });
}

#[test]
fn who_shares_a_response_that_began_wrongly_is_given_no_part_of_it() {
    between((Framing::Ascii, 19_200), (Framing::Rtu, 19_200), "", |world, rig, _| {
        let (mut master, mut unit) = (rig.master("up"), rig.master("down"));
        let (mut busy, mut client) = (rig.client(machine(1), 502), rig.client(machine(2), 502));
        // The next request of a master that pauses is passed on when it is whole, as one that can share a response.
        let frame = framing::frame(Framing::Ascii, 106, &READ);
        world.run_until(master.send_bytes(&frame[..9]));
        world.run_for(Duration::from_millis(300));
        world.run_until(master.send_bytes(&frame[9..]));
        world.run_until(master.receive()).expect("a response");
        // Its turn comes before that of who has just been served.
        world.run_until(client.request(6, &READ));
        let begun = counts(rig, "S");
        world.spawn(async move { drop(busy.request(6, &[3, 0, 0, 0, 60]).await) });
        let asks = async {
            Timer::after_millis(2).await;
            master.request(107, &READ).await
        };
        let shares = async {
            Timer::after_millis(30).await;
            client.request(7, &READ).await
        };
        let unit = async {
            while unit.receive().await.expect("a request").bytes[0] != 7 {}
            for frame in [rtu::frame(7, &[3, 4, 1, 2, 3, 4]), rtu::frame(7, &VALUE)] {
                unit.send_bytes(&frame).await;
                Timer::after(PAUSE).await;
            }
        };
        let (_, response, ()) = world.run_until(join3(asks, shares, unit));
        assert_eq!(response, Response::Pdu(vec![0x83, 0x0b]), "and no part of what the master has heard");
        let [cut, _, aborted] = counts(rig, "S");
        let one_more = (begun[0] + 1, begun[2] + 1);
        assert_eq!((cut, aborted), one_more, "the master heard the beginning of the first one");
    });
}

#[test]
fn a_board_sleeps_while_a_response_gathers_unless_it_is_passed_on_meanwhile() {
    let reads = |size, cut: &str| {
        let settings = format!(
            "port S serial up rtu server 19200\nport C serial down rtu client 9600\nroute S * * * C cut {cut}\n"
        );
        rig::with_gateway_of(size, 1, &settings, |world: &mut World<'_>, rig| {
            rig.attach(world, "down", [Device::new(5)]);
            world.run_for(Duration::from_secs(1));
            let response = world.run_until(rig.master("up").request(5, &[3, 0, 0, 0, 10]));
            assert!(matches!(response, Response::Pdu(_)), "{response:?}");
            rig.sent("down").reads
        })
    };
    let rests = Size { rests: Duration::from_millis(50), ..Size::default() };
    let gathers = Size { gathers: true, ..Size::default() };
    // A board that counts characters reads neither the first nor the last one alone.
    for (size, most) in [(rests, 4), (gathers, 2)] {
        let (stored, passed_on) = (reads(size, "off"), reads(size, "on"));
        assert!(stored <= most, "{stored} reads of 25 characters");
        assert!(passed_on > stored, "{passed_on} reads");
    }
}

#[test]
fn of_a_response_that_breaks_off_a_board_reads_what_it_has_gathered() {
    let settings = "
port P502 tcp server 502
port C serial down rtu client 9600 timeout 100ms down-after 0 retries 0
route P502 * * * C
";
    let told = |length, gathers| {
        let size = Size { gathers, ..Size::default() };
        rig::with_gateway_of(size, 1, settings, |world: &mut World<'_>, rig| {
            let faults = Faults::new(7).with(When::Chance(0.5), Fault::CutTo(length));
            rig.attach(world, "down", [Device::new(5).with_faults(faults)]);
            let mut client = rig.client(machine(1), 502);
            let responses: Vec<_> =
                (0..20).map(|_| world.run_until(client.request(5, &[3, 0, 0, 0, 1]))).collect();
            let events = [Event::Response, Event::Corrupt, Event::Short, Event::Noise, Event::Timeout];
            (responses, events.map(|event| rig.counted("C", event)))
        })
    };
    for length in 1..7 {
        let (responses, events) = told(length, true);
        assert!((1..20).contains(&events[0]), "{length}: {events:?}");
        assert_eq!(
            (responses, events),
            told(length, false),
            "{length}: as a board that reads each character"
        );
    }
}

#[test]
fn a_read_that_is_being_passed_on_is_joined_by_nobody_and_those_who_wait_for_it_share_one() {
    shared("", |case, world, rig, device| {
        let mut master = rig.master("up");
        let (mut first, mut second) = (rig.client(machine(1), 502), rig.client(machine(2), 502));
        // While the request arrives, while its copy leaves, while its response arrives.
        for wait_ms in (0..60).step_by(3) {
            let before = device.counters().all_requests();
            let wait = Duration::from_millis(wait_ms);
            let clients = [(wait, &mut first), (wait, &mut second)];
            let [ours, one, two] = world.run_until(all_ask(&mut master, clients));
            let [ours, one, two] = [ours, one, two].map(|(asked, response)| fresh(case, &response, asked));
            let requests = device.counters().all_requests() - before;
            let shared = 1
                + u64::from(one.reads != two.reads)
                + u64::from(ours.reads != one.reads && ours.reads != two.reads);
            assert_eq!(requests, shared, "{case}, {wait_ms} ms: {ours:?} {one:?} {two:?}");
            world.run_for(TURN);
        }
        assert!(rig.counted("C", Event::Merged) > 0 && counts(rig, "C")[0] > 0, "{case}");
    });
}

#[test]
fn a_corrupt_read_is_answered_from_no_memory_and_joins_no_other() {
    shared("cache 1s", |case, world, rig, device| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        let up = rig.framing("up");
        let (_, response) = world.run_until(after(TURN, &mut client, &READ));
        assert_eq!(response, Response::Pdu(OLD.to_vec()), "{case}");
        for corruption in 1..16 {
            let mut frame = framing::frame(up, 105, &READ);
            // In the check: the request itself is the one whose response is in memory.
            let at = frame.len() - if up == Framing::Rtu { 1 + usize::from(corruption) % 2 } else { 3 };
            frame[at] = if up == Framing::Rtu {
                frame[at] ^ corruption
            } else {
                b"0123456789ABCDEF"[usize::from(corruption)]
            };
            if frame == framing::frame(up, 105, &READ) {
                continue;
            }
            world.run_until(async {
                master.send_bytes(&frame).await;
                Timer::after(TURN).await;
            });
        }
        assert_eq!(rig.sent("up").characters, 0, "{case}: no response to a corrupt request");
        assert_eq!((device.counters().all_requests(), rig.counted("C", Event::Cached)), (1, 0), "{case}");
    });
}

#[test]
fn no_read_is_answered_from_memory_across_a_write_that_is_being_passed_on() {
    shared("cache 10s", |case, world, rig, device| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        for wait_ms in 0..60 {
            device.memory().holding[7] = 0x0507;
            world.run_until(master_asks(&mut master, &[5, 0, 1, 0, 0]));
            let (_, response) = world.run_until(after(TURN, &mut client, &READ));
            assert_eq!(response, Response::Pdu(OLD.to_vec()), "{case}");
            let writes = device.writes().len();
            let read = async {
                let (_, response) = after(Duration::from_millis(wait_ms), &mut client, &READ).await;
                (response, device.writes().len())
            };
            let ((_, written), (read, by_then)) =
                world.run_until(join(master_asks(&mut master, &WRITE), read));
            assert_eq!(written, Response::Pdu(WRITE.to_vec()), "{case}");
            let is_old = read == Response::Pdu(OLD.to_vec());
            assert!(is_old || read == Response::Pdu(NEW.to_vec()), "{case}: {read:?}");
            assert!(!is_old || by_then == writes, "{case}, {wait_ms} ms: an old value behind the write");
            world.run_for(TURN);
        }
    });
}

#[test]
fn whatever_is_asked_side_by_side_is_answered_right() {
    let mut random = Random::new(7);
    shared("cache 20ms", |case, world, rig, device| {
        let mut master = rig.master("up");
        let (mut first, mut second) = (rig.client(machine(1), 502), rig.client(machine(2), 502));
        for _ in 0..150 {
            let waits = [(); 2].map(|()| Duration::from_micros(random.within(0..=40_000)));
            let clients = [(waits[0], &mut first), (waits[1], &mut second)];
            let responses = world.run_until(all_ask(&mut master, clients));
            // A response may be 20 ms older than its question, and the device reads before it responds.
            let least = |asked: Instant| asked - Duration::from_millis(20);
            for (asked, response) in responses {
                fresh(case, &response, least(asked));
            }
            world.run_for(Duration::from_micros(random.within(5_000..=40_000)));
        }
        assert!(counts(rig, "C")[0] > 0, "{case}");
        assert!(device.counters().all_requests() > 150, "{case}");
    });
}

#[test]
fn a_response_behind_what_looked_like_its_beginning_is_not_mixed_with_that() {
    let write = [6, 0, 50, 1, 2];
    let size = Size { late_reads: Duration::from_millis(12), ..Size::default() };
    let settings = "port S serial up ascii server 19200 7E1\nport C serial down rtu client 9600 8E1 timeout 100ms\n\
         route S 101-109 * -100 C cut on\n";
    rig::with_gateway_of(size, 1, settings, |world, rig| {
        let (mut master, mut unit) = (rig.master("up"), rig.master("down"));
        // Two stray characters, which look like unit and function.
        let frames = [[&[7, 6][..], &rtu::frame(7, &write)].concat()];
        for nth in 0..60 {
            world.run_for(Duration::from_micros(200_000 + 317 * nth));
            let asks = async {
                master.send(107, &write).await;
                master.receive().await
            };
            let (heard, ()) = world.run_until(join(asks, responses(&mut unit, &frames)));
            let taken = heard.and_then(|heard| framing::open(Framing::Ascii, &heard.bytes));
            let is_good = taken.as_ref().is_none_or(|taken| *taken == (107, write.to_vec()));
            assert!(is_good, "{nth}: {taken:02x?}");
        }
        let [cut, _, aborted] = counts(rig, "S");
        assert!(cut > 0 && aborted == cut, "{cut} were begun, and {aborted} of them broken off");
    });
}
