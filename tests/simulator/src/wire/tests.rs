//! The wire's timing, and what its ends hear.

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use mobgate::hal::Relay;
use mobgate::settings::{Framing, LineSettings, Parity};

use super::{Heard, LineEnd, Silence, Wire};
use crate::World;

const LINE_9600: LineSettings = LineSettings { baud: 9_600, ..LineSettings::DEFAULT };

/// A wire of 9600 baud, and two ends on it.
fn pair() -> (Wire, LineEnd, LineEnd) {
    let wire = Wire::new();
    let (one, other) = (wire.tap(LINE_9600), wire.tap(LINE_9600));
    (wire, one, other)
}

async fn send(end: &mut LineEnd, bytes: &[u8]) {
    end.write_all(bytes).await.unwrap();
    end.flush().await.unwrap();
}

async fn read_some(end: &mut LineEnd) -> (Vec<u8>, u64) {
    let mut buffer = [0; 300];
    let count = end.read(&mut buffer).await.unwrap();
    (buffer[..count].to_vec(), Instant::now().as_micros())
}

#[test]
fn a_byte_at_9600_8e1_is_heard_after_eleven_bits() {
    let mut world = World::new(1);
    let (_, mut one, mut other) = pair();
    let heard = world.run_until(async {
        one.write_all(&[0x55]).await.unwrap();
        read_some(&mut other).await
    });
    // 11 / 9600 s = 1145.83 us
    assert_eq!(heard, (vec![0x55], 1_146));
}

#[test]
fn a_long_run_does_not_gather_rounding() {
    let mut world = World::new(1);
    let (_, mut one, _) = pair();
    world.run_until(async {
        one.write_all(&[0; 96]).await.unwrap();
        one.flush().await.unwrap();
    });
    // 96 x 11 / 9600 s = 110 ms exactly.
    assert_eq!(Instant::now().as_micros(), 110_000);
}

#[test]
fn a_read_gives_the_bytes_that_have_arrived_and_no_more() {
    let mut world = World::new(1);
    let (_, mut one, mut other) = pair();
    let heard = world.run_until(async {
        one.write_all(&[1, 2, 3, 4]).await.unwrap();
        Timer::at(Instant::from_micros(2_400)).await;
        (read_some(&mut other).await, read_some(&mut other).await)
    });
    assert_eq!(heard, ((vec![1, 2], 2_400), (vec![3], 3_438)));
}

#[test]
fn bytes_written_while_sending_follow_without_a_gap() {
    let mut world = World::new(1);
    let (wire, mut one, _other) = pair();
    world.run_until(async {
        one.write_all(&[1, 2]).await.unwrap();
        Timer::after_micros(2_000).await;
        send(&mut one, &[3]).await;
    });
    assert_eq!(wire.frames().len(), 1);
    assert_eq!(wire.frames()[0].end_ns, 3_437_500);
}

#[test]
fn nobody_hears_himself_unless_he_asks() {
    let mut world = World::new(1);
    let (_, mut one, _) = pair();
    one.set_echo(true);
    let mut silent = one.clone();
    let heard = world.run_until(async {
        one.write_all(&[9]).await.unwrap();
        let echoed = read_some(&mut one).await.0;
        silent.set_echo(false);
        silent.write_all(&[8]).await.unwrap();
        let nothing = embassy_time::with_timeout(Duration::from_secs(1), read_some(&mut silent)).await;
        (echoed, nothing.is_err())
    });
    assert_eq!(heard, (vec![9], true));
}

#[test]
fn two_ends_that_send_at_once_corrupt_each_other() {
    let mut world = World::new(1);
    let (wire, mut one, mut other) = pair();
    let mut third = wire.tap(LINE_9600);
    let heard = world.run_until(async {
        one.write_all(&[1, 2, 3]).await.unwrap();
        Timer::after_micros(1_500).await;
        other.write_all(&[4]).await.unwrap();
        Timer::after_millis(10).await;
        (read_some(&mut third).await.0, read_some(&mut one).await.0)
    });
    // The first byte had left; the second and third met the other's only byte.
    let (third, one) = heard;
    assert_eq!((third.len(), third[0]), (4, 1));
    assert!(third[1] != 2 && third[2] != 4 && third[3] != 3, "{third:?}");
    assert!(one.len() == 1 && one[0] != 4, "{one:?}");
    assert_eq!(wire.collisions(), 3);
}

#[test]
fn an_end_of_another_speed_or_parity_hears_garbage() {
    let mut world = World::new(1);
    let (wire, mut one, _) = pair();
    let mut fast = wire.tap(LineSettings { baud: 19_200, ..LINE_9600 });
    let mut odd = wire.tap(LineSettings { parity: Parity::Odd, ..LINE_9600 });
    let (fast, odd) = world.run_until(async {
        send(&mut one, &[1, 2]).await;
        (read_some(&mut fast).await.0, read_some(&mut odd).await.0)
    });
    for heard in [fast, odd] {
        assert!(heard.iter().zip([1, 2]).all(|(&heard, sent)| heard != sent), "{heard:?}");
    }
}

