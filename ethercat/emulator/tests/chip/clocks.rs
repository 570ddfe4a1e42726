//! Distributed clocks: SYNC1 and subordinated cycles, latches, and chips in a line that pulse together.

use embassy_time::Timer;
use ethercat_esc::eeprom::Eeprom;
use ethercat_esc::{Chip, Command, Kind, Segment, SyncLine, SyncPin, World, now};

use crate::{in_line, processor_reads};

/// SYNC0 and SYNC1 as outputs, without and with mapping to the AL events.
const OUTPUTS: u8 = 0x44;

fn word(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// A line of chips whose EEPROMs have this byte for the pins of the SYNC signals, and pulses of 10 us.
fn line_with_pins<'w>(chips: u16, pins: u8) -> (World<'w>, Segment) {
    let (world, segment) = in_line(chips);
    for nth in 0..chips {
        let chip = segment.chip(nth.into());
        let mut content = chip.borrow().eeprom.content().to_vec();
        content[3] = pins;
        content[4..6].copy_from_slice(&1_000u16.to_le_bytes());
        content[14] = Eeprom::check(&content[..14]);
        *chip.borrow_mut() = Chip::new(Kind::LAN9252, content);
    }
    let mut segment = segment;
    for nth in 0..chips {
        assert_eq!(segment.poke(nth, 0x0010, &(0x1001 + nth).to_le_bytes()), 1);
        segment.chip(nth.into()).borrow_mut().set_port(1, nth + 1 < chips);
    }
    (world, segment)
}

fn activate(segment: &mut Segment, nth: u16, start: u64, cycles: [u32; 2]) {
    segment.poke(nth, 0x0981, &[0]);
    assert_eq!(segment.poke(nth, 0x0990, &start.to_le_bytes()), 1);
    let [sync0, sync1] = cycles.map(u32::to_le_bytes);
    assert_eq!(segment.poke(nth, 0x09A0, &[sync0, sync1].concat()), 1);
    assert_eq!(segment.poke(nth, 0x0981, &[7]), 1);
}

#[test]
fn sync1_follows_sync0_with_its_delay_and_leaves_cycles_out() {
    for (sync1, expected) in [
        (0, vec![1_000, 1_250, 1_500, 1_750]),
        (100_000, vec![1_100, 1_350, 1_600, 1_850]),
        // Every second and every third pulse of SYNC0.
        (250_000, vec![1_250, 1_750, 2_250]),
        (510_000, vec![1_510, 2_260, 3_010]),
    ] {
        let (mut world, mut segment) = line_with_pins(1, OUTPUTS);
        activate(&mut segment, 0, 1_000_000, [250_000, sync1]);
        let mut pin = SyncPin::new(segment.chip(0), SyncLine::Sync1);
        let count = expected.len();
        let pulses = world.run_until(async {
            let mut pulses = Vec::new();
            for _ in 0..count {
                pulses.push(pin.pulse().await / 1_000);
            }
            pulses
        });
        assert_eq!(pulses, expected, "{sync1}");
        assert_eq!(word(&segment.fetch(0, 0x0990, 8).unwrap()) % 250_000, 0, "the next pulse of SYNC0");
        assert!(word(&segment.fetch(0, 0x0998, 8).unwrap()) > now());
    }
}

#[test]
fn a_start_time_switches_the_unit_on_where_that_is_wanted() {
    let (mut world, mut segment) = line_with_pins(1, OUTPUTS);
    segment.poke(0, 0x09A0, &250_000u32.to_le_bytes());
    segment.poke(0, 0x0981, &[0x0A]);
    world.run_until(Timer::after_millis(1));
    assert_eq!(segment.chip(0).borrow().sync0_pulses(), 0);
    segment.poke(0, 0x0990, &2_000_000u64.to_le_bytes());
    assert_eq!(segment.fetch(0, 0x0981, 1), Some(vec![0x0B]));
    world.run_until(Timer::after_millis(2));
    segment.chip(0).borrow_mut().advance(now());
    assert_eq!(segment.chip(0).borrow().sync0_pulses(), 5);
}

#[test]
fn signals_are_events_only_where_the_eeprom_says_so() {
    for (pins, events) in [(OUTPUTS, 0), (OUTPUTS | 0x08, 4), (OUTPUTS | 0x80, 8)] {
        let (mut world, mut segment) = line_with_pins(1, pins);
        activate(&mut segment, 0, 1_000_000, [250_000, 0]);
        world.run_until(Timer::after_micros(1_005));
        assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 0x0C, events);
        world.run_until(Timer::after_micros(20));
        assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 0x0C, 0, "the pulse is over");
    }
}

