//! ethercrab with distributed clocks, and a SubDevice on a LAN9252 that follows SYNC0.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::digital::Wait;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::lan9252::{Lan9252 as Driver, Wiring};
use ethercat_subdevice::sub_device::SubDevice;
use ethercrab::DcSync;
use ethercrab::error::Error;
use ethercrab::subdevice_group::{DcConfiguration, HasDc, Op};
use mobgate_world::World;

use super::start::{CYCLE, FRAME_TIME};
use super::{Clocked, Dispatcher, Exchanged, cable, image, line_of, note_pulses, sequence, with_master};
use crate::Lan9252;
use crate::bench::Shared;
use crate::lan9252::{Timing, Traffic};

/// From the configuration to the first pulse.
const START_DELAY: std::time::Duration = std::time::Duration::from_millis(20);

/// Cycles with the first image before Op is requested, and once it is reached.
const SETTLING_CYCLES: usize = 10;

/// How a device is run by distributed clocks.
#[derive(Debug, Clone, Copy)]
pub struct StepSetup {
    /// The cycle of SYNC0 and of the frames.
    pub cycle: Duration,
    /// When frames are sent, from SYNC0 on.
    pub shift: Duration,
    /// The SPI clock.
    pub spi_hz: u32,
    /// The processor's time to note an interrupt, and its share of a chip select.
    pub processor_ns: u32,
    /// Number of cycles.
    pub cycles: u64,
    /// SDOs are read meanwhile, one after another.
    pub with_mail: bool,
}

impl StepSetup {
    /// On a board with an H743, and SPI at 30 MHz: its processor takes 6 us for a chip select (boards/stm32), and as long is taken for
    /// an interrupt here.
    pub const fn h743(cycle_us: u64, shift_us: u64, cycles: u64) -> Self {
        Self {
            cycle: Duration::from_micros(cycle_us),
            shift: Duration::from_micros(shift_us),
            spi_hz: 30_000_000,
            processor_ns: 6_000,
            cycles,
            with_mail: false,
        }
    }
}

/// How that went.
#[derive(Debug, Clone)]
pub struct InStep {
    /// What became of the images.
    pub exchanged: Exchanged,
    /// From SYNC0 to outputs that take effect, at least and at most, in nanoseconds.
    pub outputs_ns: (u64, u64),
    /// Greatest age of inputs when a frame fetched them.
    pub input_age: Duration,
    /// Usual and greatest cost of a cycle on the SPI.
    pub traffic: (Traffic, Traffic),
    /// SDOs that were answered.
    pub mails: u64,
}

impl InStep {
    /// By how much the times from SYNC0 to outputs differ.
    pub const fn jitter_ns(&self) -> u64 {
        self.outputs_ns.1 - self.outputs_ns.0
    }

    /// Images that were lost, torn or not exchanged.
    pub const fn bad(&self) -> u64 {
        self.exchanged.short + self.exchanged.lost + self.exchanged.wrong
    }
}

/// A group in Op by distributed clocks.
pub type StepGroup = ethercrab::SubDeviceGroup<2, 2048, ethercrab::DefaultLock, Op, HasDc>;

/// Brings the device to Op by distributed clocks, with the image 1 as outputs and frames `shift` behind SYNC0.
///
/// # Errors
/// Errors of the MainDevice.
pub async fn in_step(
    dispatcher: &Dispatcher<'_>,
    cycle: Duration,
    shift: Duration,
    sync: DcSync,
) -> Result<StepGroup, Error> {
    let mut group = dispatcher.to_pre_op().await?;
    for mut sub_device in group.iter_mut(dispatcher.master) {
        sub_device.set_dc_sync(sync);
    }
    let clocks = DcConfiguration {
        start_delay: START_DELAY,
        sync0_period: std::time::Duration::from_micros(cycle.as_micros()),
        sync0_shift: std::time::Duration::from_micros(shift.as_micros()),
    };
    let group = group.into_pre_op_pdi(dispatcher.master).await?;
    let group = group.configure_dc_sync(dispatcher.master, clocks).await?;
    let group = group.into_safe_op(dispatcher.master).await?;
    let outputs = group.subdevice(dispatcher.master, 0)?.outputs_raw().len();
    group.subdevice(dispatcher.master, 0)?.outputs_raw_mut().copy_from_slice(&image(1, outputs));
    // Frames come in step before Op is requested, as a MainDevice of drives sends them.
    for _ in 0..SETTLING_CYCLES {
        pace(group.tx_rx_dc(dispatcher.master).await?.extra.next_cycle_wait).await;
    }
    let group = group.request_into_op(dispatcher.master).await?;
    loop {
        let response = group.tx_rx_dc(dispatcher.master).await?;
        pace(response.extra.next_cycle_wait).await;
        if response.all_op() {
            break;
        }
    }
    // The change of the state takes the SPI longer than a short cycle.
    for _ in 0..SETTLING_CYCLES {
        pace(group.tx_rx_dc(dispatcher.master).await?.extra.next_cycle_wait).await;
    }
    Ok(group)
}

