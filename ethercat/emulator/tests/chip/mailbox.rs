//! SyncManagers in mailbox mode: one buffer that changes hands.

use ethercat_esc::World;
use ethercat_esc::{Command, Fate, Segment, frame::Builder};

use ethercat_esc::samples::{IN_BOX, OUT_BOX, ready};

use crate::{processor_reads, set_up};

const FULL: u8 = 1 << 3;

fn status(segment: &mut Segment, manager: u16) -> u8 {
    segment.fetch(0, 0x0805 + 8 * manager, 1).unwrap()[0]
}

fn processor_writes(segment: &Segment, address: u16, bytes: &[u8]) {
    segment.chip(0).borrow_mut().write(0, address, bytes);
}

fn events(segment: &Segment) -> u32 {
    u32::from_le_bytes(processor_reads(segment, 0x0220, 4).try_into().unwrap())
}

#[test]
fn a_mailbox_is_written_once_and_again_after_it_was_read() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, OUT_BOX, &[1; 128]), 1);
    assert_eq!(status(&mut segment, 0) & FULL, FULL);
    assert_eq!(segment.poke(0, OUT_BOX, &[2; 128]), 0, "full");
    assert_eq!(processor_reads(&segment, OUT_BOX, 128), [1; 128]);
    assert_eq!(status(&mut segment, 0) & FULL, 0);
    assert_eq!(segment.poke(0, OUT_BOX, &[2; 128]), 1);
}

#[test]
fn an_empty_mailbox_gives_nothing_and_a_full_one_gives_once() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.fetch(0, IN_BOX, 128), None);
    processor_writes(&segment, IN_BOX, &[5; 128]);
    assert_eq!(segment.fetch(0, IN_BOX, 128), Some(vec![5; 128]));
    assert_eq!(segment.fetch(0, IN_BOX, 128), None);
}

#[test]
fn a_mailbox_that_was_not_written_to_its_last_byte_stays_open() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, OUT_BOX, &[1; 127]), 1);
    assert_eq!(status(&mut segment, 0) & FULL, 0);
    assert_eq!(events(&segment) & 0x100, 0);
    assert_eq!(segment.poke(0, OUT_BOX + 127, &[1]), 1);
    assert_eq!(status(&mut segment, 0) & FULL, FULL);
    assert_eq!(events(&segment) & 0x100, 0x100);
}

#[test]
fn an_access_begins_with_the_first_byte() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, OUT_BOX + 1, &[1; 127]), 0);
    processor_writes(&segment, IN_BOX + 127, &[5]);
    assert_eq!(status(&mut segment, 1) & FULL, 0);
}

#[test]
fn the_processor_may_skip_what_a_short_message_does_not_need() {
    let (_world, mut segment) = set_up();
    processor_writes(&segment, IN_BOX, &[5; 16]);
    assert_eq!(status(&mut segment, 1) & FULL, 0);
    processor_writes(&segment, IN_BOX + 127, &[0]);
    assert_eq!(segment.fetch(0, IN_BOX, 128).unwrap()[..16], [5; 16]);
    segment.poke(0, OUT_BOX, &[1; 128]);
    processor_reads(&segment, OUT_BOX, 6);
    assert_eq!(status(&mut segment, 0) & FULL, FULL);
    processor_reads(&segment, OUT_BOX + 127, 1);
    assert_eq!(status(&mut segment, 0) & FULL, 0);
}

#[test]
fn the_wrong_direction_is_refused_to_both_sides() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, IN_BOX, &[1; 128]), 0);
    segment.poke(0, OUT_BOX, &[1; 128]);
    assert_eq!(segment.fetch(0, OUT_BOX, 128), None);
    processor_writes(&segment, OUT_BOX, &[2; 128]);
    assert_eq!(processor_reads(&segment, OUT_BOX, 128), [1; 128]);
}

#[test]
fn each_event_ends_with_the_other_sides_first_byte() {
    let (_world, mut segment) = set_up();
    segment.poke(0, OUT_BOX, &[1; 128]);
    assert_eq!(events(&segment) & 0x300, 0x100, "a message has come");
    processor_reads(&segment, OUT_BOX, 1);
    assert_eq!(events(&segment) & 0x300, 0);
    processor_writes(&segment, IN_BOX, &[5; 128]);
    segment.fetch(0, IN_BOX, 128);
    assert_eq!(events(&segment) & 0x300, 0x200, "the response was fetched");
    processor_writes(&segment, IN_BOX, &[5]);
    assert_eq!(events(&segment) & 0x300, 0);
}

