//! Answers that are passed on while they arrive, where something else comes before them, or they are none.

use embassy_futures::join::{join, join3};
use embassy_time::{Duration, Timer};
use mobgate::settings::Framing;
use mobgate::stats::Outcome;
use mobgate_simulator::client::Answer;
use mobgate_simulator::device::rtu;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::{Size, machine};
use mobgate_simulator::{Device, Fault, Faults, Master, Rig, World, framing, rig};

use super::cut_pairs::{VALUE, is_well};
use super::cut_through::{READ, between, counts};

const EVEN: (u32, u32) = (19_200, 19_200);
/// Silence between two frames of a unit.
const PAUSE: Duration = Duration::from_millis(10);

/// A unit on the line below that answers the next request by these `frames`.
async fn answers(unit: &mut Master, frames: &[Vec<u8>]) {
    unit.receive().await.expect("a request");
    for frame in frames {
        unit.send_bytes(frame).await;
        Timer::after(PAUSE).await;
    }
}

/// What a master hears that asks unit 7, which answers by `frames`.
fn asked(speeds: (u32, u32), frames: &[Vec<u8>], check: impl for<'w> FnOnce(&Rig<'w>, Option<Vec<u8>>)) {
    between((Framing::Rtu, speeds.0), (Framing::Rtu, speeds.1), "", |world, rig, _| {
        let (mut master, mut unit) = (rig.master("up"), rig.master("down"));
        let asks = async {
            master.send(107, &READ).await;
            master.receive().await.map(|heard| heard.bytes)
        };
        let (heard, ()) = world.run_until(join(asks, answers(&mut unit, frames)));
        world.run_for(Duration::from_millis(200));
        check(rig, heard);
    });
}

/// Frames that the gateway has sent to the master.
fn sent_up(rig: &Rig<'_>) -> usize {
    let end = rig.end("up").number();
    rig.wire("up").frames().iter().filter(|frame| frame.from == end).count()
}

#[test]
fn an_answer_is_passed_on_while_it_arrives_though_another_units_frame_came_before_it() {
    asked(EVEN, &[rtu::frame(6, &VALUE), rtu::frame(7, &VALUE)], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &VALUE)));
        assert_eq!(counts(rig, "S"), [1, 0, 0]);
    });
}

#[test]
fn nothing_follows_an_answer_that_was_begun_and_proved_to_be_none() {
    asked(EVEN, &[rtu::frame(7, &[3, 4, 1, 2, 3, 4]), rtu::frame(7, &VALUE)], |rig, heard| {
        // The board relays as much as a good response has, but for the last character.
        assert!(heard.is_some_and(|heard| heard.len() < rtu::frame(107, &VALUE).len()));
        assert_eq!((counts(rig, "S"), sent_up(rig)), ([1, 0, 1], 1));
        let entry = rig.gateway.log().newest(0).expect("an entry");
        assert_eq!(entry.outcome, Outcome::Silence, "the master has got no answer");
    });
}

#[test]
fn an_exception_that_may_be_to_something_else_is_broken_off_and_not_mixed_with_the_answer() {
    // What nobody asked for is one byte short, and an exception might be to that as well.
    let frames = [rtu::frame(7, &[3, 0]), rtu::frame(7, &[0x83, 2]), rtu::frame(7, &VALUE)];
    asked((115_200, 9_600), &frames, |rig, heard| {
        let exception = rtu::frame(107, &[0x83, 2]);
        assert_eq!(heard.as_deref(), Some(&exception[..4]), "all but the last character");
        assert_eq!((counts(rig, "S"), sent_up(rig)), ([1, 0, 1], 1));
    });
}

#[test]
fn an_answer_with_a_wrong_byte_count_is_not_begun_where_there_is_time_to_see_that() {
    asked((115_200, 9_600), &[rtu::frame(7, &[3, 4, 1, 2, 3, 4])], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &[0x83, 0x0b])));
        assert_eq!(counts(rig, "S")[0], 0);
    });
}

#[test]
fn noise_longer_than_any_frame_is_not_begun_though_an_answer_may_seem_to_begin_in_it() {
    // What is kept of it when it is too long begins with the unit.
    let noise: Vec<u8> = [7, 3, 2, 0].into_iter().cycle().take(300).collect();
    asked(EVEN, &[[&[6][..], &noise[1..]].concat()], |rig, heard| {
        assert_eq!(heard, Some(rtu::frame(107, &[0x83, 0x0b])));
        assert_eq!(counts(rig, "S")[0], 0);
    });
}

