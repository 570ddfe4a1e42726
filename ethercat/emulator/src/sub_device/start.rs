//! ethercrab starts a SubDevice, from Init to Op with the mapping that it discovers, and exchanges images with it.

use std::cell::Cell;
use std::rc::Rc;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::digital::Wait;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::esc::{CycleCost, Esc};
use ethercat_subdevice::lan9252::{Lan9252 as Driver, Wiring};
use ethercat_subdevice::process::{INPUTS_BYTES, OUTPUTS_BYTES};
use ethercat_subdevice::sub_device::SubDevice;
use ethercat_subdevice::sync_manager::Channel;
use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, PreOp, SubDeviceGroup};
use ethercrab::{MainDevice, PduLoop};

use super::{Counted, Echo, Paced, SharedEcho, direct, image, line_of, line_of_kind, sequence, spawn};
use crate::Lan9252;
use crate::cable::{Cable, SharedSegment};
use crate::lan9252::{Timing, Traffic};
use crate::master::{DATA_BYTES, Storage, main_device, pump};
use crate::{Interrupt, Kind, SharedChip};
use mobgate_world::{Random, World};

/// Round trip of a frame.
pub(super) const FRAME_TIME: Duration = Duration::from_micros(50);
/// Until the device has started its chip.
const POWER_ON: Duration = Duration::from_millis(100);
/// Cycle of process data while waiting for Op.
pub(super) const CYCLE: Duration = Duration::from_millis(1);
/// Room for the longest images in both directions.
const GROUP_BYTES: usize = 3072;

/// One device and `BYTES` bytes of process data; ethercrab requires a power of two of devices above one.
pub type Group<S, const BYTES: usize = 2048> = SubDeviceGroup<2, BYTES, ethercrab::DefaultLock, S>;

/// A MainDevice for one SubDevice.
pub struct Dispatcher<'m> {
    /// The MainDevice.
    pub master: &'m MainDevice<'m>,
    /// Number of frames so far.
    pub frames: Rc<Cell<u64>>,
}

impl Dispatcher<'_> {
    /// From Init to PreOp.
    ///
    /// # Errors
    /// Errors of the MainDevice.
    pub async fn to_pre_op(&self) -> Result<Group<PreOp>, Error> {
        self.to_pre_op_with().await
    }

    /// The same with `BYTES` bytes of process data.
    ///
    /// # Errors
    /// Errors of the MainDevice.
    pub async fn to_pre_op_with<const BYTES: usize>(&self) -> Result<Group<PreOp, BYTES>, Error> {
        self.master.init_single_group(|| Instant::now().as_micros() * 1_000).await
    }

    /// From PreOp to Op, with the image `number` as outputs.
    ///
    /// # Errors
    /// Errors of the MainDevice.
    pub async fn to_op<const BYTES: usize>(
        &self,
        group: Group<PreOp, BYTES>,
        number: u64,
    ) -> Result<Group<Op, BYTES>, Error> {
        let group = group.into_safe_op(self.master).await?;
        let outputs = group.subdevice(self.master, 0)?.outputs_raw().len();
        group.subdevice(self.master, 0)?.outputs_raw_mut().copy_from_slice(&image(number, outputs));
        group.tx_rx(self.master).await?;
        let group = group.request_into_op(self.master).await?;
        while !group.tx_rx(self.master).await?.all_op() {
            Timer::after(CYCLE).await;
        }
        Ok(group)
    }

    /// One cycle with the image `number` as outputs; returns the number of the inputs, unless they are torn, and the working
    /// counter.
    ///
    /// # Errors
    /// Errors of the MainDevice.
    pub async fn exchange<const BYTES: usize>(
        &self,
        group: &Group<Op, BYTES>,
        number: u64,
    ) -> Result<(Option<u64>, u16), Error> {
        let device = group.subdevice(self.master, 0)?;
        let length = device.outputs_raw().len();
        device.outputs_raw_mut().copy_from_slice(&image(number, length));
        let counter = group.tx_rx(self.master).await?.working_counter;
        let inputs = sequence(&device.inputs_raw());
        Ok((inputs, counter))
    }
}

/// A cable without faults in front of `line`.
pub fn cable(line: SharedSegment) -> Cable {
    Cable::new(line, FRAME_TIME)
}

/// Connects a MainDevice to the cable, and runs `script`.
///
/// # Panics
/// If the script waits for something that never happens.
pub fn with_master<T>(
    world: &mut World<'_>,
    cable: Cable,
    script: impl AsyncFnOnce(Dispatcher<'_>) -> T,
) -> T {
    let script = async |dispatcher: Dispatcher<'_>| {
        // The device starts its chip first.
        Timer::after(POWER_ON).await;
        script(dispatcher).await
    };
    world.run_until(at_cable(cable, |pdu_loop| main_device(pdu_loop, 0), script))
}

