//! Frames that are passed on while they arrive, beside reads that share answers: what is arriving shares nothing, and what
//! waits is as right as ever.

use embassy_futures::join::{join, join3};
use embassy_time::{Duration, Instant, Timer};
use mobgate::settings::Framing;
use mobgate::stats::Event;
use mobgate_simulator::client::Answer;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Client, Device, Master, Random, Rig, World, framing, rig};

use super::cut_through::counts;

const FRAMINGS: [Framing; 2] = [Framing::Rtu, Framing::Ascii];
/// Lines as fast as each other, and a master's line that is slower, so that a copy begins when nearly all is there.
const SPEEDS: [(u32, u32); 2] = [(19_200, 19_200), (9_600, 115_200)];
const FRESH: [u8; 5] = [3, 0, 100, 0, Fresh::REGISTERS as u8];
const READ: [u8; 5] = [3, 0, 7, 0, 1];
const OLD: [u8; 4] = [3, 2, 5, 7];
const NEW: [u8; 4] = [3, 2, 0, 9];
const WRITE: [u8; 5] = [6, 0, 7, 0, 9];
const PAUSE: Duration = Duration::from_millis(50);

/// A master's line and a TCP server in front of device 5, all with `policy`; the master calls it 105. In all pairs of framings.
fn shared(policy: &str, mut play: impl for<'w> FnMut(&str, &mut World<'w>, &Rig<'w>, &Device)) {
    let pairs = FRAMINGS.iter().flat_map(|up| FRAMINGS.iter().map(move |down| (up, down)));
    for ((up, down), (fast, slow)) in pairs.flat_map(|pair| SPEEDS.map(|speeds| (pair, speeds))) {
        let format = |framing| if framing == Framing::Rtu { "8E1" } else { "7E1" };
        let settings = format!(
            "port S serial up {up} server {fast} {}\nport C serial down {down} client {slow} {}\n\
             port T tcp server 502\nroute S 105 * -100 C {policy}\nroute T * * * C {policy}\n",
            format(*up),
            format(*down)
        );
        rig::with_gateway(1, &settings, |world, rig| {
            let device = Device::new(5).with_fresh(100);
            rig.attach(world, "down", [device.clone(), Device::new(6)]);
            world.run_for(Duration::from_secs(1));
            play(&format!("{up} {fast} to {down} {slow}"), world, rig, &device);
            world.run_for(Duration::from_secs(5));
            assert_eq!(rig.frames_in_use(), 0);
            assert_eq!(device.counters().gap_inside, 0);
        });
    }
}

/// The fresh values in `answer`, which were read after `asked`.
fn fresh(case: &str, answer: &Answer, asked: Instant) -> Fresh {
    let Answer::Pdu(pdu) = answer else { panic!("{case}: {answer:?}") };
    let fresh = Fresh::from_response(pdu).unwrap_or_else(|| panic!("{case}: {pdu:02x?}"));
    assert!(u64::from(fresh.at_us) >= asked.as_micros(), "{case}: read before it was asked for");
    fresh
}

/// Asks after `wait`.
async fn after(wait: Duration, client: &mut Client, request: &[u8]) -> (Instant, Answer) {
    Timer::after(wait).await;
    let asked = Instant::now();
    (asked, client.request(5, request).await)
}

/// The master asks at once.
async fn master_asks(master: &mut Master, request: &[u8]) -> (Instant, Answer) {
    let asked = Instant::now();
    (asked, master.request(105, request).await)
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
            let ((asked, ours), (asked_first, one), (asked_second, two)) = world.run_until(join3(
                master_asks(&mut master, &FRESH),
                after(wait, &mut first, &FRESH),
                after(wait, &mut second, &FRESH),
            ));
            let ours = fresh(case, &ours, asked);
            let (one, two) = (fresh(case, &one, asked_first), fresh(case, &two, asked_second));
            let requests = device.counters().all_requests() - before;
            let shared = 1
                + u64::from(one.reads != two.reads)
                + u64::from(ours.reads != one.reads && ours.reads != two.reads);
            assert_eq!(requests, shared, "{case}, {wait_ms} ms: {ours:?} {one:?} {two:?}");
            world.run_for(PAUSE);
        }
        assert!(rig.counted("C", Event::Merged) > 0 && counts(rig, "C")[0] > 0, "{case}");
    });
}