#[test]
fn a_frame_is_over_after_its_silence_and_knows_of_gaps() {
    let mut world = World::new(1);
    let (_, mut one, other) = pair();
    let silence = Silence::of(&LINE_9600);
    let (whole, torn, at) = world.run_until(async {
        one.write_all(&[1, 2]).await.unwrap();
        let whole = other.frame(silence).await;
        let at = Instant::now().as_micros();
        send(&mut one, &[3]).await;
        // More than t1.5 (1718.75 us), less than t3.5.
        Timer::after_micros(2_000).await;
        one.write_all(&[4]).await.unwrap();
        (whole, other.frame(silence).await, at)
    });
    assert_eq!(whole, Heard { bytes: vec![1, 2], gap_inside: false, end_ns: 2_291_667 });
    // 2291.667 us + 3.5 x 1145.833 us
    assert_eq!(at, 6_303);
    assert_eq!((torn.bytes, torn.gap_inside), (vec![3, 4], true));
}

#[test]
fn the_record_tells_frames_gaps_and_time_on_the_wire() {
    let mut world = World::new(1);
    let (wire, one, other) = pair();
    world.run_until(async {
        for (end, pause_us) in [(&one, 5_000), (&other, 4_500), (&one, 100_000)] {
            let mut end = end.clone();
            end.write_all(&[7; 96]).await.unwrap();
            end.flush().await.unwrap();
            Timer::after_micros(pause_us).await;
        }
    });
    let (first, second) = (wire.record_of(&one), wire.record_of(&other));
    assert_eq!((first.frames, second.frames), (2, 1));
    assert_eq!(second.shortest_gap_ns, Some(5_000_000));
    assert_eq!(first.shortest_gap_ns, Some(4_500_000));
    assert_eq!(wire.busy(), Duration::from_millis(330));
}

#[test]
fn an_unplugged_adapter_ends_reads_and_writes_for_good() {
    let mut world = World::new(1);
    let (_, mut one, mut other) = pair();
    world.run_until(async {
        let unplug = async {
            Timer::after_millis(5).await;
            one.unplug();
        };
        let mut reader = one.clone();
        let ((count, _), ()) = embassy_futures::join::join(read_some(&mut reader), unplug).await;
        assert!(count.is_empty());
        assert!(one.write_all(&[1]).await.is_err());
        one.replug();
        assert!(one.write_all(&[1]).await.is_err(), "the old handle stays dead");
        other.write_all(&[1]).await.unwrap();
    });
}

#[test]
fn an_ascii_frame_may_pause_inside_but_the_next_one_must_wait() {
    let mut world = World::new(1);
    let (wire, mut one, _) = pair();
    world.run_until(async {
        for characters in [b":0102", b"F1\r\n:", b"0102\n", b":0304"] {
            send(&mut one, characters).await;
            Timer::after_millis(3).await;
        }
    });
    let hasty = |framing, pause_ms| {
        let (none, pause) = (Duration::from_ticks(0), Duration::from_millis(pause_ms));
        let frames = wire.hasty_frames((&one, framing), none, pause);
        frames.into_iter().map(|frame| frame.bytes).collect::<Vec<_>>()
    };
    assert_eq!(hasty(Framing::Ascii, 1_000), [b":0304"]);
    assert_eq!(hasty(Framing::Ascii, 0).len(), 3, "no pause is allowed");
    assert_eq!(hasty(Framing::Rtu, 1_000).len(), 0, "RTU frames do not show where they begin");
}

#[test]
fn who_is_interrupted_in_a_frame_has_not_begun_a_new_one() {
    let mut world = World::new(1);
    let (wire, mut one, mut other) = pair();
    let mut third = wire.tap(LINE_9600);
    world.run_until(async {
        one.write_all(&[1, 2]).await.unwrap();
        Timer::after_micros(2_000).await;
        other.write_all(&[5, 6, 7]).await.unwrap();
        send(&mut one, &[3, 4]).await;
        // It has heard both of them.
        third.write_all(&[9]).await.unwrap();
    });
    assert!(wire.frames().iter().filter(|frame| frame.from == one.number()).count() > 1);
    let hasty =
        |end| wire.hasty_frames((end, Framing::Rtu), Duration::from_ticks(0), Duration::from_ticks(0));
    assert_eq!(hasty(&one), []);
    assert_eq!(hasty(&third).len(), 1);
}

#[test]
fn a_line_is_relayed_until_what_came_is_read() {
    let mut world = World::new(1);
    let (_, mut device, source) = pair();
    let (_, target, _) = pair();
    let (mut source, mut read) = (source, [0; 8]);
    world.run_until(async {
        source.begin_relay(Relay::new(3, 0), &target);
        device.write_all(&[1, 2, 3]).await.unwrap();
        source.readable(1).await;
        assert!(source.is_relayed(), "nothing of it was read");
        assert_eq!(source.read(&mut read).await.unwrap(), 3);
        assert!(!source.is_relayed());
        source.end_relay();

        source.begin_relay(Relay::new(4, 0), &target);
        device.write_all(&[1, 2]).await.unwrap();
        // Ready when the silence has been longer than t1.5.
        assert_eq!(source.read(&mut read).await.unwrap(), 2);
        assert!(source.silence() > Duration::from_micros(1_718) && !source.is_relayed());
        device.write_all(&[3]).await.unwrap();
        assert_eq!(source.read(&mut read).await.unwrap(), 1);
        assert_eq!(source.silence(), Duration::from_ticks(0), "what came later has ended it");
    });
}