#[test]
fn latches_keep_the_times_of_edges_for_the_side_that_controls_them() {
    // Inputs in place of the signals.
    let (mut world, mut segment) = line_with_pins(1, 0);
    world.run_until(Timer::after_micros(100));
    segment.chip(0).borrow_mut().set_latch(0, true, now());
    world.run_until(Timer::after_micros(50));
    segment.chip(0).borrow_mut().set_latch(0, false, now());
    assert_eq!(segment.fetch(0, 0x09AE, 2), Some(vec![3, 0]));
    assert_eq!(word(&segment.fetch(0, 0x0210, 2).unwrap()) & 1, 1, "the MainDevice's event");
    assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 2, 0);
    assert_eq!(word(&segment.fetch(0, 0x09B0, 8).unwrap()), 100_000);
    assert_eq!(segment.fetch(0, 0x09AE, 1), Some(vec![2]));
    assert_eq!(word(&segment.fetch(0, 0x09B8, 8).unwrap()), 150_000);
    assert_eq!(word(&segment.fetch(0, 0x0210, 2).unwrap()) & 1, 0);
    // LATCH1 by the processor, each rising edge once until it was read.
    assert_eq!(segment.poke(0, 0x0980, &[0x20]), 1);
    assert_eq!(segment.poke(0, 0x09A9, &[1]), 0, "not the MainDevice's any more");
    segment.chip(0).borrow_mut().write(now(), 0x09A9, &[1]);
    for level in [true, false, true] {
        world.run_until(Timer::after_micros(10));
        segment.chip(0).borrow_mut().set_latch(1, level, now());
    }
    assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 2, 2);
    assert_eq!(word(&processor_reads(&segment, 0x09C0, 8)), 160_000, "the first edge");
    assert_eq!(word(&processor_reads(&segment, 0x09C8, 8)), 170_000);
    assert_eq!(processor_reads(&segment, 0x0220, 1)[0] & 2, 0);
}

#[test]
fn a_pin_that_is_an_output_latches_nothing_and_one_that_is_an_input_does_not_pulse() {
    let (mut world, mut segment) = line_with_pins(1, 0x04);
    segment.chip(0).borrow_mut().set_latch(0, true, now());
    segment.chip(0).borrow_mut().set_latch(1, true, now());
    assert_eq!(segment.fetch(0, 0x09AE, 2), Some(vec![0, 5]));
    activate(&mut segment, 0, 1_000_000, [250_000, 0]);
    world.run_until(Timer::after_millis(2));
    let chip = segment.chip(0);
    chip.borrow_mut().advance(now());
    assert!(chip.borrow().pulses_at_pin(SyncLine::Sync0).is_some());
    assert_eq!(chip.borrow().pulses_at_pin(SyncLine::Sync1), None);
}

#[test]
fn chips_with_delays_and_drifting_clocks_pulse_together() {
    let (mut world, mut segment) = line_with_pins(4, OUTPUTS);
    for (nth, (start, drift)) in
        [(0, 0), (77_000_000, 40), (3, -60), (123_456_789, 100)].into_iter().enumerate()
    {
        segment.chip(nth).borrow_mut().set_clock(start, drift);
    }
    // As MainDevices do: offsets and delays by the receive times, then the reference's time again and again.
    segment.send(Command::Bwr, 0, 0x0900, &[0; 4]);
    let unit = |segment: &mut Segment, nth| word(&segment.fetch(nth, 0x0918, 8).unwrap());
    let round = |segment: &mut Segment, nth| {
        let times = segment.fetch(nth, 0x0900, 8).unwrap();
        word(&times[4..]).wrapping_sub(word(&times[..4])) as u32
    };
    let reference = unit(&mut segment, 0);
    let whole = round(&mut segment, 0);
    for nth in 1..4 {
        let behind = if nth < 3 { round(&mut segment, nth) } else { 0 };
        let delay = (whole - behind) / 2;
        assert_eq!(segment.poke(nth, 0x0928, &delay.to_le_bytes()), 1);
        let offset = (reference + u64::from(delay)).wrapping_sub(unit(&mut segment, nth));
        assert_eq!(segment.poke(nth, 0x0920, &offset.to_le_bytes()), 1);
    }
    world.run_until(async {
        for _ in 0..50 {
            assert_eq!(segment.send(Command::Frmw, 0x1001, 0x0910, &[0; 8]).counter, 4);
            Timer::after_millis(1).await;
        }
        for nth in 0..4 {
            activate(&mut segment, nth, now() / 1_000_000 * 1_000_000 + 2_000_000, [1_000_000, 0]);
        }
        let mut furthest = 0;
        for _ in 0..100 {
            segment.send(Command::Frmw, 0x1001, 0x0910, &[0; 8]);
            Timer::after_millis(1).await;
            let pulses: Vec<u64> = (0..4)
                .filter_map(|nth| {
                    let chip = segment.chip(nth);
                    chip.borrow_mut().advance(now());
                    let pulse = chip.borrow().pulses_at_pin(SyncLine::Sync0);
                    pulse.map(|(_, at)| at)
                })
                .collect();
            if let (Some(first), Some(last)) = (pulses.iter().min(), pulses.iter().max())
                && last - first < 500_000
            {
                furthest = furthest.max(last - first);
            }
        }
        println!("pulses at most {furthest} ns apart");
        assert!((1..500).contains(&furthest), "{furthest} ns, at up to 160 ns of drift a cycle");
    });
}
