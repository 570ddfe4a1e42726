//! What the SubDevice and the port share: a scanner whose memory is the process image, and whether it has anything to ask.
//!
//! The input buffer is the first part of the scanner's values, the output buffer the second: what a device answers is in the
//! next TxPDO, and what an RxPDO brings is compared with what is read next.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use super::configuration::{ConfigError, Configuration, Plan, Speed};
use super::controller::Controller;
use super::layout::{DeviceLayout, DeviceSettings};
use super::objects::{IMAGE_BYTES, MODBUS_DEVICES_MAX};
use crate::config::{OnLoss, Parity, Settings};
use crate::scanner::{
    ByteOrder, Device, DeviceId, DeviceStatus, Full, Reading, Row, Scanner, ScannerPlace, Writing,
};

const BYTES: u16 = IMAGE_BYTES as u16;
/// Where the buffers lie in the scanner's memory.
const INPUTS: u16 = 0;
const OUTPUTS: u16 = BYTES;

/// A gateway's EtherCAT side. Boards keep it in a static; it is all zeros at start.
pub struct EthercatPlace {
    scanner: ScannerPlace,
    state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    /// The devices are others: what was asked before is nobody's question any more. Or the controller has come or gone.
    renewed: Signal<CriticalSectionRawMutex, ()>,
}

#[derive(Clone, Copy)]
struct State {
    /// Whether a port asks the devices.
    has_port: bool,
    /// Whether the line is there that the port is to set.
    has_line: bool,
    on_loss: OnLoss,
    /// Whether a configuration is in use.
    running: bool,
    /// How the serial line is to be set.
    speed: Speed,
    /// The port has not done it yet.
    speed_is_new: bool,
    controller: Controller,
}

impl State {
    /// All zeros, as the rest.
    const NEW: Self = Self {
        has_port: false,
        has_line: false,
        on_loss: OnLoss::Stop,
        running: false,
        speed: Speed { baud: 0, parity: Parity::None, stop_bits: 0 },
        speed_is_new: false,
        controller: Controller::Present,
    };
}

impl EthercatPlace {
    /// Without a configuration.
    pub const fn new() -> Self {
        Self {
            scanner: ScannerPlace::new(),
            state: Mutex::new(Cell::new(State::NEW)),
            renewed: Signal::new(),
        }
    }

    /// Whether a configuration is in use (2005h:02).
    pub fn is_running(&self) -> bool {
        self.state.lock(Cell::get).running
    }

    /// How the Modbus device `nth` is doing, if there is one.
    pub fn device_status(&self, nth: u8) -> Option<DeviceStatus> {
        self.scanner.with(|scanner| scanner.device_status(DeviceId(nth), Instant::now()))
    }

