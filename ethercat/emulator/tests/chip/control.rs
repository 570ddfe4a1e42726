//! AL control as a mailbox, and the process data watchdog.

use embassy_time::{Duration, Timer};
use ethercat_esc::{Command, DirectPdi, Interrupt, Segment, now};
use ethercat_subdevice::esc::Esc;

use embedded_hal_async::digital::Wait;

use ethercat_esc::samples::OUTPUTS;

use crate::{in_line, processor_reads, set_up};

#[test]
fn statement_01_after_power_on_the_state_is_init_without_the_processors_help() {
    let (_world, mut segment) = in_line(1);
    assert_eq!(segment.fetch(0, 0x0130, 6).unwrap(), [1, 0, 0, 0, 0, 0]);
    assert_eq!(segment.fetch(0, 0x0110, 2).unwrap(), [0x13, 0x56], "configured, PDI alive, one link");
}

#[test]
fn statement_19_a_second_request_is_refused_until_the_first_was_read() {
    let (_world, mut segment) = in_line(1);
    assert_eq!(segment.poke(0, 0x0120, &[0x02, 0x00]), 1);
    assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 1, 1);
    assert_eq!(segment.poke(0, 0x0120, &[0x11, 0x00]), 0);
    assert_eq!(processor_reads(&segment, 0x0120, 2), [0x02, 0x00]);
    assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 1, 0);
    assert_eq!(segment.poke(0, 0x0120, &[0x11, 0x00]), 1);
}

#[test]
fn the_interrupt_line_follows_the_masked_events() {
    let (mut world, mut segment) = in_line(1);
    let mut pdi = DirectPdi::new(segment.chip(0));
    let mut line = Interrupt::new(segment.chip(0));
    let woken = world.spawn(async move {
        pdi.write(0x0204, &[1, 0, 0, 0]).await.unwrap();
        line.wait_for_high().await.unwrap();
        let events = pdi.events().await.unwrap();
        pdi.read(0x0120, &mut [0; 2]).await.unwrap();
        line.wait_for_low().await.unwrap();
        (events, now())
    });
    let (events, at) = world.run_until(async {
        Timer::after_micros(250).await;
        assert!(!woken.is_finished());
        segment.poke(0, 0x0120, &[2, 0]);
        woken.await
    });
    assert_eq!((events & 1, at), (1, 250_000));
}

/// Outputs every millisecond, and how the watchdog fares.
fn watchdog_after(quiet: Duration, prepare: impl FnOnce(&mut Segment)) -> (u8, u8, u8) {
    let (mut world, mut segment) = set_up();
    prepare(&mut segment);
    world.run_until(async {
        for _ in 0..200 {
            assert_eq!(segment.poke(0, OUTPUTS, &[1; 120]), 1);
            Timer::after_millis(1).await;
        }
        assert_eq!(processor_reads(&segment, 0x0440, 1), [1], "fed in time");
        Timer::after(quiet).await;
        let event = processor_reads(&segment, 0x0220, 1)[0] & 0x40;
        (segment.fetch(0, 0x0440, 1).unwrap()[0], segment.fetch(0, 0x0442, 1).unwrap()[0], event)
    })
}

#[test]
fn the_watchdog_expires_after_its_time_without_outputs() {
    assert_eq!(watchdog_after(Duration::from_millis(98), |_| {}), (1, 0, 0));
    assert_eq!(watchdog_after(Duration::from_millis(100), |_| {}), (0, 1, 0x40));
}

#[test]
fn statement_14_a_watchdog_of_zero_never_expires_and_the_divider_is_honoured() {
    let off = |segment: &mut Segment| assert_eq!(segment.poke(0, 0x0420, &[0, 0]), 1);
    assert_eq!(watchdog_after(Duration::from_secs(100), off), (1, 0, 0));
    let ten_times_slower = |segment: &mut Segment| {
        assert_eq!(segment.poke(0, 0x0400, &24_998u16.to_le_bytes()), 1);
    };
    assert_eq!(watchdog_after(Duration::from_millis(900), ten_times_slower), (1, 0, 0));
    assert_eq!(watchdog_after(Duration::from_millis(1_000), ten_times_slower), (0, 1, 0x40));
}

#[test]
fn statement_44_only_complete_writes_feed_the_watchdog() {
    let (mut world, mut segment) = set_up();
    world.run_until(async {
        segment.poke(0, OUTPUTS, &[1; 120]);
        for _ in 0..110 {
            Timer::after_millis(1).await;
            segment.send_logical(Command::Lrd, 0, &[0; 240]);
            segment.poke(0, OUTPUTS, &[1; 119]);
        }
        assert_eq!(segment.fetch(0, 0x0440, 1), Some(vec![0]));
        assert_eq!(processor_reads(&segment, 0x0440, 1), [0]);
        assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 0x40, 0, "the event ends when it was seen");
        segment.poke(0, OUTPUTS, &[1; 120]);
        assert_eq!(segment.fetch(0, 0x0440, 1), Some(vec![1]), "and it runs again");
    });
}

#[test]
fn both_sides_can_reset_the_chip() {
    let (_world, mut segment) = set_up();
    for byte in *b"RES" {
        assert_eq!(segment.poke(0, 0x0040, &[byte]), 1);
    }
    assert_eq!(segment.fetch(0, 0x0010, 2), Some(vec![0, 0]));
    segment.poke(0, 0x0010, &[1, 0]);
    for byte in *b"RES" {
        segment.chip(0).borrow_mut().write(0, 0x0041, &[byte]);
    }
    assert_eq!(segment.fetch(0, 0x0010, 2), Some(vec![0, 0]));
    assert_eq!(segment.fetch(0, 0x0012, 2), Some(vec![0x00, 0x0A]), "the alias comes from the EEPROM");
}
