//! Data points: frames and time for the two examples of the note, whose controller needs 35.7 ms and 14.5 ms for them; how
//! exactly a silent device is tried again; how old values become; and how fast they are given from memory.

use mobgate::scanner::{DeviceId, RowId, Scanner, Status};

use crate::line::{TURNAROUND, seconds};
use crate::prelude::*;

const PLC: &str = "10.0.1.1:502";
const MS: Duration = Duration::from_millis(1);

pub(crate) fn figures() {
    // Three stations with 8 registers and 18 bits each, and one with three times as many in rows that follow each other.
    let apart = (1..=3).map(|unit| {
        format!(
            "device d{unit} unit {unit}
            point r{unit} d{unit} holding 0 count 8 read manual
            point b{unit} d{unit} coil 0 count 18 read manual\n"
        )
    });
    let gathered = (0..3).map(|nth| {
        let device = if nth == 0 { "device d unit 1\n" } else { "" };
        let (register, bit) = (8 * nth, 24 * nth);
        format!(
            "{device}point r{nth} d holding {register} count 8 read manual
            point b{nth} d coil {bit} count 24 read manual\n"
        )
    });
    round("apart", &apart.collect::<String>(), 6.0, 35.7);
    round("gathered", &gathered.collect::<String>(), 2.0, 14.5);
    back_off();
    memory();
}

fn scanner<R>(rig: &Rig<'_>, f: impl FnOnce(&mut Scanner) -> R) -> R {
    rig.gateway.scanner().expect("the rig has data points").change(f)
}

fn settings(points: &str) -> String {
    format!(
        "port plc tcp client {PLC} idle 0 timeout 300ms late-window 1ms
        port P502 tcp server 502
        port scan scanner
        route scan 1-247 * * plc
        route P502 1 * * local
        {points}"
    )
}

/// Reads all points once.
fn round(name: &str, points: &str, frames: f64, ms: f64) {
    with_gateway(1, &settings(points), |world, rig| {
        let devices: Vec<Device> =
            (1..=3).map(|unit| Device::new(unit).with_turnaround(TURNAROUND)).collect();
        rig.attach_tcp(world, PLC, devices.clone());
        world.run_for(Duration::from_secs(5));
        let start = Instant::now();
        let rows = scanner(rig, |scanner| {
            let rows = scanner.rows() as u8;
            (0..rows).try_for_each(|row| scanner.read(RowId(row), start)).map(|()| rows)
        });
        let rows = rows.expect("devices that have not been asked yet");
        let is_read = |scanner: &mut Scanner| {
            (0..rows).all(|row| scanner.status(RowId(row), Instant::now()) == Status::LAST_OK)
        };
        let mut took = Duration::from_ticks(0);
        while !scanner(rig, is_read) && took < Duration::from_secs(1) {
            world.run_for(Duration::from_micros(10));
            took = start.elapsed();
        }
        let asked: u64 = devices.iter().map(|device| device.counters().all_requests()).sum();
        figure(&format!("points_{name}_frames"), asked as f64, "frames", Target::AtMost(frames));
        figure(&format!("points_{name}_round"), seconds(took) * 1e3, "ms", Target::AtMost(ms));
    });
}

/// The times from a failed attempt to the next one.
fn back_off() {
    let points = "device plc unit 5\npoint a plc holding 0 write auto read manual\n";
    with_gateway(1, &settings(points), |world, rig| {
        let device = Device::new(5).with_faults(Faults::new(1).with(When::Always, Fault::Dead));
        rig.attach_tcp(world, PLC, [device.clone()]);
        world.run_for(Duration::from_secs(5));
        scanner(rig, |scanner| scanner.put(RowId(0), 0, 1, &[0, 1], Instant::now()))
            .expect("a row that can be written");
        let mut worst = Duration::from_ticks(0);
        for wanted in [15, 17, 19, 21, 23, 25, 27, 29, 30, 30] {
            let failed = attempt_fails(world, rig);
            let before = device.counters().all_requests();
            world.run_until(Timer::at(failed + Duration::from_secs(wanted) - MS));
            while device.counters().all_requests() == before {
                world.run_for(Duration::from_micros(100));
            }
            // The request had to come to the device, too.
            let (is, should) = (failed.elapsed(), Duration::from_secs(wanted));
            worst = worst.max(is.max(should) - is.min(should));
        }
        figure("points_back_off_worst", seconds(worst) * 1e3, "ms", Target::AtMost(1.0));
    });
}

/// Waits until the device is left alone, and gives the time since when.
fn attempt_fails(world: &mut World<'_>, rig: &Rig<'_>) -> Instant {
    let status = || scanner(rig, |scanner| scanner.device_status(DeviceId(0), Instant::now()));
    let asked = |failures: u32| status().is_none_or(|status| status.failures > failures);
    let before = status().map_or(0, |status| status.failures);
    loop {
        world.run_for(Duration::from_micros(20));
        if asked(before) && status().is_some_and(|status| status.backs_off_until.is_some()) {
            break;
        }
    }
    // Within the step just passed.
    Instant::now()
}

/// A client that reads from memory what the scanner keeps fresh.
fn memory() {
    let points = "device d unit 1\npoint a d holding 0 count 10 read high\npoint b local input 0 of a\n";
    with_gateway(1, &settings(points), |world, rig| {
        rig.attach_tcp(world, PLC, [Device::new(1).with_turnaround(TURNAROUND)]);
        world.run_for(Duration::from_secs(30));
        let mut client = rig.client(machine(1), 502);
        let (mut oldest, mut wrong) = (Duration::from_ticks(0), 0);
        let start = Instant::now();
        const READS: u32 = 10_000;
        let mut asked = Duration::from_ticks(0);
        for _ in 0..READS {
            let sent = Instant::now();
            let response = world.run_until(client.request(1, &[4, 0, 0, 0, 10]));
            asked += sent.elapsed();
            wrong += u32::from(!matches!(&response, Response::Pdu(pdu) if pdu[..6] == [4, 20, 1, 0, 1, 1]));
            let age = scanner(rig, |scanner| scanner.age(RowId(0), Instant::now()));
            oldest = oldest.max(age.unwrap_or(start.elapsed()));
            world.run_for(MS);
        }
        figure("points_memory_read", seconds(asked / READS) * 1e3, "ms", Target::AtMost(0.1));
        figure("points_memory_oldest", seconds(oldest) * 1e3, "ms", Target::AtMost(205.0));
        figure("points_memory_wrong", wrong.into(), "responses", Target::AtMost(0.0));
    });
}