/// Connects a MainDevice made by `make` to the cable, and runs `script`.
///
/// # Panics
/// Never: it owns its frame storage.
pub async fn at_cable<T>(
    cable: Cable,
    make: impl FnOnce(PduLoop<'_>) -> MainDevice<'_>,
    script: impl AsyncFnOnce(Dispatcher<'_>) -> T,
) -> T {
    let storage = Storage::new();
    let (tx, rx, pdu_loop) = storage.try_split().expect("it was not split before");
    let frames = cable.frames();
    let master = make(pdu_loop);
    match select(pump(tx, rx, cable), script(Dispatcher { master: &master, frames })).await {
        Either::First(never) => match never {},
        Either::Second(outcome) => outcome,
    }
}

/// The cost of a start-up.
#[derive(Debug, Clone, Copy)]
pub struct StartUp {
    /// From the first frame until Op was seen.
    pub time: Duration,
    /// Mailbox requests answered.
    pub round_trips: u64,
    /// Frames.
    pub frames: u64,
}

/// Starts `device`; `reach` makes the access to its chip.
///
/// # Errors
/// Errors of the MainDevice.
pub fn start_up<E: Esc + 'static>(
    device: &'static Device,
    reach: impl FnOnce(SharedChip) -> (E, Interrupt),
) -> Result<StartUp, Error> {
    let mut world = World::new(1);
    let line = line_of(device);
    let (esc, interrupt) = reach(line.borrow().chip(0));
    let esc = Counted::new(esc, device.memory.start(Channel::MailboxOut));
    let counts = esc.counts();
    spawn(&world, SubDevice::new(device, esc, SharedEcho::default()), interrupt);
    with_master(&mut world, cable(line), async |dispatcher| {
        let begin = Instant::now();
        let group = dispatcher.to_pre_op().await?;
        dispatcher.to_op(group, 1).await?;
        let (round_trips, frames) = (counts.watched.get(), dispatcher.frames.get());
        Ok(StartUp { time: begin.elapsed(), round_trips, frames })
    })
}

/// Cost of cycles on the SPI.
#[derive(Debug, Clone, Copy)]
pub struct SpiCost {
    /// The 90th percentile.
    pub usual: Traffic,
    /// The maximum.
    pub worst: Traffic,
}

/// The SPI cost of a process data cycle in Op on a LAN9252, with inputs written after each outputs: the SubDevice as boards run it,
/// which also reads events. `proves` as in [`Application::proves_outputs`].
///
/// [`Application::proves_outputs`]: ethercat_subdevice::application::Application::proves_outputs
///
/// # Errors
/// Errors of the MainDevice.
pub fn spi_traffic(device: &'static Device, cycles: u64, proves: bool) -> Result<SpiCost, Error> {
    let mut world = World::new(1);
    let line = line_of(device);
    let echo = SharedEcho::default();
    echo.0.borrow_mut().proves = proves;
    let chip = Lan9252::new(line.borrow().chip(0), Timing::USUAL);
    let esc = Driver::new(chip.spi(), Wiring::default());
    spawn(&world, SubDevice::new(device, esc, echo), chip.interrupt());
    with_master(&mut world, cable(line), async |dispatcher| {
        let group = dispatcher.to_pre_op().await?;
        let sub_device = group.subdevice(dispatcher.master, 0)?;
        sub_device.sdo_write(0x1c32, 1, 0x01_u16).await?;
        sub_device.sdo_write(0x1c33, 1, 0x22_u16).await?;
        let group = dispatcher.to_op(group, 1).await?;
        Timer::after(CYCLE).await;
        chip.take_traffic();
        let mut seen = Vec::new();
        for number in 2..cycles + 2 {
            dispatcher.exchange(&group, number).await?;
            Timer::after(CYCLE).await;
            seen.push(chip.take_traffic());
        }
        let sorted = |part: fn(&Traffic) -> u64| {
            let mut sorted: Vec<u64> = seen.iter().map(part).collect();
            sorted.sort_unstable();
            sorted
        };
        let (bytes, selects) = (sorted(|one| one.bytes), sorted(|one| one.selects));
        let at = |nth: usize| Traffic { bytes: bytes[nth], selects: selects[nth] };
        Ok(SpiCost { usual: at(seen.len() * 9 / 10), worst: at(seen.len() - 1) })
    })
}

/// Results of an exchange over SPI at the shortest cycle.
#[derive(Debug, Clone, Copy)]
pub struct AtPace {
    /// Cost of a cycle.
    pub cost: CycleCost,
    /// The shortest cycle without missed images, as the device reports it.
    pub promised_ns: u32,
    /// Results of the images.
    pub exchanged: Exchanged,
    /// Missed outputs, as the device reports them.
    pub missed: u16,
}

/// Results of exchanged images.
#[derive(Debug, Clone, Copy, Default)]
pub struct Exchanged {
    /// Cycles with an unexpected working counter.
    pub short: u64,
    /// Skipped outputs.
    pub lost: u64,
    /// Torn or outdated outputs or inputs.
    pub wrong: u64,
}

impl Exchanged {
    /// Exchanges the images from 2 on in so many cycles, with a `pace` behind each.
    async fn of<const BYTES: usize>(
        dispatcher: &Dispatcher<'_>,
        group: &Group<Op, BYTES>,
        cycles: u64,
        working_counter: u16,
        mut pace: impl FnMut() -> Timer,
    ) -> Result<Self, Error> {
        let (mut exchanged, mut last) = (Self::default(), 0);
        for number in 2..cycles + 2 {
            let (inputs, counter) = dispatcher.exchange(group, number).await?;
            exchanged.short += u64::from(counter != working_counter);
            exchanged.wrong += u64::from(inputs.is_none_or(|inputs| inputs < last));
            last = inputs.unwrap_or(last);
            pace().await;
        }
        Ok(exchanged)
    }

    pub(super) fn add_seen_by(&mut self, echo: &Echo, cycles: u64) {
        // The first image is repeated until Op is reached, and is taken once from SafeOp.
        self.lost = echo.lost + cycles + 1 - echo.last.unwrap_or(0);
        self.wrong += echo.torn;
    }
}

/// Exchanges images with `device` over SPI at `spi_hz`, with a cycle of `percent` of the shortest that it reports.
///
/// # Errors
/// Errors of the MainDevice.
pub fn exchange_at_pace(
    device: &'static Device,
    spi_hz: u32,
    percent: u64,
    cycles: u64,
) -> Result<AtPace, Error> {
    let mut world = World::new(1);
    let line = line_of(device);
    let echo = SharedEcho::default();
    let timing = Timing { spi_hz: spi_hz.into(), ..Timing::USUAL };
    let chip = Lan9252::new(line.borrow().chip(0), timing);
    let wiring = Wiring { spi_hz, select_ns: timing.select_nanos as u32, ..Wiring::default() };
    let mut sub_device = SubDevice::new(device, Driver::new(chip.spi(), wiring), echo.clone());
    let (cost, promised_ns) = (sub_device.cycle_cost(), sub_device.cycle_ns_min());
    let mut interrupt = chip.interrupt();
    let ended = Rc::new(Signal::<NoopRawMutex, ()>::new());
    let end = ended.clone();
    let missed = world.spawn(async move {
        let attention = async || interrupt.wait_for_high().await.expect("the simulated line cannot fail");
        select(sub_device.run(attention), end.wait()).await;
        sub_device.outputs_missed()
    });
    let cycle = Duration::from_micros((u64::from(promised_ns) * percent / 100).div_ceil(1_000));
    let mut exchanged = with_master(&mut world, cable(line), async |dispatcher| {
        let group = dispatcher.to_pre_op().await?;
        let group = dispatcher.to_op(group, 1).await?;
        Timer::after(CYCLE).await;
        let mut next = Instant::now();
        let pace = || {
            next += cycle;
            Timer::at(next)
        };
        let exchanged = Exchanged::of(&dispatcher, &group, cycles, 3, pace).await;
        Timer::after(CYCLE).await;
        exchanged
    })?;
    ended.signal(());
    let missed = world.run_until(missed);
    exchanged.add_seen_by(&echo.0.borrow(), cycles);
    Ok(AtPace { cost, promised_ns, exchanged, missed })
}

/// Exchanges images with `device` in Op, once per millisecond, while its processor works in pieces of random length with random
/// pauses up to `pause_us`.
///
/// # Errors
/// Errors of the MainDevice.
pub fn exchange_images(device: &'static Device, cycles: u64, pause_us: u64) -> Result<Exchanged, Error> {
    exchange_images_on::<OUTPUTS_BYTES, INPUTS_BYTES>(Kind::LAN9252, device, cycles, pause_us)
}

/// The same on another chip, and with a SubDevice with buffers for `OUTPUTS` and `INPUTS` bytes.
///
/// # Errors
/// Errors of the MainDevice.
pub fn exchange_images_on<const OUTPUTS: usize, const INPUTS: usize>(
    kind: Kind,
    device: &'static Device,
    cycles: u64,
    pause_us: u64,
) -> Result<Exchanged, Error> {
    let mut world = World::new(1);
    let line = line_of_kind(kind, device);
    let echo = SharedEcho::default();
    let (esc, interrupt) = direct(line.borrow().chip(0));
    let esc = Paced::new(esc, Random::new(cycles), 0..=pause_us);
    let sub_device = SubDevice::<_, _, OUTPUTS, INPUTS>::with_buffers(device, esc, echo.clone());
    spawn(&world, sub_device, interrupt);
    let mut exchanged = with_master(&mut world, cable(line), async |dispatcher| {
        let group = dispatcher.to_pre_op_with::<GROUP_BYTES>().await?;
        let group = dispatcher.to_op(group, 1).await?;
        let expected = working_counter(device);
        Exchanged::of(&dispatcher, &group, cycles, expected, || Timer::after(CYCLE)).await
    })?;
    exchanged.add_seen_by(&echo.0.borrow(), cycles);
    Ok(exchanged)
}

/// The expected sum of the working counters of ethercrab's process data frames, inputs first.
fn working_counter(device: &Device) -> u16 {
    let inputs = usize::from(device.default_bytes(Channel::Inputs));
    let bytes = inputs + usize::from(device.default_bytes(Channel::Outputs));
    let frames = (0..bytes).step_by(DATA_BYTES);
    frames
        .map(|first| u16::from(first < inputs) + 2 * u16::from((first + DATA_BYTES).min(bytes) > inputs))
        .sum()
}