async fn pace(wait: std::time::Duration) {
    Timer::after_micros(wait.as_micros() as u64).await;
}

/// Exchanges images with `device` on a LAN9252 by distributed clocks.
///
/// # Errors
/// Errors of the MainDevice.
pub fn exchange_in_step(device: &'static Device, setup: StepSetup) -> Result<InStep, Error> {
    let mut world = World::new(1);
    let line = line_of(device);
    let chip = line.borrow().chip(0);
    let application = Shared::new(Clocked::new(chip.clone()));
    let timing =
        Timing { spi_hz: setup.spi_hz.into(), select_nanos: setup.processor_ns.into(), ..Timing::USUAL };
    let latency = Duration::from_nanos(setup.processor_ns.into());
    let signals = note_pulses(&world, &chip, latency);
    let lan9252 = Lan9252::new(chip, timing);
    let wiring = Wiring { spi_hz: setup.spi_hz, select_ns: setup.processor_ns, ..Wiring::default() };
    let driver = Driver::new(lan9252.spi(), wiring);
    let mut sub_device = SubDevice::new(device, driver, application.clone()).with_sync(Some(signals));
    let mut interrupt = lan9252.interrupt();
    world.spawn(async move {
        let attention = async || {
            interrupt.wait_for_high().await.expect("the simulated line cannot fail");
            Timer::after(latency).await;
        };
        sub_device.run(attention).await
    });
    let mut result = with_master(&mut world, cable(line), async |dispatcher| {
        let group = in_step(&dispatcher, setup.cycle, setup.shift, DcSync::Sync0).await?;
        cycles(&dispatcher, &group, &lan9252, setup).await
    })?;
    lan9252.check();
    let application = application.0.borrow();
    result.exchanged.add_seen_by(&application.echo, setup.cycles);
    let after = application.after_pulse.iter().copied();
    result.outputs_ns = (after.clone().min().unwrap_or(0), after.max().unwrap_or(0));
    Ok(result)
}

async fn cycles(
    dispatcher: &Dispatcher<'_>,
    group: &StepGroup,
    lan9252: &Lan9252,
    setup: StepSetup,
) -> Result<InStep, Error> {
    let mut exchanged = Exchanged::default();
    let (mut age, mut traffic, mut mails) = (Duration::MIN, Vec::new(), 0);
    let cyclic = async {
        for number in 2..setup.cycles + 2 {
            {
                let sub_device = group.subdevice(dispatcher.master, 0)?;
                let bytes = sub_device.outputs_raw().len();
                sub_device.outputs_raw_mut().copy_from_slice(&image(number, bytes));
            }
            lan9252.take_traffic();
            let response = group.tx_rx_dc(dispatcher.master).await?;
            let fetched = Instant::now() - FRAME_TIME / 2;
            let sampled = sequence(&group.subdevice(dispatcher.master, 0)?.inputs_raw());
            let sampled = sampled.map(Instant::from_micros);
            exchanged.short += u64::from(response.working_counter != 3);
            exchanged.wrong += u64::from(sampled.is_none());
            age = age.max(sampled.map_or(Duration::MIN, |sampled| fetched - sampled));
            pace(response.extra.next_cycle_wait).await;
            traffic.push(lan9252.take_traffic());
        }
        // The last image takes effect with the next pulse.
        Timer::after(setup.cycle * 2 + CYCLE).await;
        Ok::<(), Error>(())
    };
    let mail = async {
        loop {
            if setup.with_mail && reads_object(dispatcher, group).await {
                mails += 1;
            } else {
                Timer::after(CYCLE).await;
            }
        }
    };
    match select(cyclic, mail).await {
        Either::First(outcome) => outcome?,
        Either::Second(never) => never,
    }
    traffic.sort_unstable_by_key(|one| (one.bytes, one.selects));
    let at = |part: usize| traffic.get(part).copied().unwrap_or_default();
    let traffic = (at(traffic.len() / 2), at(traffic.len().saturating_sub(1)));
    Ok(InStep { exchanged, outputs_ns: (0, 0), input_age: age, traffic, mails })
}

async fn reads_object(dispatcher: &Dispatcher<'_>, group: &StepGroup) -> bool {
    let Ok(sub_device) = group.subdevice(dispatcher.master, 0) else { return false };
    sub_device.sdo_read::<u32>(0x1018, 1).await.is_ok()
}
