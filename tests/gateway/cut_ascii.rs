//! What only ASCII frames can do while they are passed on: begin anew, and pause.

use embassy_futures::join::join;
use embassy_time::{Duration, Instant, Timer};
use mobgate::settings::Framing;
use mobgate_simulator::client::Answer;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::{Size, machine};
use mobgate_simulator::{Device, Fault, Faults, framing, rig};

use super::cut_pairs::{SPEEDS, VALUE, is_well};
use super::cut_through::{READ, between, counts};

#[test]
fn an_ascii_request_that_begins_anew_is_passed_on_only_from_its_new_beginning() {
    for (down, speed) in
        [Framing::Rtu, Framing::Ascii].into_iter().flat_map(|down| SPEEDS.map(|speed| (down, speed)))
    {
        between((Framing::Ascii, speed.0), (down, speed.1), "", |world, rig, devices| {
            let frame = framing::frame(Framing::Ascii, 105, &READ);
            let mut master = rig.master("up");
            for length in 1..frame.len() {
                world.run_until(master.send_bytes(&frame[..length]));
                is_well("", world, &mut master);
                world.run_for(Duration::from_millis(50));
            }
            assert_eq!(devices[0].counters().all_requests(), frame.len() as u64 - 1);
        });
    }
}

#[test]
fn a_frame_that_begins_anew_in_the_middle_of_a_read_is_not_mixed_with_the_one_before() {
    for down in [Framing::Rtu, Framing::Ascii] {
        let settings = format!(
            "port S serial up ascii server 9600 7E1\nport C serial down {down} client 9600 {}\n\
             route S 105 * -100 C cut on\n",
            if down == Framing::Rtu { "8E1" } else { "7E1" }
        );
        let size = Size { late_reads: Duration::from_millis(3), ..Size::default() };
        rig::with_gateway_of(size, 1, &settings, |world, rig| {
            rig.attach(world, "down", [Device::new(5)]);
            let mut master = rig.master("up");
            let other = framing::frame(Framing::Ascii, 105, &[3, 0, 9, 0, 1]);
            for length in 1..other.len() {
                // At any moment before the next read.
                world.run_for(Duration::from_micros(50_000 + 190 * length as u64));
                let both = [&other[..length], &framing::frame(Framing::Ascii, 105, &READ)].concat();
                world.run_until(master.send_bytes(&both));
                let heard = world.run_until(master.receive()).expect("an answer");
                let answer = framing::open(Framing::Ascii, &heard.bytes);
                assert_eq!(answer, Some((105, VALUE.to_vec())), "{down}, {length}");
            }
            assert!(counts(rig, "C")[2] > 0, "{down}: the ones before were begun");
        });
    }
}

#[test]
fn an_ascii_master_may_pause_inside_its_frames() {
    for (down, speed) in
        [Framing::Rtu, Framing::Ascii].into_iter().flat_map(|down| SPEEDS.map(|speed| (down, speed)))
    {
        between((Framing::Ascii, speed.0), (down, speed.1), "", |world, rig, devices| {
            let frame = framing::frame(Framing::Ascii, 105, &READ);
            let mut master = rig.master("up");
            for at in 1..frame.len() {
                world.run_until(async {
                    master.send_bytes(&frame[..at]).await;
                    Timer::after_millis(300).await;
                });
                world.run_until(master.send_bytes(&frame[at..]));
                let heard = world.run_until(master.receive()).expect("an answer");
                let answer = framing::open(Framing::Ascii, &heard.bytes);
                assert_eq!(answer, Some((105, VALUE.to_vec())), "{speed:?} to {down}, pause at {at}");
            }
            assert_eq!(devices[0].counters().all_requests(), frame.len() as u64 - 1);
            // Begun once; after that its pauses are known, and again when a frame had none.
            assert!(counts(rig, "C")[2] <= 1, "{down}: {:?}", counts(rig, "C"));
            let before = counts(rig, "C")[0];
            for _ in 0..2 {
                is_well("", world, &mut master);
            }
            assert_eq!(counts(rig, "C")[0], before + 1);
        });
    }
}

#[test]
fn a_master_that_pauses_inside_its_frames_keeps_nobody_else_from_the_line() {
    for down in [Framing::Rtu, Framing::Ascii] {
        between((Framing::Ascii, 9_600), (down, 19_200), "", |world, rig, _| {
            let frame = framing::frame(Framing::Ascii, 105, &READ);
            let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
            let slow = async {
                for character in frame.chunks(1) {
                    master.send_bytes(character).await;
                    Timer::after_millis(500).await;
                }
                master.receive().await.expect("an answer")
            };
            let others = async {
                for _ in 0..20 {
                    Timer::after_millis(310).await;
                    let asked = Instant::now();
                    assert_eq!(client.request(6, &READ).await, Answer::Pdu(vec![3, 2, 6, 7]));
                    assert!(asked.elapsed() < Duration::from_millis(100), "{down}: {:?}", asked.elapsed());
                }
            };
            let (heard, ()) = world.run_until(join(slow, others));
            assert_eq!(framing::open(Framing::Ascii, &heard.bytes), Some((105, VALUE.to_vec())));
        });
    }
}

#[test]
fn an_ascii_device_that_pauses_inside_its_answers_is_answered_for_all_but_once() {
    let pause = Faults::new(1).with(When::Always, Fault::GapInside(Duration::from_millis(50)));
    for (up, speed) in
        [Framing::Rtu, Framing::Ascii].into_iter().flat_map(|up| SPEEDS.map(|speed| (up, speed)))
    {
        between((up, speed.0), (Framing::Ascii, speed.1), "", |world, rig, devices| {
            devices[0].set_faults(pause.clone());
            let mut master = rig.master("up");
            world.run_until(master.request(105, &READ));
            world.run_for(Duration::from_millis(200));
            for _ in 0..5 {
                is_well("", world, &mut master);
                world.run_for(Duration::from_millis(50));
            }
            assert_eq!(counts(rig, "S")[1], 5, "{up} {speed:?}: {:?}", counts(rig, "S"));
        });
    }
}

#[test]
fn what_is_read_together_with_the_end_of_its_frame_is_passed_on_as_well() {
    for (up, down) in
        [(Framing::Ascii, Framing::Rtu), (Framing::Ascii, Framing::Ascii), (Framing::Rtu, Framing::Ascii)]
    {
        let format = |framing| if framing == Framing::Rtu { "8E1" } else { "7E1" };
        let settings = format!(
            "port S serial up {up} server 19200 {}\nport C serial down {down} client 19200 {}\n\
             route S 105 * -100 C cut on\n",
            format(up),
            format(down)
        );
        // More characters than LRC, carriage return and line feed.
        let size = Size { late_reads: Duration::from_millis(5), ..Size::default() };
        rig::with_gateway_of(size, 1, &settings, |world, rig| {
            rig.attach(world, "down", [Device::new(5)]);
            let mut master = rig.master("up");
            for nth in 0..40 {
                world.run_for(Duration::from_micros(130 * nth));
                is_well(&format!("{up} to {down}, {nth}"), world, &mut master);
            }
            let (down_cut, up_cut) = (counts(rig, "C")[0], counts(rig, "S")[0]);
            assert!(down_cut + up_cut > 20, "{up} to {down}: {down_cut}, {up_cut}");
        });
    }
}
