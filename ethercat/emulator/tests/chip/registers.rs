//! Block accesses across the register map, as masters make them.

use ethercat_esc::World;
use ethercat_esc::{Command, Segment};

use ethercat_esc::samples::line;

use crate::in_line;

#[test]
fn blocks_may_cross_read_only_and_missing_registers() {
    let (_world, mut segment) = in_line(1);
    let mut broadcast = |offset, bytes: usize| segment.send(Command::Bwr, 0, offset, &vec![0; bytes]).counter;
    assert_eq!(broadcast(0x0600, 256), 1, "sixteen FMMUs, of which there are three");
    assert_eq!(broadcast(0x0800, 128), 1, "sixteen SyncManagers, of which there are four");
    assert_eq!(broadcast(0x0300, 20), 1, "all error counters");
    assert_eq!(broadcast(0x0442, 2), 1);
    assert_eq!(broadcast(0x0910, 8), 1);
    assert_eq!(broadcast(0x0670, 16), 0, "an FMMU that is not there");
}

#[test]
fn a_block_that_begins_with_a_read_only_byte_is_written_where_it_can_be() {
    let (_world, mut segment) = in_line(1);
    assert_eq!(segment.poke(0, 0x080D, &[0xFF, 0x03]), 1);
    assert_eq!(segment.fetch(0, 0x080D, 2).unwrap(), [0x30, 0x03]);
}

#[test]
fn memory_ends_where_the_chip_says() {
    let (_world, mut segment) = in_line(1);
    assert_eq!(segment.poke(0, 0x1FFF, &[1, 2]), 1);
    assert_eq!(segment.fetch(0, 0x1FFF, 1), Some(vec![1]));
    assert_eq!(segment.fetch(0, 0x2000, 1), None);
    assert_eq!(segment.fetch(0, 0xFFFF, 2), None);
}

#[test]
fn the_chip_tells_what_it_is() {
    let _world = World::new(1);
    let mut segment: Segment = line(1);
    assert_eq!(segment.fetch(0, 0x0000, 10).unwrap(), [0xC0, 2, 0, 0, 3, 4, 4, 0x0F, 0xCC, 1]);
}

#[test]
fn counters_stop_at_their_end_and_are_cleared_by_a_write() {
    let (_world, mut segment) = in_line(1);
    for _ in 0..300 {
        segment.chip(0).borrow_mut().write(0, 0x3000, &[0]);
    }
    assert_eq!(segment.fetch(0, 0x030D, 1), Some(vec![255]), "accesses of the processor to nothing");
    segment.poke(0, 0x030D, &[0]);
    assert_eq!(segment.fetch(0, 0x030D, 1), Some(vec![0]));
}
