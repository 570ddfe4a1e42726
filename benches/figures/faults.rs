//! Random faults, and how many responses were not the response to their request.

use mobgate_simulator::device::Fresh;

use crate::prelude::*;

const TRIALS: u32 = 10_000;
/// Where the devices have registers that differ at every read.
const FRESH: u16 = 100;
/// Response time-out, and so the late-reply window.
const TIMEOUT_MS: u64 = 100;

/// What came of the trials.
#[derive(Default)]
struct Trials {
    good: u32,
    refused: u32,
    stale: u32,
    wrong: u32,
}

pub(crate) fn figures() {
    let settings = format!(
        "port P1 serial bus rtu client 19200 8E1 timeout {TIMEOUT_MS}ms down-after 0 retries 1\n\
         port P502 tcp server 502\nroute P502 * * * P1\n"
    );
    let late = Fault::Late(Duration::from_millis(1), Duration::from_millis(2 * TIMEOUT_MS - 40));
    let kinds = [
        ("late", vec![late]),
        ("wrong_unit", vec![Fault::WrongUnit]),
        ("bad_crc", vec![Fault::BadCrc]),
        (
            "mixed",
            vec![late, Fault::WrongUnit, Fault::BadCrc, Fault::WrongEcho, Fault::Truncated, Fault::LostByte],
        ),
    ];
    for (name, faults) in kinds {
        let trials = run(&settings, &faults);
        let total = f64::from(trials.good + trials.refused + trials.stale + trials.wrong);
        figure(&format!("{name}_trials"), total, "trials", Target::AtLeast(f64::from(TRIALS)));
        figure(&format!("{name}_stale"), f64::from(trials.stale), "responses", Target::AtMost(0.0));
        figure(&format!("{name}_wrong"), f64::from(trials.wrong), "responses", Target::AtMost(0.0));
        // The faults must really have hit, and must not have hit always.
        let share = f64::from(trials.good) / total;
        figure(&format!("{name}_answered"), 100.0 * share, "%", Target::AtLeast(40.0));
    }
}

/// Two devices, of which every second response or so is at fault, and a client that asks both for values of now.
fn run(settings: &str, faults: &[Fault]) -> Trials {
    rig::with_gateway(11, settings, |world, rig| {
        let devices = [1, 2].map(|unit| {
            let chance = When::Chance(0.3 / faults.len() as f64);
            let none = Faults::new(unit.into());
            let rules = faults.iter().fold(none, |rules, fault| rules.with(chance.clone(), *fault));
            Device::new(unit).with_fresh(FRESH).with_faults(rules)
        });
        rig.attach(world, "bus", devices.clone());
        let mut random = Random::new(12);
        let mut client = rig.client(machine(1), 502);
        let mut trials = Trials::default();
        let mut last_reads = [0; 2];
        for _ in 0..TRIALS {
            let unit = random.index(2);
            let pause_ms = random.within(0..=3);
            world.run_until(trial(&mut client, unit, pause_ms, &mut last_reads[unit], &mut trials));
        }
        trials
    })
}

async fn trial(client: &mut Client, unit: usize, pause_ms: u64, last_reads: &mut u32, trials: &mut Trials) {
    Timer::after_millis(pause_ms).await;
    let asked_us = Instant::now().as_micros() as u32;
    let response = client.request(unit as u8 + 1, &[3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8]).await;
    let Response::Pdu(pdu) = &response else {
        trials.wrong += 1;
        return;
    };
    match (Fresh::from_response(pdu), response.exception()) {
        // Read before it was asked for, as the device's own clock and count tell.
        (Some(fresh), _)
            if fresh.at_us.wrapping_sub(asked_us) > u32::MAX / 2 || fresh.reads <= *last_reads =>
        {
            trials.stale += 1;
        }
        (Some(fresh), _) => {
            *last_reads = fresh.reads;
            trials.good += 1;
        }
        (None, Some(0x0b)) => trials.refused += 1,
        (None, _) => trials.wrong += 1,
    }
}
