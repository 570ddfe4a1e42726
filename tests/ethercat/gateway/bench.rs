//! The virtual devices on a wire, the gateway between, and ethercrab as its MainDevice, all in virtual time.

use embassy_time::{Duration, Instant, Timer};
use ethercat_subdevice::device::Device as Description;
use ethercat_subdevice::sub_device::SubDevice;
use ethercrab::subdevice_group::{Op, PreOp};
use mobgate::fieldbus::{DEVICE, EthercatState, GatewayObjects, LongSubDevice, device, long_device};
use mobgate::gateway::Gateway;
use mobgate::settings::LineSettings;
use mobgate_simulator::device::serve;
use mobgate_simulator::esc::{Kind, SharedSegment};
use mobgate_simulator::rig::{Rig, Size, with_gateway_on};
use mobgate_simulator::sub_device::{
    Dispatcher, Group, cable, direct, line_of, line_of_kind, spawn, with_master,
};
use mobgate_simulator::world::Clock;
use mobgate_simulator::{Device, World};

use super::virtual_devices::{Virtual, virtual_devices};

static GATEWAY: Description = DEVICE;
/// What makes the gateway a modular device.
const MODULES: &str = " modules";

/// What is set at the gateway and at the MainDevice.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setup {
    pub(crate) baud: u32,
    pub(crate) polling_ms: u32,
    pub(crate) cycle_ms: u64,
    pub(crate) on_loss: &'static str,
}

pub(crate) const MS: Duration = Duration::from_millis(1);
/// A line's time-out by default.
const LATE_WINDOW: Duration = Duration::from_secs(1);
/// Of the simulated devices.
pub(crate) const TURNAROUND: Duration = MS;
pub(crate) const SETUP: Setup = Setup { baud: 115_200, polling_ms: 100, cycle_ms: 2, on_loss: "stop" };

/// Of the gateway, in every test here.
fn size() -> Size {
    Size { rests: Duration::from_millis(1), ..Size::default() }
}

/// What a script works with.
pub(crate) struct Bench<'m> {
    pub(crate) dispatcher: Dispatcher<'m>,
    pub(crate) setup: Setup,
    pub(crate) virtuals: Vec<Virtual>,
    pub(crate) devices: Vec<Device>,
}