    /// Calls `f` with what was read last.
    pub fn inputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.scanner.with(|scanner| f(scanner.image(INPUTS, BYTES)))
    }

    /// Calls `f` with what is to be written.
    pub fn outputs<R>(&self, f: impl FnOnce(&[u8]) -> R) -> R {
        self.scanner.with(|scanner| f(scanner.image(OUTPUTS, BYTES)))
    }

    /// Uses `configuration` as a whole, with empty buffers, or changes nothing; the devices' layouts.
    pub(super) fn start(
        &self,
        configuration: &Configuration,
    ) -> Result<[DeviceLayout; MODBUS_DEVICES_MAX], ConfigError> {
        let plan = self.check(configuration)?;
        let now = Instant::now();
        self.scanner.change(|scanner| {
            scanner.restart(now);
            let devices = configuration.devices().iter().zip(&plan.layouts);
            // Four devices with one row of each kind, which two buffers have bytes for, are far from every limit.
            let fits = scanner.allocate(2 * BYTES).map(|_| ());
            let fits = fits.and_then(|()| {
                devices.into_iter().try_for_each(|(device, layout)| add(scanner, device, layout, now))
            });
            debug_assert_eq!(fits, Ok(()));
        });
        self.update(|state| (state.running, state.speed, state.speed_is_new) = (true, plan.speed, true));
        self.renewed.signal(());
        Ok(plan.layouts)
    }

    /// Whether `configuration` can be used now.
    pub(super) fn check(&self, configuration: &Configuration) -> Result<Plan, ConfigError> {
        let plan = configuration.plan()?;
        match self.state.lock(Cell::get) {
            State { has_port: false, .. } => Err(ConfigError::NoPort),
            State { has_line: false, .. } => Err(ConfigError::NoLine),
            _ => Ok(plan),
        }
    }

    /// The devices are not asked any more; the buffers stay as they are.
    pub(super) fn stop(&self) {
        self.scanner.change(Scanner::forget_devices);
        self.update(|state| state.running = false);
        self.renewed.signal(());
    }

    /// Takes the outputs of a MainDevice in Op.
    pub(super) fn put_outputs(&self, bytes: &[u8]) {
        self.scanner.with(|scanner| {
            if let Some(place) = scanner.image_mut(OUTPUTS, BYTES).get_mut(..bytes.len()) {
                place.copy_from_slice(bytes);
            }
            scanner.set_outputs(true);
        });
    }

    /// No outputs come any more.
    pub(super) fn outputs_stopped(&self) {
        let on_loss = self.state.lock(Cell::get).on_loss;
        self.scanner.with(|scanner| match on_loss {
            OnLoss::Hold => {}
            OnLoss::Clear => scanner.image_mut(OUTPUTS, BYTES).fill(0),
            OnLoss::Stop => scanner.set_outputs(false),
        });
    }

    /// The scanner, for the port.
    pub fn scanner(&self) -> &ScannerPlace {
        &self.scanner
    }

    /// Whether the board's controller answers.
    pub fn controller(&self) -> Controller {
        self.state.lock(Cell::get).controller
    }

    /// Notes whether the controller answers, for the port and whoever asks.
    pub(super) fn set_controller(&self, controller: Controller) {
        self.update(|state| state.controller = controller);
        self.renewed.signal(());
    }

    /// Waits until the devices are others, or the controller is.
    pub async fn renewed(&self) {
        self.renewed.wait().await;
    }

    /// How the serial line is to be set, once for each configuration that is taken over.
    pub fn take_speed(&self) -> Option<Speed> {
        let State { speed, speed_is_new, .. } = self.state.lock(Cell::get);
        self.update(|state| state.speed_is_new = false);
        speed_is_new.then_some(speed)
    }

    /// Follows `settings`: without a port that asks the devices, no configuration can be in use.
    pub fn follow(&self, settings: &Settings) {
        let port = settings.ethercat();
        let sets_none = port.is_some_and(|port| port.line.is_none());
        self.update(|state| {
            state.has_port = port.is_some();
            state.has_line = sets_none || settings.ethercat_line().is_some();
            state.on_loss = port.map(|port| port.on_loss).unwrap_or_default();
        });
        if port.is_none() && self.is_running() {
            self.stop();
        }
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        self.state.lock(|cell| {
            let mut state = cell.get();
            change(&mut state);
            cell.set(state);
        });
    }
}

impl Default for EthercatPlace {
    fn default() -> Self {
        Self::new()
    }
}

/// Lets `scanner` read `device` into its part of the input buffer, and write from its part of the output buffer.
fn add(
    scanner: &mut Scanner,
    device: &DeviceSettings,
    layout: &DeviceLayout,
    now: Instant,
) -> Result<(), Full> {
    // The table allows no id that is not a byte.
    let unit = device.id as u8;
    let id = scanner.add_device(Device { unit, order: ByteOrder::default(), check: device.check })?;
    for (kind, settings) in device.kinds().filter(|(_, settings)| settings.count > 0) {
        let input = INPUTS + layout.input(kind);
        let output = layout.output(kind);
        let range = Row {
            device: Some(id),
            kind,
            first: settings.address,
            count: settings.count,
            input,
            output: output.map_or(input, |output| OUTPUTS + output),
            read: Reading::Every(device.polling_ms),
            write: if output.is_some() { Writing::OnChange } else { Writing::Never },
            multiple: false,
            wide: false,
            of: None,
            quality: None,
        };
        scanner.add_range(range, now)?;
    }
    Ok(())
}
