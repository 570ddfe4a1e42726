//! Several chips: links, times, what happens to frames on their way, and a ring with a cut cable.

use embassy_time::Timer;
use embedded_hal_async::digital::Wait;
use ethercat_esc::frame::Builder;
use ethercat_esc::{Command, DirectPdi, Fate, Interrupt, Segment, now};
use ethercat_subdevice::esc::Esc;

use crate::in_line;

const USER: u16 = 0x0F80;

fn link(segment: &mut Segment, nth: u16) -> u16 {
    u16::from_le_bytes(segment.fetch(nth, 0x0110, 2).unwrap().try_into().unwrap()) & !0x0002
}

#[test]
fn each_chip_tells_which_ports_have_a_neighbour() {
    let (_world, mut segment) = in_line(3);
    assert_eq!([0, 1, 2].map(|nth| link(&mut segment, nth)), [0x5A31, 0x5A31, 0x5611]);
}

#[test]
fn a_lost_frame_has_reached_those_before_the_break() {
    let (_world, mut segment) = in_line(3);
    let mut frame = Builder::default().device(Command::Bwr, 0, USER, &[9]).build();
    assert!(!segment.pass(0, &mut frame, Fate::Lost(2)));
    assert_eq!([0, 1, 2].map(|nth| segment.fetch(nth, USER, 1).unwrap()[0]), [9, 9, 0]);
}

#[test]
fn a_corrupt_frame_is_believed_by_those_before_the_fault_only() {
    let (_world, mut segment) = in_line(3);
    let mut frame = Builder::default().device(Command::Bwr, 0, USER, &[9]).build();
    assert!(!segment.pass(0, &mut frame, Fate::Corrupt(1)));
    assert_eq!([0, 1, 2].map(|nth| segment.fetch(nth, USER, 1).unwrap()[0]), [9, 0, 0]);
    assert_eq!([0, 1, 2].map(|nth| segment.fetch(nth, 0x0300, 1).unwrap()[0]), [0, 1, 1]);
    assert_eq!(segment.poke(1, 0x0300, &[0]), 1);
    assert_eq!(segment.fetch(1, 0x0300, 1), Some(vec![0]));
}

#[test]
fn aliases_address_devices_when_that_is_switched_on() {
    let (_world, mut segment) = in_line(3);
    let alias = 0x0A01;
    assert_eq!(segment.send(Command::Fprd, alias, 0x0010, &[0; 2]).counter, 0);
    assert_eq!(segment.poke(1, 0x0103, &[1]), 1);
    assert_eq!(segment.send(Command::Fprd, alias, 0x0010, &[0; 2]).data, [0x02, 0x10]);
}

#[test]
fn the_receive_times_of_the_ports_tell_the_length_of_the_line() {
    let (mut world, mut segment) = in_line(3);
    world.run_until(Timer::after_millis(1));
    assert_eq!(segment.send(Command::Bwr, 0, 0x0900, &[0; 4]).counter, 3);
    let mut times = |nth| {
        let bytes = segment.fetch(nth, 0x0900, 8).unwrap();
        let time = |at| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        (time(0), time(4))
    };
    let [first, second, last] = [0, 1, 2].map(&mut times);
    assert_eq!(first.0, 1_000_000);
    assert_eq!(first.1 - first.0, 2_000);
    assert_eq!(second.1 - second.0, 1_000);
    assert_eq!(last.1, 0, "nothing behind it");
}

#[test]
fn clocks_are_brought_together_by_the_references_time() {
    let (mut world, mut segment) = in_line(2);
    segment.chip(1).borrow_mut().set_clock(1_000_000, 50);
    let difference = world.run_until(async {
        for _ in 0..100 {
            let response = segment.send(Command::Frmw, 0x1001, 0x0910, &[0; 8]);
            assert_eq!(response.counter, 2);
            assert_eq!(response.data, now().to_le_bytes());
            Timer::after_millis(1).await;
        }
        u32::from_le_bytes(segment.fetch(1, 0x092C, 4).unwrap().try_into().unwrap()) & 0x7FFF_FFFF
    });
    assert!(difference < 2_000, "{difference} ns");
}

#[test]
fn sync0_comes_from_its_start_time_on_in_its_cycle() {
    let (mut world, mut segment) = in_line(1);
    let pulses = |segment: &Segment| {
        segment.chip(0).borrow_mut().advance(now());
        segment.chip(0).borrow().sync0_pulses()
    };
    let start = |segment: &mut Segment, at: u64| {
        assert_eq!(segment.poke(0, 0x0981, &[0]), 1);
        assert_eq!(segment.poke(0, 0x0990, &at.to_le_bytes()), 1);
        assert_eq!(segment.poke(0, 0x09A0, &250_000u32.to_le_bytes()), 1);
        assert_eq!(segment.poke(0, 0x0981, &[3]), 1);
    };
    world.run_until(async {
        start(&mut segment, 1_000_000);
        Timer::after_micros(999).await;
        assert_eq!(pulses(&segment), 0);
        Timer::after_micros(1).await;
        assert_eq!(pulses(&segment), 1);
        Timer::after_micros(1_000).await;
        assert_eq!(pulses(&segment), 5);
        start(&mut segment, 1_500_000);
        Timer::after_millis(10).await;
        assert_eq!(pulses(&segment), 0, "a start time in the past gives no pulse");
    });
}

#[test]
fn sync0_asks_for_the_processor_without_jitter_until_it_is_acknowledged() {
    let (mut world, mut segment) = in_line(1);
    segment.poke(0, 0x0990, &500_000u64.to_le_bytes());
    segment.poke(0, 0x09A0, &250_000u32.to_le_bytes());
    segment.poke(0, 0x0981, &[3]);
    let mut pdi = DirectPdi::new(segment.chip(0));
    let mut pin = Interrupt::new(segment.chip(0));
    let times = world.run_until(async {
        pdi.write(0x0204, &[4, 0, 0, 0]).await.unwrap();
        let mut times = Vec::new();
        for _ in 0..4 {
            pin.wait_for_high().await.unwrap();
            times.push(now());
            pdi.read(0x098E, &mut [0]).await.unwrap();
        }
        times
    });
    assert_eq!(times, [500_000, 750_000, 1_000_000, 1_250_000]);
}

#[test]
fn a_cut_ring_is_reached_from_both_ends() {
    let (_world, mut segment) = in_line(4);
    segment.close_ring();
    assert_eq!(link(&mut segment, 3), 0x5A31);
    let read = || Builder::default().device(Command::Brd, 0, 0x0000, &[0]).build();
    let counter = |frame: &[u8]| frame[27];
    let (mut front, mut back) = (read(), read());
    assert!(segment.pass(0, &mut front, Fate::Intact) && segment.pass_back(0, &mut back, Fate::Intact));
    assert_eq!((counter(&front), counter(&back)), (4, 0), "whole: the second way changes nothing");
    segment.cut(1);
    let (mut front, mut back) = (read(), read());
    assert!(segment.pass(0, &mut front, Fate::Intact) && segment.pass_back(0, &mut back, Fate::Intact));
    assert_eq!((counter(&front), counter(&back)), (1, 3));
    assert_eq!((front[23] & 0x40, back[23] & 0x40), (0, 0x40), "it has passed a closed port 0");
    assert!(!segment.pass_back(0, &mut back, Fate::Intact), "and does not pass it twice");
}
