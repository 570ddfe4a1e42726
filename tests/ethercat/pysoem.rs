//! SOEM, by pysoem, on the gateway's SubDevice over a virtual cable.

use std::fs::File;
use std::os::unix::fs::FileExt;

use mobgate_simulator::Device as ModbusDevice;
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::own_network::{SEGMENT_END, in_own_network, start_master};
use mobgate_simulator::wall_clock::host_milliseconds;
use mobgate_simulator::world::Clock;

use crate::gateway::bench::{SETUP, Setup, with_gateway_and_devices};
use crate::gateway::matrix::Limits;
use crate::gateway::virtual_devices::Virtual;
use crate::outside::ends_well;
use crate::prelude::*;

#[test]
fn pysoem_starts_the_gateway_reads_its_objects_and_meets_its_watchdog() {
    in_own_network("pysoem::pysoem_starts_the_gateway_reads_its_objects_and_meets_its_watchdog", || {
        let line = line_of(&GATEWAY);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let place = EthercatState::new();
        let objects = Shared::new(GatewayObjects::new(&place));
        let mut sub_device = SubDevice::new(&GATEWAY, esc, objects.clone());
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let identity = [GATEWAY.identity.vendor, GATEWAY.identity.product].map(|number| number.to_string());
        let mut script = start_master("gateway.py", &identity);
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        match serve(&socket, &line, select(device, ends_well(&mut script))).unwrap() {
            Either::First(never) => never,
            Either::Second(()) => {}
        }
        let last = (0..120).map(|byte: u32| (499 + byte) as u8).collect::<Vec<_>>();
        place.outputs(|outputs| assert_eq!(outputs[..120], last, "the outputs of its last cycle"));
        assert!(!objects.0.borrow().outputs_valid(), "which are not valid any more");
    });
}

/// The first register of the first device holds this when the devices begin to change their inputs: see the script.
const MIRROR: u16 = 0xbeef;

/// How much later than it should this machine has woken the simulated line, in all: a file of eight bytes, in microseconds.
struct Account {
    file: File,
    late_us: u64,
}

impl Account {
    fn new(path: &str) -> Self {
        let file = File::create(path).unwrap();
        file.write_all_at(&[0; 8], 0).unwrap();
        Self { file, late_us: 0 }
    }

    /// Somebody was to be woken at `due`.
    fn woken(&mut self, due: Option<Instant>) {
        let late = due.map_or(0, |due| Instant::now().saturating_duration_since(due).as_micros());
        if late > 0 {
            self.late_us += late;
            self.file.write_all_at(&self.late_us.to_le_bytes(), 0).unwrap();
        }
    }
}

/// Lets each of `devices` set its first input register to the time now and then, no sooner than that can be seen.
async fn change_inputs(virtuals: Vec<Virtual>, devices: Vec<ModbusDevice>, limit: Duration) {
    let place = |nth: usize, kind: usize| usize::from(virtuals[nth].ranges[kind].1);
    let begun = || devices[0].memory().holding[place(0, 3)] == MIRROR;
    while !begun() {
        Timer::after_millis(10).await;
    }
    for nth in (0..devices.len()).cycle() {
        devices[nth].memory().input[place(nth, 2)] = host_milliseconds() as u16;
        Timer::after(limit / 2).await;
    }
}

#[test]
fn pysoem_configures_the_four_virtual_devices_by_sdo_and_exchanges_every_byte_in_time() {
    let test = "pysoem::pysoem_configures_the_four_virtual_devices_by_sdo_and_exchanges_every_byte_in_time";
    in_own_network(test, || {
        for (baud, polling_ms, cycle_ms) in [(115_200, 1, 1), (19_200, 500, 2), (4_800, 1_000, 4)] {
            let setup = Setup { baud, polling_ms, cycle_ms, ..SETUP };
            let limits = Limits::of(setup);
            // What the machine takes before the line's account of it.
            let [input, back] = [limits.input, limits.back].map(|limit| limit * 5 / 4);
            let numbers = [baud.into(), polling_ms.into(), cycle_ms, input.as_millis(), back.as_millis()];
            let numbers = numbers.map(|number: u64| number.to_string());
            let vectors =
                concat!(env!("CARGO_MANIFEST_DIR"), "/tests/gateway/points/vectors/virtual_slaves.toml");
            let late = concat!(env!("CARGO_TARGET_TMPDIR"), "/virtual_devices.late");
            let paths = [vectors, late].map(str::to_owned);
            let arguments: Vec<_> = paths.into_iter().chain(numbers).collect();
            let segment = line_of(&GATEWAY);
            let mut account = Account::new(late);
            let (socket, cable) = (PacketSocket::open(SEGMENT_END).unwrap(), segment.clone());
            let clock = Clock::Wall(Box::new(move |until| {
                socket.pass(&cable, until).unwrap();
                account.woken(until);
            }));
            with_gateway_and_devices(clock, setup, &segment, |world, virtuals, devices| {
                world.spawn(change_inputs(virtuals, devices, input));
                let mut script = start_master("virtual_devices.py", &arguments);
                world.run_until(ends_well(&mut script));
            });
        }
    });
}
