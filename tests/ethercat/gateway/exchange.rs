//! ethercrab configures the gateway and exchanges its process image with Modbus devices on a wire, all in virtual time.

use embassy_time::{Duration, Instant, Timer};
use ethercrab::subdevice_group::{Op, PreOp};
use mobgate::config::LineSettings;
use mobgate::ethercat::device::Device as Description;
use mobgate::ethercat::sub_device::SubDevice;
use mobgate::port::ethercat::{DEVICE, GatewayObjects};
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::with_gateway;
use mobgate_simulator::sub_device::{Desk, Group, cable, direct, line_of, spawn, with_master};
use mobgate_simulator::{Device, Fault, Faults, Random};

use super::virtual_devices::{Virtual, virtual_devices};

static GATEWAY: Description = DEVICE;

/// What is set at the gateway and at the MainDevice.
#[derive(Debug, Clone, Copy)]
struct Setup {
    baud: u32,
    polling_ms: u32,
    cycle_ms: u64,
    on_loss: &'static str,
}

const MS: Duration = Duration::from_millis(1);
/// Of the simulated devices.
const TURNAROUND: Duration = MS;
const SETUP: Setup = Setup { baud: 115_200, polling_ms: 100, cycle_ms: 2, on_loss: "stop" };

/// What a script works with.
struct Bench<'m> {
    desk: Desk<'m>,
    setup: Setup,
    virtuals: Vec<Virtual>,
    devices: Vec<Device>,
}

/// The virtual devices on a wire, the gateway, and a MainDevice that does as `script` says.
fn with_devices(setup: Setup, script: impl AsyncFnOnce(Bench<'_>)) {
    let Setup { baud, on_loss, .. } = setup;
    let settings = format!(
        "port bus serial uart1 rtu client {baud} 8E1 timeout 1s
        port ecat ethercat on-loss {on_loss}
        route ecat 1-247 * * bus"
    );
    with_gateway(1, &settings, |world, rig| {
        let virtuals = virtual_devices();
        let devices: Vec<Device> = virtuals.iter().map(Virtual::device).collect();
        rig.attach(world, "uart1", devices.clone());
        let line = line_of(&GATEWAY);
        let (esc, interrupt) = direct(line.borrow().chip(0));
        let objects = GatewayObjects::new(rig.gateway.ethercat().unwrap());
        spawn(world, SubDevice::new(&GATEWAY, esc, objects), interrupt);
        with_master(world, cable(line), async |desk| script(Bench { desk, setup, virtuals, devices }).await);
    });
}

impl Bench<'_> {
    /// Writes the configuration of all devices, and has it taken over.
    async fn configure(&self, group: &Group<PreOp>) {
        let gateway = group.subdevice(self.desk.master, 0).unwrap();
        for (device, index) in self.virtuals.iter().zip(0x2001..) {
            for (value, sub) in device.settings().into_iter().zip(1..) {
                gateway.sdo_write(index, sub, value).await.unwrap();
            }
            gateway.sdo_write(index, 10, self.setup.polling_ms).await.unwrap();
        }
        gateway.sdo_write(0x2020, 1, self.setup.baud).await.unwrap();
        gateway.sdo_write(0x2020, 2, 1_u16).await.unwrap();
        gateway.sdo_write(0x2020, 3, 2_u16).await.unwrap();
        gateway.sdo_write(0x2005, 1, 1_u16).await.unwrap();
    }

    /// To Op, with `outputs`.
    async fn to_op(&self, group: Group<PreOp>, outputs: &[u8]) -> Group<Op> {
        let group = group.into_safe_op(self.desk.master).await.unwrap();
        let gateway = group.subdevice(self.desk.master, 0).unwrap();
        gateway.outputs_raw_mut()[..outputs.len()].copy_from_slice(outputs);
        group.tx_rx(self.desk.master).await.unwrap();
        let group = group.request_into_op(self.desk.master).await.unwrap();
        while !group.tx_rx(self.desk.master).await.unwrap().all_op() {
            Timer::after_millis(self.setup.cycle_ms).await;
        }
        group
    }

    /// Exchanges process data for `time`.
    async fn cycle_for(&self, group: &Group<Op>, time: Duration) {
        self.cycle_until(group, time, |_| false).await;
    }

    /// Exchanges process data until the inputs are `good`, at most for `limit`; how long that took.
    async fn cycle_until(
        &self,
        group: &Group<Op>,
        limit: Duration,
        good: impl Fn(&[u8]) -> bool,
    ) -> Option<Duration> {
        let begin = Instant::now();
        while begin.elapsed() <= limit {
            group.tx_rx(self.desk.master).await.unwrap();
            if good(&group.subdevice(self.desk.master, 0).unwrap().inputs_raw()) {
                return Some(begin.elapsed());
            }
            Timer::after_millis(self.setup.cycle_ms).await;
        }
        None
    }

    fn put(&self, group: &Group<Op>, outputs: &[u8]) {
        let gateway = group.subdevice(self.desk.master, 0).unwrap();
        gateway.outputs_raw_mut()[..outputs.len()].copy_from_slice(outputs);
    }

    fn input_image(&self) -> Vec<u8> {
        self.virtuals.iter().flat_map(|device| device.input_image.clone()).collect()
    }

    fn output_image(&self) -> Vec<u8> {
        self.virtuals.iter().flat_map(|device| device.output_image.clone()).collect()
    }

    /// Requests that any device has seen.
    fn requests(&self) -> u64 {
        self.devices.iter().map(|device| device.counters().all_requests()).sum()
    }

    /// Requests by which any device was written to.
    fn writes(&self) -> usize {
        self.devices.iter().map(|device| device.writes().len()).sum()
    }
}

