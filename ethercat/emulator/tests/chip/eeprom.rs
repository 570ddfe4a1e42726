//! The EEPROM interface: reading and writing words, who may, and what a wrong check byte does.

use embassy_time::Timer;
use ethercat_esc::World;
use ethercat_esc::eeprom::Eeprom;
use ethercat_esc::{Chip, Kind, Segment};

use ethercat_esc::samples::eeprom;

use crate::in_line;

fn command(segment: &mut Segment, command: u16, word: u32) -> u16 {
    segment.poke(0, 0x0502, &[&command.to_le_bytes()[..], &word.to_le_bytes()].concat())
}

fn status(segment: &mut Segment) -> u16 {
    u16::from_le_bytes(segment.fetch(0, 0x0502, 2).unwrap().try_into().unwrap())
}

#[test]
fn the_check_byte_agrees_with_known_vectors() {
    assert_eq!(Eeprom::check(&[9, 0, 0, 8, 0, 0, 0, 0, 0xCD, 0xAB, 0, 0, 0, 0]), 0x04);
    assert_eq!(Eeprom::check(&[0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]), 0xE9);
}

#[test]
fn a_read_gives_eight_or_four_bytes_as_the_chip_says() {
    let _world = World::new(1);
    for (kind, bytes) in [(Kind::LAN9252, 8), (Kind::ET1100, 4)] {
        let mut content = eeprom(0);
        content[0x40..0x48].copy_from_slice(&[1, 2, 3, 4, 5, 6, 7, 8]);
        let mut segment = Segment::new([Chip::new(kind, content)]);
        assert_eq!(command(&mut segment, 0x0100, 0x20), 1);
        assert_eq!(status(&mut segment) & 0x40 != 0, bytes == 8);
        let data = segment.fetch(0, 0x0508, 8).unwrap();
        assert_eq!(data[..bytes], [1, 2, 3, 4, 5, 6, 7, 8][..bytes]);
    }
}

#[test]
fn a_command_takes_its_time_in_which_nothing_else_is_accepted() {
    let (mut world, mut segment) = in_line(1);
    segment.chip(0).borrow_mut().eeprom.busy_nanos = 1_000_000;
    world.run_until(async {
        assert_eq!(command(&mut segment, 0x0100, 0), 1);
        assert_eq!(status(&mut segment) & 0x8000, 0x8000);
        assert_eq!(command(&mut segment, 0x0100, 4), 0);
        Timer::after_micros(1_000).await;
        assert_eq!(status(&mut segment) & 0x8000, 0);
        assert_eq!(segment.fetch(0, 0x0508, 2).unwrap(), [0x80, 0]);
    });
}

#[test]
fn statement_49_an_alias_that_the_main_device_writes_counts_from_the_next_power_cycle_on() {
    let (_world, mut segment) = in_line(1);
    let mut config = eeprom(0x1234);
    assert_eq!(segment.poke(0, 0x0508, &[0x34, 0x12]), 1);
    assert_eq!(command(&mut segment, 0x0201, 4), 1);
    assert_eq!(segment.poke(0, 0x0508, &config[14..16]), 1);
    assert_eq!(command(&mut segment, 0x0201, 7), 1);
    assert_eq!(status(&mut segment) & 0x7800, 0);
    assert_eq!(segment.fetch(0, 0x0012, 2).unwrap(), [0x00, 0x0A], "not yet");
    assert_eq!(command(&mut segment, 0x0400, 0), 1);
    assert_eq!(segment.fetch(0, 0x0012, 2).unwrap(), [0x00, 0x0A], "nor after a reload");
    segment.chip(0).borrow_mut().reset();
    assert_eq!(segment.fetch(0, 0x0012, 2).unwrap(), [0x34, 0x12]);
    // And a wrong check byte is told, while the state stays what it is.
    config.truncate(14);
    segment.poke(0, 0x0508, &[0xFF, 0x00]);
    command(&mut segment, 0x0201, 7);
    command(&mut segment, 0x0400, 0);
    assert_eq!(status(&mut segment) & 0x1800, 0x1800);
    assert_eq!(segment.fetch(0, 0x0110, 1).unwrap()[0] & 1, 0);
    assert_eq!(segment.fetch(0, 0x0130, 6).unwrap(), [1, 0, 0, 0, 0, 0]);
}

#[test]
fn a_write_needs_its_enable_bit() {
    let (_world, mut segment) = in_line(1);
    command(&mut segment, 0x0200, 4);
    assert_eq!(status(&mut segment) & 0x4000, 0x4000);
    command(&mut segment, 0x0000, 0);
    assert_eq!(status(&mut segment) & 0x4000, 0, "cleared by an empty command");
}

#[test]
fn statement_50_an_eeprom_that_was_handed_to_the_processor_gives_the_main_device_no_data() {
    let (_world, mut segment) = in_line(1);
    let chip = segment.chip(0);
    chip.borrow_mut().write(0, 0x0501, &[1]);
    assert_eq!(command(&mut segment, 0x0100, 0), 1, "it must be handed over first");
    assert_eq!(segment.poke(0, 0x0500, &[1]), 1);
    chip.borrow_mut().write(0, 0x0501, &[1]);
    assert_eq!(command(&mut segment, 0x0100, 0), 0);
    assert_eq!(segment.fetch(0, 0x0508, 4), None);
    chip.borrow_mut().write(0, 0x0502, &[0, 1, 4, 0, 0, 0]);
    let mut alias = [0; 2];
    chip.borrow_mut().read(0, 0x0508, &mut alias);
    assert_eq!(alias, [0x00, 0x0A], "the processor reads it");
    // The MainDevice takes it back by force, as SOEM does at start-up.
    segment.poke(0, 0x0500, &[2]);
    segment.poke(0, 0x0500, &[0]);
    assert_eq!(command(&mut segment, 0x0100, 0), 1);
}