/// The virtual devices on a wire, the gateway, and a MainDevice that does as `script` says.
pub(crate) fn with_devices(setup: Setup, script: impl AsyncFnOnce(Bench<'_>)) {
    let segment = line_of(&GATEWAY);
    with_gateway_and_devices(Clock::Virtual, setup, &segment, |world, virtuals, devices| {
        let cable = cable(segment.clone());
        with_master(world, cable, async |dispatcher| {
            script(Bench { dispatcher, setup, virtuals, devices }).await
        });
    });
}

/// The virtual devices on a wire, and the gateway as the SubDevice of `segment`.
pub(crate) fn with_gateway_and_devices(
    clock: Clock,
    setup: Setup,
    segment: &SharedSegment,
    scenario: impl FnOnce(&mut World<'_>, Vec<Virtual>, Vec<Device>),
) {
    let virtuals = virtual_devices();
    let devices: Vec<Device> = virtuals.iter().map(Virtual::device).collect();
    let settings = format!(
        "port bus serial uart1 rtu client 9600 8N1 timeout 1s
        port ecat ethercat line bus on-loss {}
        route ecat 1-247 * * bus",
        setup.on_loss
    );
    with_gateway_of(clock, setup.baud, &settings, devices.clone(), segment, |world, _| {
        scenario(world, virtuals, devices);
    });
}

/// `devices` on the wire `uart1` of a gateway with `settings`, and a MainDevice that does as `script` says.
pub(crate) fn with_wire(
    baud: u32,
    settings: &str,
    devices: Vec<Device>,
    script: impl AsyncFnOnce(Dispatcher<'_>, &Gateway<'_>),
) {
    with_rig(baud, settings, devices, async |dispatcher, rig| script(dispatcher, rig.gateway).await);
}

/// The same for a script that needs more than the gateway.
pub(crate) fn with_rig(
    baud: u32,
    settings: &str,
    devices: Vec<Device>,
    script: impl AsyncFnOnce(Dispatcher<'_>, &Rig<'_>),
) {
    let segment = line_of(device(settings.contains(MODULES)));
    with_gateway_of(Clock::Virtual, baud, settings, devices, &segment, |world, rig| {
        with_master(world, cable(segment.clone()), async |dispatcher| script(dispatcher, rig).await);
    });
}

/// [`with_wire`] with long images, behind a controller of this kind.
pub(crate) fn with_long_wire(
    kind: Kind,
    baud: u32,
    settings: &str,
    devices: Vec<Device>,
    script: impl AsyncFnOnce(Dispatcher<'_>, &Gateway<'_>),
) {
    let device = long_device(settings.contains(MODULES), false);
    let segment = line_of_kind(kind, device);
    let size = Size { ethercat: EthercatState::long, ..size() };
    with_gateway_on(Clock::Virtual, size, 1, settings, |world, rig| {
        serve_devices(world, rig, baud, devices);
        let (esc, interrupt) = direct(segment.borrow().chip(0));
        let objects = objects_of(rig.gateway);
        spawn(world, LongSubDevice::with_buffers(device, esc, objects), interrupt);
        with_master(world, cable(segment.clone()), async |dispatcher| script(dispatcher, rig.gateway).await);
    });
}

/// The gateway's objects, as its settings want them.
fn objects_of<'g>(gateway: &'g Gateway<'_>) -> GatewayObjects<'g> {
    let place = gateway.ethercat().unwrap();
    if gateway.ethercat_modules() { GatewayObjects::modular(place) } else { GatewayObjects::new(place) }
}

/// The devices respond on the wire.
fn serve_devices(world: &World<'_>, rig: &Rig<'_>, baud: u32, devices: Vec<Device>) {
    // The line may have another speed and format until the MainDevice sets it.
    let line = LineSettings { baud, ..LineSettings::DEFAULT };
    world.spawn(serve(rig.wire("uart1").tap(line), devices));
}

/// `devices` on the wire `uart1` of a gateway with `settings`, the SubDevice of `segment`.
fn with_gateway_of(
    clock: Clock,
    baud: u32,
    settings: &str,
    devices: Vec<Device>,
    segment: &SharedSegment,
    scenario: impl FnOnce(&mut World<'_>, &Rig<'_>),
) {
    with_gateway_on(clock, size(), 1, settings, |world, rig| {
        serve_devices(world, rig, baud, devices);
        let (esc, interrupt) = direct(segment.borrow().chip(0));
        let objects = objects_of(rig.gateway).with_points(rig.gateway.scanner());
        spawn(world, SubDevice::new(device(rig.gateway.ethercat_modules()), esc, objects), interrupt);
        scenario(world, rig);
    });
}

/// To Op, with `outputs`, by a frame each `cycle`.
pub(crate) async fn to_op<const BYTES: usize>(
    dispatcher: &Dispatcher<'_>,
    group: Group<PreOp, BYTES>,
    outputs: &[u8],
    cycle: Duration,
) -> Group<Op, BYTES> {
    let group = group.into_safe_op(dispatcher.master).await.unwrap();
    let gateway = group.subdevice(dispatcher.master, 0).unwrap();
    gateway.outputs_raw_mut()[..outputs.len()].copy_from_slice(outputs);
    group.tx_rx(dispatcher.master).await.unwrap();
    let group = group.request_into_op(dispatcher.master).await.unwrap();
    while !group.tx_rx(dispatcher.master).await.unwrap().all_op() {
        Timer::after(cycle).await;
    }
    group
}

/// Exchanges process data for `time`, by a frame each `cycle`.
pub(crate) async fn cycle_for<const BYTES: usize>(
    dispatcher: &Dispatcher<'_>,
    group: &Group<Op, BYTES>,
    time: Duration,
    cycle: Duration,
) {
    let begin = Instant::now();
    while begin.elapsed() < time {
        group.tx_rx(dispatcher.master).await.unwrap();
        Timer::after(cycle).await;
    }
}

impl Bench<'_> {
    /// Writes the configuration of all devices, and has it taken over.
    pub(crate) async fn configure(&self, group: &Group<PreOp>) {
        let gateway = group.subdevice(self.dispatcher.master, 0).unwrap();
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
        // The line was opened anew: what comes for as long as a response may be late is discarded, and nothing is asked.
        Timer::after(LATE_WINDOW).await;
    }

    /// To Op, with `outputs`.
    pub(crate) async fn to_op(&self, group: Group<PreOp>, outputs: &[u8]) -> Group<Op> {
        to_op(&self.dispatcher, group, outputs, Duration::from_millis(self.setup.cycle_ms)).await
    }

    /// Exchanges process data for `time`.
    pub(crate) async fn cycle_for(&self, group: &Group<Op>, time: Duration) {
        self.cycle_until(group, time, |_| false).await;
    }

    /// Exchanges process data until the inputs are `good`, at most for `limit`; how long that took.
    pub(crate) async fn cycle_until(
        &self,
        group: &Group<Op>,
        limit: Duration,
        good: impl Fn(&[u8]) -> bool,
    ) -> Option<Duration> {
        let begin = Instant::now();
        while begin.elapsed() <= limit {
            group.tx_rx(self.dispatcher.master).await.unwrap();
            if good(&group.subdevice(self.dispatcher.master, 0).unwrap().inputs_raw()) {
                return Some(begin.elapsed());
            }
            Timer::after_millis(self.setup.cycle_ms).await;
        }
        None
    }

    pub(crate) fn put(&self, group: &Group<Op>, outputs: &[u8]) {
        let gateway = group.subdevice(self.dispatcher.master, 0).unwrap();
        gateway.outputs_raw_mut()[..outputs.len()].copy_from_slice(outputs);
    }

    pub(crate) fn input_image(&self) -> Vec<u8> {
        self.virtuals.iter().flat_map(|device| device.input_image.clone()).collect()
    }

    pub(crate) fn output_image(&self) -> Vec<u8> {
        self.virtuals.iter().flat_map(|device| device.output_image.clone()).collect()
    }

    /// Requests that any device has seen.
    pub(crate) fn requests(&self) -> u64 {
        self.devices.iter().map(|device| device.counters().all_requests()).sum()
    }

    /// Requests by which any device was written to.
    pub(crate) fn writes(&self) -> usize {
        self.devices.iter().map(|device| device.writes().len()).sum()
    }
}