#[test]
fn the_four_devices_are_configured_by_sdo_and_every_byte_is_that_of_the_vectors() {
    with_devices(SETUP, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        assert_eq!(bench.requests(), 0, "there is no traffic before");
        bench.configure(&group).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 1).await.unwrap(), 0);
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 2).await.unwrap(), 1);
        for (device, index) in bench.virtuals.iter().zip(0x2011..) {
            for (expected, sub) in device.layout.into_iter().zip(1..) {
                assert_eq!(gateway.sdo_read::<u16>(index, sub).await.unwrap(), expected);
            }
        }
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, Duration::from_secs(1)).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        let (image, length) = (bench.input_image(), bench.input_image().len());
        assert_eq!(gateway.inputs_raw()[..length], image);
        assert_eq!(gateway.inputs_raw()[length..], vec![0; 120 - length]);
        assert_eq!(bench.writes(), 2 * 4, "each kind of output was written once");
    });
}

/// Bytes that a kind's cells take; the first two kinds are bits.
fn bytes(kind: usize, cells: u16) -> usize {
    usize::from(if kind < 2 { cells.div_ceil(8) } else { 2 * cells })
}

/// The time that each exchange of a round takes on the wire, without the silence behind it: reads of everything, and writes of
/// everything that can be written.
fn exchanges(setup: Setup) -> (Vec<Duration>, Vec<Duration>) {
    let line = LineSettings { baud: setup.baud, ..LineSettings::DEFAULT };
    let time = |chars: usize| line.chars(chars) + 2 * line.t3_5() + TURNAROUND;
    let kinds = virtual_devices().into_iter().flat_map(|device| device.ranges.into_iter().enumerate());
    let kinds: Vec<_> = kinds.map(|(kind, (cells, _))| (kind, bytes(kind, cells))).collect();
    let reads = kinds.iter().map(|(_, bytes)| time(8 + 5 + bytes));
    let writes = kinds.iter().filter(|(kind, _)| matches!(kind, 0 | 3)).map(|(_, bytes)| time(9 + bytes + 8));
    (reads.collect(), writes.collect())
}

