//! Distributed clocks over SPI, with an H743's processor: jitter of outputs, age of inputs, shortest cycles.

use mobgate_simulator::esc::bench::{CLOCKED, CLOCKED_16};
use mobgate_simulator::sub_device::{StepSetup, exchange_in_step};

use crate::prelude::*;

/// Cycles of each figure; `MOBGATE_CYCLES` makes it more.
const CYCLES: u64 = 20_000;

pub(crate) fn figures() {
    let cycles = std::env::var("MOBGATE_CYCLES").map_or(CYCLES, |cycles| cycles.parse().expect("a number"));
    figure("dc_cycles", cycles as f64, "cycles", Target::None);
    for (name, with_mail) in [("", false), ("_with_mail", true)] {
        let setup = StepSetup { with_mail, ..StepSetup::h743(1_000, 500, cycles) };
        let result = exchange_in_step(&CLOCKED, setup).expect("ethercrab exchanges images");
        let jitter = result.jitter_ns() as f64 / 1e3;
        figure(&format!("dc_output_jitter{name}"), jitter, "us", Target::AtMost(5.0));
        let most = setup.cycle.as_micros() as f64 + 20.0;
        let age = result.input_age.as_micros() as f64;
        figure(&format!("dc_input_age{name}"), age, "us", Target::AtMost(most));
        figure(&format!("dc_images_lost{name}"), result.bad() as f64, "images", Target::AtMost(0.0));
        if !with_mail {
            let cost = result.traffic.0;
            figure("spi_bytes_per_dc_cycle", cost.bytes as f64, "B", Target::AtMost(320.0));
            figure("spi_selects_per_dc_cycle", cost.selects as f64, "selects", Target::AtMost(9.0));
        }
    }
    for (device, bytes, cycle_us, shift_us) in [(&CLOCKED, 120, 250, 50), (&CLOCKED_16, 16, 125, 0)] {
        let setup = StepSetup::h743(cycle_us, shift_us, cycles);
        let result = exchange_in_step(device, setup).expect("ethercrab exchanges images");
        let name = format!("dc_images_lost_at_{cycle_us}_us_with_{bytes}_bytes");
        figure(&name, result.bad() as f64, "images", Target::AtMost(0.0));
    }
}
