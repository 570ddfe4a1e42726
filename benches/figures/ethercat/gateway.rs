//! From a new output of the MainDevice to its read-back in the inputs: one drive, polled as fast as its line allows.

use ethercat_subdevice::device::Device as Description;
use ethercat_subdevice::sub_device::SubDevice;
use ethercrab::subdevice_group::{Op, PreOp};
use mobgate::fieldbus::{DEVICE, GatewayObjects};
use mobgate_simulator::sub_device::{Dispatcher, Group, cable, direct, line_of, spawn, with_master};

use super::matrix::{COMBINATIONS, Longest, combination, exchange};
use crate::line::TURNAROUND;
use crate::prelude::*;

static GATEWAY: Description = DEVICE;

/// The drive of the source, by entries of 2001h: unit 1, four holding registers from 9005 on.
const DRIVE: [(u8, u16); 3] = [(1, 1), (8, 4), (9, 9_005)];
const CYCLE: Duration = Duration::from_millis(1);
const CHANGES: u16 = 500;

pub(crate) fn figures() {
    for (baud, most) in [(19_200, 56.0), (115_200, 22.0)] {
        let times = read_back(baud);
        let longest = times.iter().max().map_or(f64::MAX, |time| time.as_micros() as f64 / 1e3);
        figure(&format!("ethercat_read_back_{baud}"), longest, "ms", Target::AtMost(most));
    }
    let all: Vec<Longest> = (0..COMBINATIONS).map(|nth| exchange(combination(nth))).collect();
    let longest = |part: fn(&Longest) -> f64| all.iter().map(part).fold(0.0, f64::max);
    figure("ethercat_combinations", COMBINATIONS as f64, "combinations", Target::None);
    figure("ethercat_input_longest", longest(|one| one.input), "of-what-it-may-take", Target::AtMost(1.0));
    figure("ethercat_output_longest", longest(|one| one.back), "of-what-it-may-take", Target::AtMost(1.0));
}

/// How long each of many changes took, at random times.
fn read_back(baud: u32) -> Vec<Duration> {
    let settings = format!(
        "port bus serial uart1 rtu client {baud} 8E1
        port ecat ethercat
        route ecat 1-247 * * bus"
    );
    with_gateway(1, &settings, |world, rig| {
        rig.attach(world, "uart1", [Device::new(1).with_turnaround(TURNAROUND)]);
        let line = line_of(&GATEWAY);
        let (esc, interrupt) = direct(line.borrow().chip(0));
        let objects = GatewayObjects::new(rig.gateway.ethercat().expect("the rig has the place"));
        spawn(world, SubDevice::new(&GATEWAY, esc, objects), interrupt);
        with_master(world, cable(line), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.expect("a cable without faults");
            configure(&dispatcher, &group).await;
            let group = dispatcher.to_op(group, 0).await.expect("a cable without faults");
            // What the drive held before is written over first.
            change(&dispatcher, &group, u16::MAX).await;
            let mut random = Random::new(baud.into());
            let mut times = Vec::new();
            for value in 1..=CHANGES {
                // The pauses must not set off the watchdog.
                for _ in 0..random.within(0..=50) {
                    group.tx_rx(dispatcher.master).await.expect("a cable without faults");
                    Timer::after(CYCLE).await;
                }
                Timer::after_micros(random.within(0..=1_000)).await;
                times.push(change(&dispatcher, &group, value).await);
            }
            times
        })
    })
}

/// One device that is polled again as soon as it has been.
async fn configure(dispatcher: &Dispatcher<'_>, group: &Group<PreOp>) {
    let gateway = group.subdevice(dispatcher.master, 0).expect("there is one");
    let write = async |index, sub, value: u16| {
        gateway.sdo_write(index, sub, value).await.expect("a value in its range");
    };
    write(0x2000, 1, 1).await;
    for (sub, value) in DRIVE {
        write(0x2001, sub, value).await;
    }
    gateway.sdo_write(0x2001, 10, 1_u32).await.expect("a value in its range");
    write(0x2005, 1, 1).await;
}

/// Sends `value` for all registers, until they are read back.
async fn change(dispatcher: &Dispatcher<'_>, group: &Group<Op>, value: u16) -> Duration {
    let gateway = group.subdevice(dispatcher.master, 0).expect("there is one");
    let registers = [value.to_be_bytes(); 4].concat();
    gateway.outputs_raw_mut()[..8].copy_from_slice(&registers);
    let begin = Instant::now();
    loop {
        group.tx_rx(dispatcher.master).await.expect("a cable without faults");
        if gateway.inputs_raw()[..8] == registers {
            return begin.elapsed();
        }
        Timer::after(CYCLE).await;
    }
}
