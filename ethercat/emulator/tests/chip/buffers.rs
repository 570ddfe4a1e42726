//! SyncManagers in buffered mode: three buffers, so that neither side ever waits or sees half of an image.

use embassy_time::{Duration, Timer};
use ethercat_esc::World;
use ethercat_esc::sub_device::Paced;
use ethercat_esc::{Command, DirectPdi, Segment};
use ethercat_subdevice::esc::Esc;

use ethercat_esc::samples::{INPUTS, OUTPUTS, ready};

use crate::{processor_reads, set_up};

const FRAMES: u32 = 100_000;

#[test]
fn the_consumer_gets_the_latest_of_what_was_written_and_the_same_again() {
    let (_world, mut segment) = set_up();
    for image in 1..=5 {
        assert_eq!(segment.poke(0, OUTPUTS, &[image; 120]), 1, "never refused");
    }
    assert_eq!(processor_reads(&segment, OUTPUTS, 120), [5; 120]);
    assert_eq!(processor_reads(&segment, OUTPUTS, 120), [5; 120]);
}

#[test]
fn what_is_being_read_stays_while_new_images_come() {
    let (_world, mut segment) = set_up();
    segment.poke(0, OUTPUTS, &[1; 120]);
    assert_eq!(processor_reads(&segment, OUTPUTS, 60), [1; 60]);
    for image in 2..=9 {
        segment.poke(0, OUTPUTS, &[image; 120]);
    }
    assert_eq!(processor_reads(&segment, OUTPUTS + 60, 60), [1; 60]);
    assert_eq!(processor_reads(&segment, OUTPUTS, 120), [9; 120]);
}

#[test]
fn nothing_can_be_read_before_something_was_written() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.fetch(0, INPUTS, 120), None);
    assert_eq!(segment.fetch(0, 0x081D, 1).unwrap()[0] & 0x30, 0x30);
    segment.chip(0).borrow_mut().write(0, INPUTS, &[1; 120]);
    assert_eq!(segment.fetch(0, INPUTS, 120), Some(vec![1; 120]));
}

#[test]
fn statement_43_inputs_that_nobody_renews_stay_readable() {
    let (mut world, mut segment) = set_up();
    segment.chip(0).borrow_mut().write(0, INPUTS, &[1; 120]);
    for _ in 0..10 {
        world.run_for(Duration::from_secs(1));
        assert_eq!(segment.fetch(0, INPUTS, 120), Some(vec![1; 120]));
    }
}

#[test]
fn the_second_and_third_buffer_are_nobodys() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, OUTPUTS + 120, &[1]), 0);
    assert_eq!(segment.poke(0, OUTPUTS + 359, &[1]), 0);
    assert_eq!(segment.poke(0, OUTPUTS + 360, &[1]), 1);
}

#[test]
fn events_tell_of_new_outputs_and_of_fetched_inputs() {
    let (_world, mut segment) = set_up();
    let events = |segment: &Segment| processor_reads(segment, 0x0221, 1)[0];
    segment.poke(0, OUTPUTS, &[1; 120]);
    assert_eq!(events(&segment), 0b0100);
    processor_reads(&segment, OUTPUTS, 1);
    assert_eq!(events(&segment), 0);
    segment.chip(0).borrow_mut().write(0, INPUTS, &[1; 120]);
    segment.fetch(0, INPUTS, 120);
    assert_eq!(events(&segment), 0b1000);
}

#[test]
fn the_interrupt_field_of_a_frame_tells_masked_events() {
    let (_world, mut segment) = set_up();
    segment.poke(0, 0x0200, &[0x08, 0x00]);
    assert_eq!(segment.send(Command::Brd, 0, 0, &[0]).interrupts, 0);
    segment.chip(0).borrow_mut().write(0, 0x0130, &[2, 0]);
    assert_eq!(segment.send(Command::Brd, 0, 0, &[0]).interrupts, 0x08, "AL status has changed");
    segment.fetch(0, 0x0130, 2);
    assert_eq!(segment.send(Command::Brd, 0, 0, &[0]).interrupts, 0, "and was read");
}

/// An image whose every double word tells its number.
fn image(number: u32) -> Vec<u8> {
    number.to_le_bytes().repeat(30)
}

/// The number of an image, unless its parts are of different ones.
fn number_of(image: &[u8]) -> Option<u32> {
    let mut numbers = image.chunks(4).map(|part| u32::from_le_bytes(part.try_into().unwrap()));
    let first = numbers.next()?;
    numbers.all(|number| number == first).then_some(first)
}

#[test]
fn statement_42_both_sides_see_whole_images_only_in_any_timing() {
    let mut world = World::new(42);
    let mut segment = ready();
    let pdi = || DirectPdi::new(segment.chip(0));
    let mut outputs = Paced::new(pdi(), world.random(), 0..=15);
    let mut inputs = Paced::new(pdi(), world.random(), 0..=15);
    let mut pauses = world.random();
    segment.send_logical(Command::Lwr, 0, &image(0));
    segment.chip(0).borrow_mut().write(0, INPUTS, &image(0));
    let reads = world.spawn(async move {
        let (mut seen, mut distinct) = (0, 0_u32);
        while seen < FRAMES - 1 {
            let mut into = [0; 120];
            outputs.read(OUTPUTS, &mut into).await.unwrap();
            let number = number_of(&into).expect("one image");
            assert!(number >= seen, "never back to an older one");
            distinct += u32::from(number > seen);
            seen = number;
        }
        distinct
    });
    world.spawn(async move {
        for number in 1.. {
            inputs.write(INPUTS, &image(number)).await.unwrap();
        }
    });
    let fetched = world.run_until(async {
        let mut seen = 0;
        for number in 0..FRAMES {
            let sent = [image(number), image(u32::MAX)].concat();
            let response = segment.send_logical(Command::Lrw, 0, &sent);
            assert_eq!(response.counter, 3);
            let fetched = number_of(&response.data[120..]).expect("one image");
            assert!(fetched >= seen && fetched != u32::MAX, "never back to an older one");
            seen = fetched;
            Timer::after_micros(pauses.within(1..=60)).await;
        }
        seen
    });
    world.run_for(Duration::from_millis(10));
    assert!(fetched > 1_000, "the processor wrote meanwhile");
    let distinct = world.run_until(reads);
    assert!(distinct > 1_000, "and read");
}
