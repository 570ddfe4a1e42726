//! The field tools: what `scan` finds on an unknown line and how long it takes, and how near the time-out that `tune` proposes is to
//! what 999 of 1000 responses need.

use mobgate::settings::{LineSettings, Parity};
use mobgate_simulator::console::typed;
use mobgate_simulator::device;

use crate::line::DISCARDS;
use crate::prelude::*;

/// From the end of a request to the first character of its response, besides the device's own time: t3.5 and a character.
const AROUND_US: f64 = 2_006.0 + 573.0;
const TURNAROUND: Duration = Duration::from_millis(5);
/// Of each kind of device so many are measured, and nine of ten are at most, or at least, what is told: what 2 000 responses tell of the
/// slowest one in 1 000 has a standard deviation of 9 % where they are exponential.
const DRAWS: u64 = 20;

pub(crate) fn figures() {
    scan();
    let ms = Duration::from_millis;
    let sometimes_slow = |chance| Some((When::Chance(chance), Fault::Late(ms(150), ms(170))));
    // Of the slow ones, 2 % or 20 % are not among 999 of 1000.
    let models = [
        ("constant", 0.0, None),
        ("uniform", 0.999 * 40_000.0, Some((When::Always, Fault::Late(ms(0), ms(40))))),
        ("exponential", 8_000.0 * 1_000_f64.ln(), Some((When::Always, Fault::Lingers(ms(8))))),
        ("often_slow", 150_000.0 + 0.98 * 20_000.0, sometimes_slow(0.05)),
        ("seldom_slow", 150_000.0 + 0.8 * 20_000.0, sometimes_slow(0.005)),
    ];
    for (name, late_us, fault) in models {
        let p999_us = AROUND_US + TURNAROUND.as_micros() as f64 + late_us;
        let ratio = |seed| {
            let none = Faults::new(seed);
            let faults = fault.iter().cloned().fold(none, |faults, (when, fault)| faults.with(when, fault));
            tuned(faults).map_or(0.0, |timeout_us| timeout_us / p999_us)
        };
        let mut ratios: Vec<f64> = (0..DRAWS).map(ratio).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let [least, most] = [ratios.len() / 10, ratios.len() * 9 / 10 - 1].map(|nth| ratios[nth]);
        figure(&format!("tune_timeout_over_p999_{name}"), most, "x", Target::AtMost(1.2));
        figure(&format!("tune_timeout_over_p999_{name}_least"), least, "x", Target::AtLeast(0.8));
    }
}

/// Five units at two of four speeds, each in its own format.
fn scan() {
    let settings = "port bus serial uart1 rtu client 115200 8E1\n";
    let line = |baud, parity| LineSettings { baud, parity, ..LineSettings::DEFAULT };
    let there = [(line(9_600, Parity::None), &[3, 17, 240][..]), (line(38_400, Parity::Even), &[5, 99])];
    rig::with_gateway(20, settings, |world, rig| {
        for (line, units) in there {
            let devices = units.iter().map(|unit| Device::new(*unit)).collect();
            world.spawn(device::serve(rig.wire("uart1").tap(line), devices));
        }
        let begun = Instant::now();
        let shown = world.run_until(typed(rig.gateway, "scan bus 9600 19200 38400 115200"));
        let told = shown.lines().filter(|line| line.starts_with("unit "));
        let right = |told: &&str| {
            let is = |(line, unit): (LineSettings, &u8)| {
                told.starts_with(&format!("unit {unit:>3} {:12} ", line.speed()))
            };
            there.iter().any(|(line, units)| units.iter().any(|unit| is((*line, unit))))
        };
        let (found, wrong): (Vec<&str>, Vec<&str>) = told.partition(right);
        figure("scan_found", found.len() as f64, "units", Target::AtLeast(5.0));
        figure("scan_wrong", wrong.len() as f64, "units", Target::AtMost(0.0));
        figure("scan_seconds", begun.elapsed().as_secs() as f64, "s", Target::None);
    });
}

/// The time-out that `tune` proposes for a device with these faults, in microseconds.
fn tuned(faults: Faults) -> Option<f64> {
    rig::with_gateway(22, "port bus serial uart1 rtu client 19200 8E1\n", |world, rig| {
        rig.attach(world, "uart1", [Device::new(5).with_turnaround(TURNAROUND).with_faults(faults)]);
        world.run_for(DISCARDS);
        let shown = world.run_until(typed(rig.gateway, "tune bus units 5"));
        let timeout = shown.split_whitespace().skip_while(|word| *word != "timeout").nth(1)?;
        Some(1_000.0 * timeout.strip_suffix("ms")?.parse::<f64>().ok()?)
    })
}
