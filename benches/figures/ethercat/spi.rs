//! What a cycle of process data costs on the SPI of a LAN9252, counted by the simulated chip.

use std::cell::RefCell;
use std::rc::Rc;

use ethercat_subdevice::device::Device;
use ethercat_subdevice::esc::Esc;
use ethercat_subdevice::lan9252::{Lan9252 as Driver, Wiring};
use mobgate::fieldbus::DEVICE;
use mobgate_simulator::Lan9252;
use mobgate_simulator::esc::{Chip, Command, Kind, Segment};
use mobgate_simulator::lan9252::{Timing, Traffic};
use mobgate_simulator::sub_device::{exchange_at_pace, spi_traffic};

use crate::prelude::*;

static GATEWAY: Device = DEVICE;

const CYCLES: u64 = 1_000;
const PACED_CYCLES: u64 = 100_000;
/// Once in 20 ms two registers are read that tell whether the chip was reset behind the driver's back.
const CHECK_BYTES: u64 = 2 * 7;
const CHECK_SELECTS: u64 = 2;
const OUTPUTS: u16 = 0x1100;
const INPUTS: u16 = 0x1400;
/// SyncManagers for outputs and inputs of 120 bytes.
const MANAGERS: [u8; 16] =
    [0x00, 0x11, 0x78, 0x00, 0x64, 0x00, 0x01, 0x00, 0x00, 0x14, 0x78, 0x00, 0x20, 0x00, 0x01, 0x00];

pub(crate) fn figures() {
    // With looks at events, as boards run it; and with the setting that reads outputs twice.
    for (name, proves, bytes, selects) in [("", false, 320, 9), ("_proving", true, 480, 16)] {
        let cost = spi_traffic(&GATEWAY, CYCLES, proves).expect("ethercrab exchanges images");
        traffic(&format!("cycle{name}"), cost.usual, [bytes, selects]);
        let with_check = [bytes + CHECK_BYTES, selects + CHECK_SELECTS];
        traffic(&format!("cycle_with_check{name}"), cost.worst, with_check);
    }
    for (mhz, spi_hz) in [(20, 20_000_000), (30, 30_000_000)] {
        pace(mhz, spi_hz);
    }
    driver();
}

fn traffic(name: &str, seen: Traffic, most: [u64; 2]) {
    let [bytes, selects] = most.map(|most| Target::AtMost(most as f64));
    figure(&format!("spi_bytes_per_{name}"), seen.bytes as f64, "B", bytes);
    figure(&format!("spi_selects_per_{name}"), seen.selects as f64, "selects", selects);
}

/// The shortest cycle that is promised, of what it is made, and how images fare in it.
fn pace(mhz: u32, spi_hz: u32) {
    let paced = exchange_at_pace(&GATEWAY, spi_hz, 100, PACED_CYCLES).expect("ethercrab exchanges images");
    let (cost, exchanged) = (paced.cost, paced.exchanged);
    let bus_ns = cost.nanos(0) - cost.selects * cost.select_ns;
    for (part, nanos) in [
        ("bytes", bus_ns),
        ("selects", cost.selects * cost.select_ns),
        ("fixed", paced.promised_ns - cost.nanos(0)),
        ("all", paced.promised_ns),
    ] {
        let name = format!("cycle_min_{mhz}_mhz_{part}");
        figure(&name, f64::from(nanos) / 1e3, "us", Target::None);
    }
    let bad = (exchanged.lost + exchanged.wrong + exchanged.short) as f64;
    figure(&format!("cycle_min_{mhz}_mhz_images_lost_or_torn"), bad, "images", Target::AtMost(0.0));
}

/// The driver alone.
fn driver() {
    let mut world = World::new(1);
    let segment = Rc::new(RefCell::new(Segment::new([Chip::new(Kind::LAN9252, Vec::new())])));
    let chip = Lan9252::new(segment.borrow().chip(0), Timing::USUAL);
    let mut driver = Driver::new(chip.spi(), Wiring::default());
    world.run_until(async {
        // The first access starts the chip.
        driver.events().await.expect("a chip");
        segment.borrow_mut().poke(0, 0x0810, &MANAGERS);
        let (mut cycle, mut polling, mut micros) = (Traffic::default(), Traffic::default(), 0);
        for number in 0..CYCLES {
            let sent = [number as u8; 120];
            segment.borrow_mut().send(Command::Apwr, 0, OUTPUTS, &sent);
            chip.take_traffic();
            driver.events().await.expect("events");
            polling = most(polling, chip.take_traffic());
            let begin = Instant::now();
            let mut image = [0; 120];
            driver.read(OUTPUTS, &mut image).await.expect("outputs");
            driver.write(INPUTS, &image).await.expect("inputs");
            cycle = most(cycle, chip.take_traffic());
            micros += begin.elapsed().as_micros();
            assert_eq!(image, sent);
        }
        figure("spi_driver_bytes_per_cycle", cycle.bytes as f64, "B", Target::AtMost(300.0));
        figure("spi_driver_selects_per_cycle", cycle.selects as f64, "selects", Target::AtMost(8.0));
        figure("spi_driver_time_per_cycle", micros as f64 / CYCLES as f64, "us", Target::None);
        figure("spi_bytes_per_event_poll", polling.bytes as f64, "B", Target::None);
    });
    chip.check();
}

/// The worse of two, each count by itself.
fn most(one: Traffic, other: Traffic) -> Traffic {
    Traffic { bytes: one.bytes.max(other.bytes), selects: one.selects.max(other.selects) }
}