#[test]
fn a_damaged_read_is_answered_from_no_memory_and_joins_no_other() {
    shared("cache 1s", |case, world, rig, device| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        let up = rig.framing("up");
        let (_, answer) = world.run_until(after(PAUSE, &mut client, &READ));
        assert_eq!(answer, Answer::Pdu(OLD.to_vec()), "{case}");
        for damage in 1..16 {
            let mut frame = framing::frame(up, 105, &READ);
            // In the check: the request itself is the one whose answer is in memory.
            let at = frame.len() - if up == Framing::Rtu { 1 + usize::from(damage) % 2 } else { 3 };
            frame[at] = if up == Framing::Rtu {
                frame[at] ^ damage
            } else {
                b"0123456789ABCDEF"[usize::from(damage)]
            };
            if frame == framing::frame(up, 105, &READ) {
                continue;
            }
            world.run_until(async {
                master.send_bytes(&frame).await;
                Timer::after(PAUSE).await;
            });
        }
        assert_eq!(rig.sent("up").characters, 0, "{case}: no answer to a damaged request");
        assert_eq!((device.counters().all_requests(), rig.counted("C", Event::Cached)), (1, 0), "{case}");
    });
}

#[test]
fn memory_knows_what_was_passed_on_and_forgets_what_was_written() {
    shared("cache 10s", |case, world, rig, device| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        world.run_for(PAUSE);
        let (_, answer) = world.run_until(master_asks(&mut master, &READ));
        assert_eq!(answer, Answer::Pdu(OLD.to_vec()), "{case}");
        let (_, answer) = world.run_until(after(PAUSE, &mut client, &READ));
        assert_eq!(answer, Answer::Pdu(OLD.to_vec()), "{case}");
        assert_eq!((device.counters().all_requests(), rig.counted("C", Event::Cached)), (1, 1), "{case}");
        let (_, answer) = world.run_until(master_asks(&mut master, &WRITE));
        assert_eq!(answer, Answer::Pdu(WRITE.to_vec()), "{case}");
        let (_, answer) = world.run_until(after(PAUSE, &mut client, &READ));
        assert_eq!(answer, Answer::Pdu(NEW.to_vec()), "{case}");
        assert_eq!(counts(rig, "C")[0], 2, "{case}: both were passed on while they arrived");
    });
}

#[test]
fn no_read_is_answered_from_memory_across_a_write_that_is_being_passed_on() {
    shared("cache 10s", |case, world, rig, device| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        for wait_ms in 0..60 {
            device.memory().holding[7] = 0x0507;
            world.run_until(master_asks(&mut master, &[5, 0, 1, 0, 0]));
            let (_, answer) = world.run_until(after(PAUSE, &mut client, &READ));
            assert_eq!(answer, Answer::Pdu(OLD.to_vec()), "{case}");
            let writes = device.writes().len();
            let read = async {
                let (_, answer) = after(Duration::from_millis(wait_ms), &mut client, &READ).await;
                (answer, device.writes().len())
            };
            let ((_, written), (read, by_then)) =
                world.run_until(join(master_asks(&mut master, &WRITE), read));
            assert_eq!(written, Answer::Pdu(WRITE.to_vec()), "{case}");
            let is_old = read == Answer::Pdu(OLD.to_vec());
            assert!(is_old || read == Answer::Pdu(NEW.to_vec()), "{case}: {read:?}");
            assert!(!is_old || by_then == writes, "{case}, {wait_ms} ms: an old value behind the write");
            world.run_for(PAUSE);
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
            let ((asked, ours), (asked_first, one), (asked_second, two)) = world.run_until(join3(
                master_asks(&mut master, &FRESH),
                after(waits[0], &mut first, &FRESH),
                after(waits[1], &mut second, &FRESH),
            ));
            // A response may be 20 ms older than its question, and the device reads before it answers.
            let least = |asked: Instant| asked - Duration::from_millis(20);
            for (answer, asked) in [(ours, asked), (one, asked_first), (two, asked_second)] {
                fresh(case, &answer, least(asked));
            }
            world.run_for(Duration::from_micros(random.within(5_000..=40_000)));
        }
        assert!(counts(rig, "C")[0] > 0, "{case}");
        assert!(device.counters().all_requests() > 150, "{case}");
    });
}
