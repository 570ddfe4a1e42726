//! Additional state of a modular gateway: the modules in their slots, and those expected by the MainDevice.

use core::cell::Cell;

use ethercat_subdevice::application::Address;
use ethercat_subdevice::assignment::Assignment;
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::Channel;

use super::config_error::ConfigError;
use super::layout::{DeviceLayout, Start};
use super::modular::{OWN_BYTES, STATUS_PDO, fits, has, indices, object, slot_of};
use super::modules::{VARIANTS, ident, is_module, pdo_bytes, put_inputs, put_value, tables, take_outputs};
use super::room::Room;
use super::shared::EthercatState;
use super::slaves::SLAVES_MAX;
use crate::settings::SlaveSettings;

/// The settings of the module in slot 0.
const SETTINGS: u16 = 0x8000;

pub(super) struct Slots<'p> {
    shared: &'p EthercatState,
    /// The modules expected by the MainDevice (F030h).
    expected: [u32; SLAVES_MAX],
    /// Layout start after the module exchanged last. PDOs are exchanged slot by slot.
    next: Start,
}

/// The module in `slot` of `slaves`, if there is one with values that fit its PDOs.
fn module_of(slaves: &[SlaveSettings], slot: usize) -> Option<&SlaveSettings> {
    slaves.get(slot).filter(|slave| is_module(slave) && fits(slave))
}

impl<'p> Slots<'p> {
    pub(super) fn new(shared: &'p EthercatState) -> Self {
        Self { shared, expected: [0; SLAVES_MAX], next: Start::default() }
    }

    /// The module in a slot, if any.
    fn module(&self, slot: usize) -> Option<SlaveSettings> {
        let slave = self.shared.configuration(|configuration| configuration.slaves().get(slot).copied())?;
        is_module(&slave).then_some(slave)
    }

    /// An object of a module; settings exist even without a module.
    pub(super) fn object(&self, index: u16) -> Option<Object> {
        let (slot, first) = slot_of(index)?;
        if first == SETTINGS {
            return object(&SlaveSettings::new(1), slot, first);
        }
        object(&self.module(slot).filter(fits)?, slot, first)
    }

    /// The first object from `index` on.
    pub(super) fn next_object(&self, index: u16) -> Option<u16> {
        self.shared.configuration(|configuration| {
            let slaves = configuration.slaves();
            indices().filter(|found| *found >= index).find(|&found| {
                let Some((slot, first)) = slot_of(found) else { return false };
                first == SETTINGS || module_of(slaves, slot).is_some_and(|slave| has(slave, first))
            })
        })
    }

    /// The PDOs of all modules, and that of the device.
    pub(super) fn assignment(&self, channel: Channel) -> Assignment {
        let (first, own, own_bytes) = match channel {
            Channel::Outputs => (0x1600, 0, 0),
            _ => (0x1a00, 1 << (STATUS_PDO - 0x1a00), OWN_BYTES),
        };
        let (mut present, mut bytes) = (own, own_bytes);
        self.shared.configuration(|configuration| {
            let slaves = configuration.slaves();
            for slot in 0..slaves.len() {
                let of_module = module_of(slaves, slot).map_or(0, |slave| pdo_bytes(slave, channel));
                present |= u64::from(of_module > 0) << slot;
                bytes += of_module;
            }
        });
        // An overlong PDO is refused before the exchange.
        Assignment::of_modules(channel, first, present, u16::try_from(bytes).unwrap_or(u16::MAX))
    }

    /// The module in a slot, with its layout.
    fn placed(&mut self, slot: usize) -> Option<(SlaveSettings, DeviceLayout)> {
        if usize::from(self.next.nth) > slot {
            self.next = Start::default();
        }
        let (next, room) = (&mut self.next, self.shared.most());
        self.shared.configuration(|configuration| {
            let mut placed = None;
            for slave in configuration.slaves().get(usize::from(next.nth)..=slot)? {
                placed = Some((*slave, next.lay_out(slave, room).ok()?));
            }
            placed
        })
    }

    /// Number of modules.
    pub(super) fn count(&self) -> u32 {
        self.assignment(Channel::Inputs).indices().count() as u32 - 1
    }

