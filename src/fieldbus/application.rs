//! The values of the gateway's objects.

mod checks;

use embassy_time::Instant;
use ethercat_subdevice::al_state::{AlState, AlStatusCode};
use ethercat_subdevice::application::{Address, Application};
use ethercat_subdevice::assignment::Assignment;
use ethercat_subdevice::coe::abort::Abort;
use ethercat_subdevice::coe::emergency::Emergency;
use ethercat_subdevice::diagnosis::History;
use ethercat_subdevice::dictionary::number;
use ethercat_subdevice::eoe::{Ethernet, NoEthernet};
use ethercat_subdevice::esc::EscError;
use ethercat_subdevice::foe::{FileAccess, Files, NoFiles};
use ethercat_subdevice::indicators::Indicators;
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::Channel;

use super::config_error::ConfigError;
use super::files::GatewayFiles;
use super::keeping::{Keep, Kept};
use super::line::LineWriter;
use super::points::PointObjects;
use super::room::{LONG_LAST_INPUTS, Room, span};
use super::shared::EthercatState;
use super::slaves::ModbusSlave;
use super::slots::Slots;
use crate::scanner::ScannerState;

/// Overhead of a process data cycle besides the bus to the controller and its chip selects: for interrupt handling, and per module.
const FIXED_NS: u32 = 25_000;
const MODULE_NS: u32 = 4_000;

/// Reads and writes of configuration, layout and buffers.
pub struct GatewayObjects<'p, F = NoFiles, N = NoEthernet> {
    shared: &'p EthercatState,
    /// Why the last request was refused.
    refused: Option<ConfigError>,
    /// Whether the outputs come from a MainDevice currently in Op.
    outputs_valid: bool,
    /// Incremented when inputs are updated, so that a MainDevice can detect stale ones.
    input_counter: u8,
    points: PointObjects<'p>,
    /// Only in a modular gateway.
    slots: Option<Slots<'p>>,
    files: F,
    ethernet: N,
    /// Whether the device offers it.
    has_ethernet: bool,
}

impl<'p> GatewayObjects<'p> {
    /// The objects after power-on.
    pub fn new(shared: &'p EthercatState) -> Self {
        shared.set_room(Room::FIRST);
        let points = PointObjects::default();
        Self {
            shared,
            refused: None,
            outputs_valid: false,
            input_counter: 0,
            points,
            slots: None,
            files: NoFiles,
            ethernet: NoEthernet,
            has_ethernet: false,
        }
    }

    /// The objects of a [modular](super::MODULAR) gateway.
    pub fn modular(shared: &'p EthercatState) -> Self {
        let mut objects = Self::new(shared);
        objects.become_modular(true);
        objects
    }

    /// Adds the files of `files`.
    #[must_use]
    pub fn with_files<F: GatewayFiles>(self, files: F) -> GatewayObjects<'p, F> {
        self.with(files, NoEthernet)
    }
}

impl<'p, F, N> GatewayObjects<'p, F, N> {
    /// With other files and another Ethernet, which the settings may offer.
    pub(super) fn with<G: GatewayFiles, E: Ethernet>(
        self,
        files: G,
        ethernet: E,
    ) -> GatewayObjects<'p, G, E> {
        let Self { shared, refused, outputs_valid, input_counter, points, slots, has_ethernet, .. } = self;
        GatewayObjects {
            shared,
            refused,
            outputs_valid,
            input_counter,
            points,
            slots,
            files,
            ethernet,
            has_ethernet,
        }
    }

    /// Switches to the device selected by the settings; returns whether it is the modular one.
    pub(super) fn follow_settings(&mut self) -> bool {
        self.has_ethernet = self.shared.wants_ethernet();
        let modular = self.shared.wants_modules();
        self.become_modular(modular);
        modular
    }

    fn become_modular(&mut self, modular: bool) {
        self.slots = modular.then(|| Slots::new(self.shared));
        self.shared.set_modular(modular);
    }

    /// Adds the objects of data points, if the gateway has any.
    #[must_use]
    pub fn with_points(self, scanner: Option<&'p ScannerState>) -> Self {
        Self { points: PointObjects::new(scanner), ..self }
    }

    /// The state shared with the port.
    pub fn shared(&self) -> &'p EthercatState {
        self.shared
    }

    /// Whether the outputs come from a MainDevice currently in Op.
    pub fn outputs_valid(&self) -> bool {
        self.outputs_valid
    }

    /// The number at `at`, except for buffers and texts.
    fn number(&self, at: Address) -> Option<u32> {
        let shared = self.shared;
        if at.index == 0x200a {
            return Some((shared.line_writer() == LineWriter::MainDevice).into());
        }
        if let Some(number) = self.slots.as_ref().and_then(|slots| slots.number(at)) {
            return Some(number);
        }
        let sub = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            // Saved and restored on command only.
            0x1010 | 0x1011 => 1,
            // The request to apply the configuration is served at once, so it never reads as set.
            0x2005 => u32::from(sub == 1 && shared.is_running()),
            0x2030 => self.input_counter.into(),
            0x2031 => shared.health(sub).into(),
            0x2032 => shared.state_word(sub).into(),
            0x2033 if sub == 1 => shared.requests().state().number().into(),
            0x2033 => shared.requests().error().into(),
            0x2040..=0x2043 => self.points.number(at.index, sub)?.into(),
            index => match ModbusSlave::of(index) {
                Some(ModbusSlave::Layout(nth)) => (*shared.layout(nth).0.get(sub)?).into(),
                Some(ModbusSlave::Status(nth)) => shared.status_number(nth, sub)?,
                _ => return shared.configuration(|configuration| configuration.number(at)),
            },
        })
    }
}

