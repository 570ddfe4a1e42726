//! State shared by the SubDevice and the port: a scanner whose memory is the process image, and what it polls.
//!
//! The scanner's values are the input buffer, followed by the output buffer: a device's response is in the next TxPDO, and the data
//! of an RxPDO are compared with the next read.

use core::cell::{Cell, RefCell};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;
use ethercat_subdevice::al_state::{AlState, AlStatusCode};
use ethercat_subdevice::application::Address;
use ethercat_subdevice::coe::abort::Abort;
use ethercat_subdevice::diagnosis::History;

use super::chip::Controller;
use super::config_error::ConfigError;
use super::configuration::Configuration;
use super::keeping::Keeping;
use super::layout::{DeviceLayout, layouts};
use super::line::{LineWriter, Speed};
use super::ranges::add;
use super::request::Requests;
use super::room::Room;
use super::texts::SharedHistory;
use crate::scanner::{DeviceId, DeviceStatus, Scanner, ScannerState};
use crate::settings::{EthercatSettings, OnLoss, Settings};

/// The gateway's EtherCAT state. Boards keep it in a static; it is all zeros at start.
pub struct EthercatState {
    /// Its images are longer than a controller of 4 KiB holds.
    pub(super) long: bool,
    pub(super) scanner: ScannerState,
    /// As last written; the one in use, if any.
    configuration: Mutex<CriticalSectionRawMutex, RefCell<Configuration>>,
    pub(super) state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    /// The devices have changed, so that pending requests are obsolete, or the controller has appeared or disappeared.
    renewed: Signal<CriticalSectionRawMutex, ()>,
    requests: Requests,
    pub(super) keeping: Keeping,
    pub(super) history: SharedHistory,
}

#[derive(Clone, Copy)]
pub(super) struct State {
    /// Whether a port polls the devices.
    pub(super) has_port: bool,
    /// Whether the port's line exists.
    has_line: bool,
    pub(super) on_loss: OnLoss,
    proves_outputs: bool,
    /// The explicit device identification.
    id: Option<u16>,
    /// Whether emergencies are enabled from the start.
    emergencies: bool,
    /// Whether a configuration is in use.
    running: bool,
    /// The settings have slaves to poll as soon as port and line exist.
    wanted: bool,
    /// A MainDevice has applied a configuration that the settings do not contain yet.
    pub(super) taken_over: bool,
    /// Image size of the assigned PDOs.
    pub(super) room: Room,
    /// Whether devices are modules, whose PDOs have the size of their values.
    pub(super) modular: bool,
    /// Whether the settings select modules. A change requires a restart of the SubDevice.
    pub(super) wants_modules: bool,
    /// Whether they offer Ethernet, likewise.
    wants_ethernet: bool,
    /// Whether process data are exchanged, so that modules cannot change.
    exchanging: bool,
    /// The line settings from the MainDevice, once it has written any.
    pub(super) speed: Speed,
    /// The line settings as last seen in the settings.
    pub(super) line: Speed,
    controller: Controller,
    /// What the SubDevice indicates, once it runs. Separate fields, so that the initial value is all zeros.
    pub(super) shown: Option<AlState>,
    pub(super) fault: Option<AlStatusCode>,
    pub(super) fell: bool,
}

impl State {
    /// All zeros, as the other fields.
    const NEW: Self = Self {
        has_port: false,
        has_line: false,
        on_loss: OnLoss::Stop,
        proves_outputs: false,
        id: None,
        emergencies: false,
        running: false,
        wanted: false,
        taken_over: false,
        room: Room { inputs: 0, outputs: 0 },
        modular: false,
        wants_modules: false,
        wants_ethernet: false,
        exchanging: false,
        speed: Speed::NONE,
        line: Speed::NONE,
        controller: Controller::Present,
        shown: None,
        fault: None,
        fell: false,
    };
}

impl EthercatState {
    /// Without a configuration.
    pub const fn new() -> Self {
        Self::with(false)
    }

    /// The same with buffers for images of up to [`Room::LONG`].
    #[cfg(feature = "long-images")] // Other images lack the scanner memory.
    pub const fn long() -> Self {
        Self::with(true)
    }

    const fn with(long: bool) -> Self {
        Self {
            long,
            scanner: ScannerState::new(),
            configuration: Mutex::new(RefCell::new(Configuration::EMPTY)),
            state: Mutex::new(Cell::new(State::NEW)),
            renewed: Signal::new(),
            requests: Requests::new(),
            keeping: Keeping::new(),
            history: SharedHistory::new(RefCell::new(History::new())),
        }
    }