    /// Checks the modules against the MainDevice's expectation and the process data size.
    fn check(&mut self) -> Result<(), ConfigError> {
        // Modules may have changed since the last exchange.
        self.next = Start::default();
        let (most, mut inputs, mut outputs) = (self.shared.most(), OWN_BYTES, 0);
        for (slot, &expected) in self.expected.iter().enumerate() {
            let slave = slot as u8;
            let module = self.module(slot);
            if let Some(module) = module {
                inputs += pdo_bytes(&module, Channel::Inputs);
                outputs += pdo_bytes(&module, Channel::Outputs);
                if !fits(&module) {
                    return Err(ConfigError::EntriesFull { slave });
                }
                if inputs > most.inputs.into() {
                    return Err(ConfigError::InputsFull { slave, room: most.inputs });
                }
                if outputs > most.outputs.into() {
                    return Err(ConfigError::OutputsFull { slave, room: most.outputs });
                }
            }
            let expected = if expected == 0 { 0 } else { expected & !VARIANTS };
            if self.expects_any() && expected != module.map_or(0, |module| ident(&module)) {
                return Err(ConfigError::OtherModule { slave });
            }
        }
        Ok(())
    }

    /// Applies the modules as written, if there are any.
    pub(super) fn take_over(&mut self) -> Result<(), ConfigError> {
        self.check()?;
        if self.has_modules() { self.shared.take_over() } else { Ok(()) }
    }

    fn expects_any(&self) -> bool {
        self.expected.iter().any(|expected| *expected != 0)
    }

    /// Whether there are any modules.
    fn has_modules(&self) -> bool {
        self.shared.configuration(|configuration| configuration.slaves().iter().any(is_module))
    }

    /// The number at `at`, if it belongs to the slots.
    pub(super) fn number(&self, at: Address) -> Option<u32> {
        let nth = usize::from(at.sub.checked_sub(1)?);
        Some(match at.index {
            0xf030 => *self.expected.get(nth)?,
            0xf050 => self.module(nth).map_or(0, |module| ident(&module)),
            index => {
                let (slot, 0x9000) = slot_of(index)? else { return None };
                let module = self.module(slot)?;
                match nth {
                    0 => ident(&module),
                    1 => pdo_bytes(&module, Channel::Inputs),
                    _ => pdo_bytes(&module, Channel::Outputs),
                }
            }
        })
    }

    /// Writes the expected module of a slot, if `at` is one.
    pub(super) fn write(&mut self, at: Address, ident: u32) -> bool {
        let expected = self.expected.get_mut(usize::from(at.sub).saturating_sub(1));
        let ident_of_slot = expected.filter(|_| at.index == 0xf030);
        ident_of_slot.map(|expected| *expected = ident).is_some()
    }

    /// Reads a value of a module, if `at` is one; 0 while it is not polled.
    pub(super) fn read(&self, at: Address, into: &mut [u8]) -> Option<()> {
        let (slot, first @ 0x6000..=0x7fff) = slot_of(at.index)? else { return None };
        let module = self.module(slot)?;
        let channel = if first < 0x7000 { Channel::Inputs } else { Channel::Outputs };
        let table = tables(&module, channel).find(|table| table.index == first)?;
        let nth = u16::from(at.sub.checked_sub(1)?);
        into.fill(0);
        if self.shared.is_running() {
            let layout = self.shared.layout(slot);
            match channel {
                Channel::Outputs => {
                    let first = layout.output(table.kind)?;
                    self.shared.outputs(|image| put_value(table, image, first, nth, into));
                }
                _ => self.shared.inputs(|image| put_value(table, image, layout.input(table.kind), nth, into)),
            }
        }
        Some(())
    }

    /// Writes the inputs of a module, if `pdo` belongs to one.
    pub(super) fn inputs(&mut self, pdo: u16, into: &mut [u8]) -> Option<()> {
        let (slot, 0x1a00) = slot_of(pdo)? else { return None };
        into.fill(0);
        if self.shared.is_running() {
            let (module, layout) = self.placed(slot)?;
            self.shared.inputs(|image| put_inputs(&module, &layout, image, into));
        }
        Some(())
    }

    /// Takes the outputs of a module.
    pub(super) fn outputs(&mut self, pdo: u16, bytes: &[u8]) -> Option<()> {
        let (slot, 0x1600) = slot_of(pdo)? else { return None };
        if self.shared.is_running() {
            let (module, layout) = self.placed(slot)?;
            self.shared.put_outputs(|image| take_outputs(&module, &layout, bytes, image));
        }
        Some(())
    }
}

impl EthercatState {
    /// Sets whether devices are modules in the running SubDevice. Its PDOs are those of power-on.
    pub(super) fn set_modular(&self, modular: bool) {
        let room = if modular { self.most() } else { Room::FIRST };
        self.update(|state| (state.modular, state.room) = (modular, room));
    }

    /// Whether the settings select a modular SubDevice.
    pub(super) fn wants_modules(&self) -> bool {
        self.state.lock(Cell::get).wants_modules
    }
}