/// Copies the entry `sub` of an object into `into`; the object's first byte is byte `first` of `buffer`.
fn copy_entry(buffer: &[u8], first: u16, sub: u8, into: &mut [u8]) -> Result<(), Abort> {
    let start = usize::from(first) + usize::from(sub).saturating_sub(1) * into.len();
    into.copy_from_slice(buffer.get(start..start + into.len()).ok_or(Abort::General)?);
    Ok(())
}

impl<F: GatewayFiles, N: Ethernet> Application for GatewayObjects<'_, F, N> {
    fn proves_outputs(&self) -> bool {
        self.shared.proves_outputs()
    }

    fn shows(&mut self, indicators: Indicators) {
        self.shared.set_indicators(indicators);
    }

    fn sends_emergencies(&self) -> bool {
        self.shared.history(|history| history.sends_emergencies())
    }

    fn emergency(&mut self) -> Option<Emergency> {
        self.shared.history(History::emergency)
    }

    fn object(&self, index: u16) -> Option<Object> {
        self.slots.as_ref()?.object(index)
    }

    fn next_object(&self, index: u16) -> Option<u16> {
        self.slots.as_ref()?.next_object(index)
    }

    fn assignment(&self, channel: Channel) -> Option<Assignment> {
        self.slots.as_ref().map(|slots| slots.assignment(channel))
    }

    fn files(&mut self) -> Option<&mut impl Files> {
        (F::ACCESS != FileAccess::None).then_some(&mut self.files)
    }

    fn ethernet(&mut self) -> Option<&mut impl Ethernet> {
        Some(&mut self.ethernet)
    }

    fn identification(&self) -> Option<u16> {
        self.shared.identification()
    }

    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        if self.slots.as_ref().and_then(|slots| slots.read(at, into)).is_some() {
            return Ok(into.len());
        }
        match (at.index, at.sub) {
            (0x2021 | 0x2023 | 0x2025, sub) => {
                self.shared.inputs(|buffer| copy_entry(buffer, 0, sub, into))?
            }
            (0x2022 | 0x2024 | 0x2026, sub) => {
                self.shared.outputs(|buffer| copy_entry(buffer, 0, sub, into))?
            }
            (0x2027, _) => self.shared.inputs(|buffer| copy_entry(buffer, LONG_LAST_INPUTS, 1, into))?,
            (0x10f3, sub) => self.shared.history(|history| history.read(sub, into))?,
            (0x10f8, _) => into.copy_from_slice(&(Instant::now().as_micros() * 1_000).to_le_bytes()),
            (0x2033, 3) => return Ok(self.shared.requests().copy_response(into)),
            (0x2006, _) => {
                let reason = self.reason();
                into.fill(0);
                into.iter_mut().zip(reason.bytes()).for_each(|(shared, byte)| *shared = byte);
            }
            _ => {
                let number = self.number(at).ok_or(Abort::General)?;
                into.iter_mut().zip(number.to_le_bytes()).for_each(|(shared, byte)| *shared = byte);
            }
        }
        Ok(into.len())
    }

    fn check(&mut self, at: Address, value: &[u8]) -> Result<(), Abort> {
        let number = number(value);
        match (at.index, at.sub) {
            (0x1010, _) => self.check_keeping(Keep::Save, number),
            (0x1011, _) => self.check_keeping(Keep::Restore, number),
            (0x10f3, sub) => self.shared.history(|history| history.check(sub, number as u16)),
            (0x2005, 1) if number == 1 => self.check_configuration(),
            (0x2033, 1) => {
                self.shared.check_port()?;
                self.shared.requests().check(value)
            }
            (0x2033, _) => {
                self.shared.check_port()?;
                let requests = self.shared.requests();
                requests.check_part()?;
                requests.check(&requests.parts(number as usize).ok_or(Abort::Range)?)
            }
            (0x2034, _) => self.shared.requests().check_part(),
            // The outcome is reported when they are written.
            (0x2040 | 0x2042, _) => Ok(()),
            // 1 means mark parity, which no line supports.
            (0x2020, 3) if number == 1 => Err(Abort::Range),
            (0x2005, _) => Ok(()),
            // All others are configuration, which changes in PreOp only.
            _ if self.shared.is_exchanging() && (self.shared.is_running() || self.slots.is_some()) => {
                Err(Abort::State)
            }
            _ => Ok(()),
        }
    }

    fn write(&mut self, at: Address, value: &[u8]) {
        // No other write is served while a save is pending: this MainDevice has restarted.
        self.shared.keeping.forget();
        let number = number(value) as u32;
        match (at.index, at.sub) {
            (0x1010, _) => self.shared.keeping.begin(Keep::Save),
            (0x1011, _) => self.shared.keeping.begin(Keep::Restore),
            (0x10f3, sub) => self.shared.history(|history| history.write(sub, number as u16)),
            // Already checked.
            (0x2005, 1) if number == 1 => self.refused = self.shared.take_over().err(),
            (0x2005, 2) => self.shared.stop(),
            (0x2005, _) => {}
            (0x2033, 1) => self.shared.requests().ask(value),
            (0x2033, _) => {
                let parts = self.shared.requests().parts(number as usize);
                parts.into_iter().for_each(|request| self.shared.requests().ask(&request));
            }
            (0x2034, part) => {
                self.shared.requests().put_part(4 * usize::from(part.saturating_sub(1)), value);
            }
            (index @ (0x2040 | 0x2042), sub) => self.points.write(index, sub, number as u16),
            // The table has no other writable entries.
            _ if self.slots.as_mut().is_some_and(|slots| slots.write(at, number)) => {}
            _ => self.shared.configure(at, number),
        }
    }

    fn written(&mut self) -> Option<Result<(), Abort>> {
        if let Err(abort) = self.points.outcome() {
            return Some(Err(abort));
        }
        match self.shared.keeping.outcome() {
            Kept::Nothing | Kept::Done => Some(Ok(())),
            Kept::Wanted | Kept::Going => None,
            Kept::Failed => Some(self.note(Err(ConfigError::NotSaved))),
        }
    }

    fn assigned(&mut self, channel: Channel, pdos: &[u16]) {
        self.shared.set_room(self.shared.room().with(channel, pdos));
    }

    fn outputs(&mut self, pdo: u16, bytes: &[u8]) {
        if let Some(slots) = &mut self.slots {
            self.outputs_valid |= slots.outputs(pdo, bytes).is_some();
        } else if let Some((first, _)) = span(pdo) {
            self.shared.put_outputs(|image| {
                let shared = image.get_mut(first.into()..).unwrap_or_default();
                shared.iter_mut().zip(bytes).for_each(|(shared, byte)| *shared = *byte);
            });
            self.outputs_valid = true;
        }
    }

    fn inputs(&mut self, pdo: u16, into: &mut [u8]) {
        if self.slots.as_mut().and_then(|slots| slots.inputs(pdo, into)).is_some() {
            return;
        }
        match (pdo, span(pdo).filter(|_| self.slots.is_none())) {
            (_, Some((first, _))) => self.shared.inputs(|buffer| {
                let bytes = buffer.get(first.into()..).unwrap_or_default();
                into.iter_mut().zip(bytes).for_each(|(shared, byte)| *shared = *byte);
            }),
            (0x1a03, None) => {
                into.iter_mut().zip(0..).for_each(|(byte, nth)| *byte = self.shared.health(nth));
            }
            (0x1a06, None) => {
                let words = into.as_chunks_mut().0.iter_mut();
                words.zip(0..).for_each(|(word, nth)| *word = self.shared.state_word(nth).to_le_bytes());
            }
            _ => {
                self.input_counter = self.input_counter.wrapping_add(1);
                into.fill(0);
                into.iter_mut().take(1).for_each(|byte| *byte = self.input_counter);
            }
        }
    }

    fn cycle_fixed_ns(&self) -> u32 {
        FIXED_NS + self.slots.as_ref().map_or(0, |slots| slots.count() * MODULE_NS)
    }

    fn is_another_device(&self) -> bool {
        self.shared.wants_modules() != self.slots.is_some()
            || self.shared.wants_ethernet() != (cfg!(feature = "eoe") && self.has_ethernet)
    }

    fn failed(&mut self, fault: EscError) {
        log_warn!("EtherCAT starts anew: {fault}");
        self.shared.controller_failed();
    }

    fn outputs_stopped(&mut self) {
        self.outputs_valid = false;
        self.shared.outputs_stopped();
    }

    /// An image configured before the PDOs were assigned may exceed them.
    fn may_enter(&mut self, state: AlState) -> Result<(), AlStatusCode> {
        if state == AlState::SafeOp && self.slots.is_some() {
            return self.take_modules_over();
        }
        if state != AlState::SafeOp || !self.shared.is_running() {
            return Ok(());
        }
        let room = self.shared.room();
        self.refused = self.shared.configuration(|configuration| configuration.plan(room)).err();
        match self.refused {
            Some(error @ (ConfigError::InputsFull { .. } | ConfigError::OutputsFull { .. })) => {
                Err(error.al_status())
            }
            _ => Ok(()),
        }
    }

    fn memory_full(&mut self, channel: Channel, bytes: u16, room: u16) {
        let values = if channel == Channel::Outputs { "output" } else { "input" };
        // The AL status code reports the refusal as well.
        let _ = self.note(Err(ConfigError::MemoryFull { values, bytes, room }));
    }

    fn entered(&mut self, state: AlState) {
        self.shared.set_exchanging(state.has_process_data());
        self.files.entered(state);
    }
}