    /// Whether the settings offer Ethernet.
    pub(super) fn wants_ethernet(&self) -> bool {
        // No image without it has the setting.
        cfg!(feature = "eoe") && self.state.lock(Cell::get).wants_ethernet
    }

    /// Whether a configuration is in use (2005h:02).
    pub fn is_running(&self) -> bool {
        self.state.lock(Cell::get).running
    }

    /// Whether outputs are read from the controller until two reads agree.
    pub(super) fn proves_outputs(&self) -> bool {
        self.state.lock(Cell::get).proves_outputs
    }

    /// The explicit device identification, if set.
    pub(super) fn identification(&self) -> Option<u16> {
        self.state.lock(Cell::get).id
    }

    /// The status of the slave `nth`, if it exists.
    #[doc(hidden)] // Public for tests/ only.
    pub fn slave_status(&self, nth: usize) -> Option<DeviceStatus> {
        let id = DeviceId(u8::try_from(nth).ok()?);
        self.scanner.with(|scanner| scanner.device_status(id, Instant::now()))
    }

    /// Calls `f` with the configuration as last written.
    pub fn configuration<R>(&self, f: impl FnOnce(&mut Configuration) -> R) -> R {
        self.configuration.lock(|configuration| f(configuration.borrow_mut().filled()))
    }

    /// Writes a number of the configuration. Equal values change nothing, so that a MainDevice may repeat its start-up list; a
    /// different value starts a new configuration, and stops the one in use.
    pub(super) fn configure(&self, at: Address, number: u32) {
        if self.configuration(|configuration| configuration.number(at)) == Some(number) {
            return;
        }
        if self.is_running() {
            self.stop();
        }
        self.configuration(|configuration| configuration.set(at, number)).unwrap_or_default();
    }

    /// The layout of the slave `nth`; all zeros while no configuration is in use.
    pub fn layout(&self, nth: usize) -> DeviceLayout {
        if !self.is_running() {
            return DeviceLayout::default();
        }
        let of = |configuration: &mut Configuration| layouts(configuration.slaves(), self.most()).nth(nth);
        self.configuration(of).and_then(Result::ok).unwrap_or_default()
    }

    /// Checks whether the configuration can be used now; returns the required line settings.
    pub(super) fn check(&self) -> Result<Speed, ConfigError> {
        let State { has_port, has_line, room, .. } = self.state.lock(Cell::get);
        let speed = self.configuration(|configuration| configuration.plan(room))?;
        match (has_port, has_line) {
            (false, _) => Err(ConfigError::NoPort),
            (true, false) => Err(ConfigError::NoLine),
            (true, true) => Ok(speed),
        }
    }

    /// Applies the whole configuration with empty buffers, or changes nothing. One already in use stays so.
    pub(super) fn take_over(&self) -> Result<(), ConfigError> {
        let speed = self.check()?;
        self.update(|state| (state.speed, state.taken_over) = (speed, true));
        if !self.is_running() {
            self.start();
        }
        Ok(())
    }

    /// Starts polling the devices of the checked configuration.
    fn start(&self) {
        let (now, most) = (Instant::now(), self.most());
        self.configuration(|configuration| {
            let slaves = configuration.slaves();
            let slaves = slaves.iter().zip(layouts(slaves, most).map_while(Result::ok));
            self.scanner.change(|scanner| {
                scanner.restart(now);
                // Within all limits: both buffers, and the maximum of slaves with one range in each table.
                let fits = scanner.allocate(most.inputs + most.outputs).map(|_| ());
                let fits = fits.and_then(|()| {
                    let mut slaves = slaves;
                    slaves.try_for_each(|(slave, layout)| add(scanner, slave, &layout, most.inputs, now))
                });
                debug_assert_eq!(fits, Ok(()));
            });
        });
        self.update(|state| (state.running, state.wanted) = (true, false));
        self.renewed.signal(());
    }

    /// Stops polling; the buffers keep their values.
    pub(super) fn stop(&self) {
        self.scanner.change(Scanner::forget_devices);
        self.update(|state| (state.running, state.wanted) = (false, false));
        self.renewed.signal(());
    }

    /// What the settings' slaves are waiting for before they can be polled.
    pub(super) fn missing(&self) -> Option<ConfigError> {
        let State { wanted, has_port, .. } = self.state.lock(Cell::get);
        wanted.then_some(if has_port { ConfigError::NoLine } else { ConfigError::NoPort })
    }

    /// Checks whether a port can send requests of the MainDevice.
    pub(super) fn check_port(&self) -> Result<(), Abort> {
        if self.state.lock(Cell::get).has_port { Ok(()) } else { Err(Abort::LocalControl) }
    }