fn sum(times: &[Duration]) -> Duration {
    times.iter().fold(Duration::from_ticks(0), |sum, time| sum + *time)
}

/// Changes values on both sides at random times; every change is seen in time.
fn exchange(setup: Setup) {
    let (reads, writes) = exchanges(setup);
    let most = Duration::from_millis(setup.polling_ms.into()).max(sum(&reads));
    // What changes while it is read is in the answer of the next poll.
    let answer = *reads.iter().max().unwrap();
    // Until the MainDevice sends or fetches, and until the SubDevice has put inputs there: two cycles.
    let slack = Duration::from_millis(2 * setup.cycle_ms);
    with_devices(setup, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        let image = bench.input_image();
        // A round to read, the writes that follow it, and a round to read back.
        let back = 2 * most + sum(&writes) + slack;
        let seen = bench.cycle_until(&group, back, |inputs| inputs[..image.len()] == image).await;
        assert!(seen.is_some(), "{setup:?}: what is written is read back within {} ms", back.as_millis());

        let mut random = Random::new(setup.baud.into());
        for value in 0..10_u16 {
            bench.cycle_for(&group, MS * random.within(0..=200) as u32).await;
            let nth = random.index(4);
            let (device, layout) = (&bench.virtuals[nth], bench.virtuals[nth].layout);
            let register = usize::from(device.ranges[2].1);
            bench.devices[nth].memory().input[register] = 0x1200 + value;
            let place = usize::from(layout[3]);
            let expected = (0x1200 + value).to_be_bytes();
            let limit = most + answer + slack;
            let seen = bench.cycle_until(&group, limit, |inputs| inputs[place..place + 2] == expected).await;
            assert!(seen.is_some(), "{setup:?}: an input within {} ms", limit.as_millis());

            let (from, place) = (usize::from(layout[8]), usize::from(layout[4]));
            let mut outputs = bench.output_image();
            outputs[from..from + 2].copy_from_slice(&expected);
            bench.put(&group, &outputs);
            let seen = bench.cycle_until(&group, back, |inputs| inputs[place..place + 2] == expected).await;
            assert!(seen.is_some(), "{setup:?}: read back within {} ms", back.as_millis());
        }
    });
}

#[test]
fn a_round_takes_the_time_that_the_source_measured() {
    let round = |baud| sum(&exchanges(Setup { baud, ..SETUP }).0).as_millis();
    assert_eq!(round(4_800), 937);
    assert!((95..=105).contains(&round(115_200)));
}

#[test]
fn changes_are_seen_within_the_polling_time_or_a_round_and_read_back_a_round_later() {
    for (baud, polling_ms, cycle_ms) in [
        (4_800, 1, 1),
        (4_800, 1_000, 4),
        (19_200, 1, 4),
        (19_200, 1_000, 1),
        (115_200, 1, 1),
        (115_200, 10, 2),
        (115_200, 1_000, 4),
    ] {
        exchange(Setup { baud, polling_ms, cycle_ms, ..SETUP });
    }
}

#[test]
fn while_the_flag_is_reset_there_is_no_traffic_and_the_buffers_keep_their_values() {
    with_devices(SETUP, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 1_000 * MS).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        gateway.sdo_write(0x2005, 2, 0_u16).await.unwrap();
        // What is on the wire comes to its end.
        bench.cycle_for(&group, 20 * MS).await;
        let before = bench.requests();
        bench.cycle_for(&group, 1_000 * MS).await;
        assert_eq!(bench.requests(), before);
        let image = bench.input_image();
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[..image.len()], image);
        gateway.sdo_write(0x2000, 1, 1_u16).await.unwrap();
        gateway.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        bench.cycle_for(&group, 1_000 * MS).await;
        let first = &bench.virtuals[0].input_image;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[..first.len()], *first);
        assert_eq!(gateway.inputs_raw()[first.len()..], vec![0; 120 - first.len()], "one device only");
    });
}