#[test]
fn a_corrupt_frame_neither_fills_nor_empties_a_mailbox() {
    let (_world, mut segment) = set_up();
    let mut frame = Builder::default().device(Command::Apwr, 0, OUT_BOX, &[1; 128]).build();
    assert!(!segment.pass(0, &mut frame, Fate::Corrupt(0)));
    assert_eq!(status(&mut segment, 0) & FULL, 0);
    processor_writes(&segment, IN_BOX, &[5; 128]);
    let mut frame = Builder::default().device(Command::Aprd, 0, IN_BOX, &[0; 128]).build();
    assert!(!segment.pass(0, &mut frame, Fate::Corrupt(0)));
    assert_eq!(status(&mut segment, 1) & FULL, FULL);
    assert_eq!(segment.fetch(0, 0x0300, 1), Some(vec![2]), "both were counted");
}

#[test]
fn a_response_that_is_lost_on_the_way_back_is_gone_until_it_is_repeated() {
    let (_world, mut segment) = set_up();
    processor_writes(&segment, IN_BOX, &[5; 128]);
    let mut frame = Builder::default().device(Command::Aprd, 0, IN_BOX, &[0; 128]).build();
    assert!(!segment.pass(0, &mut frame, Fate::Lost(1)));
    assert_eq!(segment.fetch(0, IN_BOX, 128), None);
    // The MainDevice toggles the repeat request, by status and activation in one access as SOEM does.
    processor_reads(&segment, 0x0806, 1);
    processor_reads(&segment, 0x080E, 1);
    processor_reads(&segment, 0x0816, 1);
    processor_reads(&segment, 0x081E, 1);
    assert_eq!(events(&segment) & 0x10, 0);
    assert_eq!(segment.poke(0, 0x080D, &[0, 3]), 1);
    assert_eq!(events(&segment) & 0x10, 0x10);
    assert_eq!(processor_reads(&segment, 0x080E, 1), [3]);
    assert_eq!(events(&segment) & 0x10, 0, "seen");
    // The processor puts the message back and acknowledges.
    processor_writes(&segment, IN_BOX, &[5; 128]);
    processor_writes(&segment, 0x080F, &[2]);
    assert_eq!(segment.fetch(0, 0x080F, 1), Some(vec![2]));
    assert_eq!(segment.fetch(0, IN_BOX, 128), Some(vec![5; 128]));
}

#[test]
fn a_mailbox_that_the_processor_switches_off_is_so_at_the_end_of_a_frame_that_is_under_way() {
    let (_world, mut segment) = set_up();
    processor_writes(&segment, IN_BOX, &[5; 128]);
    // A frame of 60 bytes, with preamble and check sequence, takes 5.76 us.
    assert_eq!(segment.poke(0, 0x0F80, &[1]), 1);
    let at = |nanos, write: Option<u8>| {
        let chip = segment.chip(0);
        let chip = &mut chip.borrow_mut();
        write.into_iter().for_each(|byte| chip.write(nanos, 0x080F, &[byte]));
        let mut control = [0];
        chip.read(nanos, 0x080F, &mut control);
        (control[0], chip.peek::<1>(0x080D)[0] & FULL)
    };
    assert_eq!(at(1_000, Some(1)), (0, FULL), "not yet");
    assert_eq!(at(2_000, Some(0)), (0, FULL));
    assert_eq!(at(6_000, None), (0, FULL), "it was taken back");
    assert_eq!(at(6_000, Some(1)), (1, 0), "no frame is there any more");
    assert_eq!(at(6_000, Some(0)), (0, 0));
}

#[test]
fn a_mailbox_that_either_side_switches_off_is_empty_and_closed_to_the_master_if_the_processor_did() {
    let _world = World::new(1);
    for (address, by_processor) in [(0x0807, true), (0x0806, false)] {
        let mut segment = ready();
        segment.poke(0, OUT_BOX, &[1; 128]);
        if by_processor {
            // No frame is under way.
            segment.chip(0).borrow_mut().write(1_000_000, address, &[1]);
        } else {
            assert_eq!(segment.poke(0, address, &[0]), 1);
        }
        assert_eq!(status(&mut segment, 0), 0x30, "nothing full, nothing written");
        assert_eq!(events(&segment) & 0x100, 0);
        let expected = if by_processor { 0 } else { 1 };
        assert_eq!(
            segment.poke(0, OUT_BOX + 7, &[9]),
            expected,
            "plain memory, unless the processor holds it"
        );
    }
}

#[test]
fn the_place_of_a_buffer_is_fixed_while_it_is_active() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.poke(0, 0x0800, &[0x00, 0x18]), 0);
    // A whole block can be written over: only its activation changes.
    assert_eq!(segment.poke(0, 0x0800, &[0; 8]), 1);
    assert_eq!(segment.fetch(0, 0x0800, 8).unwrap(), [0x00, 0x10, 0x80, 0x00, 0x26, 0x30, 0x00, 0x00]);
    assert_eq!(segment.poke(0, 0x0800, &[0x00, 0x18]), 1);
}