#[test]
fn the_beginning_of_what_proves_to_be_no_answer_is_broken_off_before_its_end() {
    between((Framing::Ascii, 19_200), (Framing::Rtu, 19_200), "", |world, rig, devices| {
        devices[0].set_faults(Faults::new(1).with(When::Always, Fault::WrongEcho));
        world.run_until(rig.master("up").send(105, &[3, 0, 0, 0, 100]));
        // It takes 118 ms.
        world.run_for(Duration::from_millis(50));
        assert_eq!(counts(rig, "S"), [1, 0, 1]);
    });
}

#[test]
fn who_shares_an_answer_that_began_wrongly_is_given_no_part_of_it() {
    between((Framing::Ascii, 19_200), (Framing::Rtu, 19_200), "", |world, rig, _| {
        let (mut master, mut unit) = (rig.master("up"), rig.master("down"));
        let (mut busy, mut client) = (rig.client(machine(1), 502), rig.client(machine(2), 502));
        // The next request of a master that pauses is passed on when it is whole, as one that can share a response.
        let frame = framing::frame(Framing::Ascii, 106, &READ);
        world.run_until(master.send_bytes(&frame[..9]));
        world.run_for(Duration::from_millis(300));
        world.run_until(master.send_bytes(&frame[9..]));
        world.run_until(master.receive()).expect("an answer");
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
        let (_, answer, ()) = world.run_until(join3(asks, shares, unit));
        assert_eq!(answer, Answer::Pdu(vec![0x83, 0x0b]), "and no part of what the master has heard");
        let [cut, _, aborted] = counts(rig, "S");
        assert_eq!(
            (cut, aborted),
            (begun[0] + 1, begun[2] + 1),
            "the master heard the beginning of the first one"
        );
    });
}

#[test]
fn an_answer_that_pauses_where_ascii_may_pause_is_passed_on_to_its_end() {
    between((Framing::Ascii, 19_200), (Framing::Rtu, 9_600), "", |world, rig, devices| {
        let pause = Fault::GapInside(Duration::from_micros(2_500));
        devices[0].set_faults(Faults::new(1).with(When::Always, pause));
        is_well("", world, &mut rig.master("up"));
        assert_eq!(counts(rig, "S"), [1, 0, 0]);
    });
}

#[test]
fn an_answer_behind_what_looked_like_its_beginning_is_not_mixed_with_that() {
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
            let (heard, ()) = world.run_until(join(asks, answers(&mut unit, &frames)));
            let taken = heard.and_then(|heard| framing::open(Framing::Ascii, &heard.bytes));
            let is_good = taken.as_ref().is_none_or(|taken| *taken == (107, write.to_vec()));
            assert!(is_good, "{nth}: {taken:02x?}");
        }
        let [cut, _, aborted] = counts(rig, "S");
        assert!(cut > 0 && aborted == cut, "{cut} were begun, and {aborted} of them broken off");
    });
}

#[test]
fn stray_characters_behind_a_request_do_not_spoil_the_one_behind_its_answer() {
    let settings = "port S serial up rtu server 19200 char-timeout 20ms\nport C serial down rtu client 19200\n\
         route S * * * C cut on\n";
    rig::with_gateway(1, settings, |world, rig| {
        rig.attach(world, "down", [Device::new(5)]);
        world.run_for(Duration::from_secs(1));
        let mut master = rig.master("up");
        world.run_until(master.send_bytes(&[&rtu::frame(5, &READ)[..], &[0xff]].concat()));
        let good = Some(rtu::frame(5, &VALUE));
        assert_eq!(world.run_until(master.receive()).map(|heard| heard.bytes), good);
        world.run_for(Duration::from_millis(5));
        assert_eq!(world.run_until(master.request(5, &READ)), Answer::Pdu(VALUE.to_vec()));
    });
}

#[test]
fn a_board_sleeps_while_an_answer_gathers_unless_it_is_passed_on_meanwhile() {
    let reads = |cut: &str| {
        let settings = format!(
            "port S serial up rtu server 19200\nport C serial down rtu client 9600\nroute S * * * C cut {cut}\n"
        );
        let size = Size { rests: Duration::from_millis(50), ..Size::default() };
        rig::with_gateway_of(size, 1, &settings, |world: &mut World<'_>, rig| {
            rig.attach(world, "down", [Device::new(5)]);
            world.run_for(Duration::from_secs(1));
            let answer = world.run_until(rig.master("up").request(5, &[3, 0, 0, 0, 10]));
            assert!(matches!(answer, Answer::Pdu(_)), "{answer:?}");
            rig.sent("down").reads
        })
    };
    let (stored, passed_on) = (reads("off"), reads("on"));
    assert!(stored <= 4, "{stored} reads of 25 characters");
    assert!(passed_on > stored, "{passed_on} reads");
}