    /// Image size of the assigned PDOs.
    pub(super) fn room(&self) -> Room {
        self.state.lock(Cell::get).room
    }

    /// Sets the image size after a change of the assignment.
    pub(super) fn set_room(&self, room: Room) {
        let most = self.most();
        let room = Room { inputs: room.inputs.min(most.inputs), outputs: room.outputs.min(most.outputs) };
        self.update(|state| state.room = room);
    }

    /// Whether process data are exchanged.
    pub(super) fn is_exchanging(&self) -> bool {
        self.state.lock(Cell::get).exchanging
    }

    /// Records whether process data are exchanged.
    pub(super) fn set_exchanging(&self, exchanging: bool) {
        self.update(|state| state.exchanging = exchanging);
    }

    /// The scanner, for the port.
    pub fn scanner(&self) -> &ScannerState {
        &self.scanner
    }

    /// The MainDevice's direct requests.
    pub fn requests(&self) -> &Requests {
        &self.requests
    }

    /// The presence of the board's controller.
    pub fn controller(&self) -> Controller {
        self.state.lock(Cell::get).controller
    }

    /// Records the controller's presence, and notifies the port.
    pub(super) fn set_controller(&self, controller: Controller) {
        self.update(|state| state.controller = controller);
        self.renewed.signal(());
    }

    /// Waits until the devices or the controller change.
    #[doc(hidden)] // Public for tests/ only.
    pub async fn renewed(&self) {
        self.renewed.wait().await;
    }

    /// The origin of the line's settings.
    #[doc(hidden)] // Public for tests/ only.
    pub fn line_writer(&self) -> LineWriter {
        match self.state.lock(Cell::get) {
            State { line, speed, .. } if line == Speed::NONE || speed == Speed::NONE => LineWriter::Settings,
            State { line, speed, .. } if line == speed => LineWriter::MainDevice,
            State { speed, .. } => LineWriter::SettingsOver(speed),
        }
    }

    /// Whether the slaves of `settings` can be polled with the PDOs in use.
    pub(crate) fn check_settings(&self, settings: &Settings) -> Result<(), ConfigError> {
        let State { exchanging, room, modular, .. } = self.state.lock(Cell::get);
        let modules = settings.ethercat().map_or(modular, |port| port.modules);
        // A change of the device restarts it, with nothing assigned.
        let exchanging = exchanging && modules == modular;
        if exchanging && modular && !self.is_told(settings) {
            return Err(ConfigError::ModulesInUse);
        }
        let room = if exchanging { room } else { self.most() };
        layouts(&settings.slaves, room).try_for_each(|layout| layout.map(|_| ()))
    }

    /// Applies checked `settings`: changed slaves are polled from now on; without a port that polls them, no configuration can be
    /// in use.
    pub fn follow(&self, settings: &Settings, other_slaves: bool) {
        let port = settings.ethercat();
        let sets_none = port.is_some_and(|port| port.line.is_none());
        let line = settings.ethercat_speed().map_or(Speed::NONE, Speed::of);
        let before = self.state.lock(Cell::get);
        self.update(|state| {
            state.has_port = port.is_some();
            state.has_line = sets_none || line != Speed::NONE;
            state.on_loss = port.map(|port| port.on_loss).unwrap_or_default();
            state.proves_outputs = port.is_some_and(|port| port.prove_outputs);
            state.id = port.and_then(|port| port.id);
            state.emergencies = port.is_some_and(|port| port.emergencies);
            state.wants_modules = port.is_some_and(|port| port.modules);
            state.wants_ethernet = port.is_some_and(EthercatSettings::has_ethernet);
            state.line = line;
            state.wanted |= other_slaves && !settings.slaves.is_empty();
        });
        // The line is right until a MainDevice requests otherwise.
        if line != before.line && line != Speed::NONE && before.speed == Speed::NONE {
            self.configuration(|configuration| configuration.set_speed(line));
        }
        if other_slaves {
            self.update(|state| state.taken_over = false);
            self.configuration(|configuration| configuration.replace(&settings.slaves));
        }
        let State { has_port, has_line, running, wanted, emergencies, .. } = self.state.lock(Cell::get);
        // A MainDevice's choice lasts until the setting is changed.
        if emergencies != before.emergencies {
            self.history(|history| history.set_emergencies(emergencies));
        }
        if wanted && has_port && has_line {
            self.start();
        } else if running && (!has_port || other_slaves) {
            self.stop();
            self.update(|state| state.wanted = wanted);
        }
    }

    pub(super) fn update(&self, change: impl FnOnce(&mut State)) {
        self.state.lock(|cell| {
            let mut state = cell.get();
            change(&mut state);
            cell.set(state);
        });
    }
}