/// Leaves Op with the outputs of the vectors in force; somebody changes a register at the device. What the register holds later.
fn after_loss(on_loss: &'static str) -> u16 {
    let mut found = 0;
    with_devices(Setup { on_loss, ..SETUP }, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 1_000 * MS).await;
        assert_eq!(bench.devices[0].memory().holding[40_010], 10);
        group.into_safe_op(bench.desk.master).await.unwrap();
        bench.devices[0].memory().holding[40_010] = 99;
        Timer::after_secs(1).await;
        found = bench.devices[0].memory().holding[40_010];
    });
    found
}

#[test]
fn when_op_is_left_outputs_are_held_cleared_or_not_written_any_more() {
    assert_eq!(after_loss("hold"), 10);
    assert_eq!(after_loss("clear"), 0);
    assert_eq!(after_loss("stop"), 99);
}

#[test]
fn outputs_have_no_effect_before_op() {
    with_devices(SETUP, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = group.into_safe_op(bench.desk.master).await.unwrap();
        group.subdevice(bench.desk.master, 0).unwrap().outputs_raw_mut()[0] = 0xff;
        for _ in 0..200 {
            group.tx_rx(bench.desk.master).await.unwrap();
            Timer::after_millis(5).await;
        }
        assert!(bench.requests() > 0);
        assert_eq!(bench.writes(), 0);
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[3], 7, "inputs come in SafeOp");
    });
}

#[test]
fn the_master_sees_which_device_is_well_and_the_others_go_on() {
    with_devices(SETUP, async |bench| {
        bench.devices[1].set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        let group = bench.desk.to_pre_op().await.unwrap();
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u32>(0x2180, 2).await.unwrap(), u32::MAX, "never heard of");
        for (pdo, sub) in [(0x1a00_u16, 1), (0x1a03, 2)] {
            gateway.sdo_write(0x1c13, 0, 0_u8).await.unwrap();
            gateway.sdo_write(0x1c13, sub, pdo).await.unwrap();
        }
        gateway.sdo_write(0x1c13, 0, 2_u8).await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 5_000 * MS).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[120..], [1, 2, 1, 1], "the status bytes behind the inputs");
        let health = async |nth: u16| gateway.sdo_read::<u8>(0x2180 + nth, 1).await.unwrap();
        assert_eq!([health(0).await, health(1).await, health(2).await, health(3).await], [1, 2, 1, 1]);
        assert_eq!(gateway.sdo_read::<u8>(0x2181, 4).await.unwrap(), 5, "no answer");
        assert_eq!(gateway.sdo_read::<u32>(0x2181, 6).await.unwrap(), 0);
        assert!(gateway.sdo_read::<u32>(0x2181, 8).await.unwrap() >= 3);
        assert!(gateway.sdo_read::<u32>(0x2182, 2).await.unwrap() < 200, "heard of lately");
        let (third, from) = (&bench.virtuals[2].input_image, usize::from(bench.virtuals[2].layout[0]));
        assert_eq!(gateway.inputs_raw()[from..from + third.len()], *third);
    });
}

#[test]
fn a_device_that_is_to_be_checked_is_asked_for_a_sign_of_life_before_each_poll() {
    with_devices(Setup { polling_ms: 250, ..SETUP }, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        gateway.sdo_write(0x2007, 3, 1_u8).await.unwrap();
        bench.configure(&group).await;
        Timer::after_secs(2).await;
        let checks = |nth: usize| bench.devices[nth].counters().requests[8];
        let polls = bench.devices[2].counters().requests[1];
        assert!(polls >= 7 && checks(2).abs_diff(polls) <= 1, "{} checks, {polls} polls", checks(2));
        assert_eq!([checks(0), checks(1), checks(3)], [0; 3]);
    });
}
