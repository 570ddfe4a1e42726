//! Objects kept by the stack itself: PDO assignment, and synchronisation of the application.

use crate::application::Application;
use crate::assignment::{Assignment, Pdos};
use crate::catalogue::Catalogue;
use crate::clocks::{Cycle, Offer, SYNC0_TYPE, SYNC1_TYPE};
use crate::coe::abort::Abort;
use crate::device::Device;
use crate::object::{Object, PDOS_SELECTED_MAX};
use crate::standard::{RESET_COUNTERS, SYNC_TYPES};
use crate::sync_manager::Channel;

/// The parts of an assignment that need the objects.
impl Assignment {
    /// The assigned PDOs.
    pub fn pdos<A: Application>(&self, catalogue: &Catalogue<'_, A>) -> impl Iterator<Item = Object> {
        self.indices().filter_map(|index| catalogue.object(index))
    }

    /// Bytes of all assigned PDOs.
    pub fn bytes<A: Application>(&self, catalogue: &Catalogue<'_, A>) -> u16 {
        match self.pdos {
            Pdos::Listed { .. } => self.pdos(catalogue).map(|pdo| pdo.pdo_bytes()).sum::<usize>() as u16,
            Pdos::Modules { bytes, .. } => bytes,
        }
    }

    /// The list after a write at a sub-index: sub-index 0 must be cleared first, and set last (ETG.1020).
    pub fn with<A: Application>(
        mut self,
        catalogue: &Catalogue<'_, A>,
        sub: u8,
        value: u16,
    ) -> Result<Self, Abort> {
        let Pdos::Listed { count, pdos } = &mut self.pdos else { return Err(Abort::ReadOnly) };
        match sub.checked_sub(1) {
            None => {
                if usize::from(value) > PDOS_SELECTED_MAX {
                    return Err(Abort::PdoLength);
                }
                *count = value as u8;
                self.checked(catalogue)
            }
            Some(_) if *count != 0 => Err(Abort::CountNotZero),
            Some(at) => {
                *pdos.get_mut(usize::from(at)).ok_or(Abort::NoEntry)? = value;
                if value != 0 {
                    self.pdo(catalogue, value)?;
                }
                Ok(self)
            }
        }
    }

    /// The list replaced with `pdos`.
    pub fn replaced<A: Application>(
        mut self,
        catalogue: &Catalogue<'_, A>,
        pdos: impl ExactSizeIterator<Item = u16>,
    ) -> Result<Self, Abort> {
        if pdos.len() > PDOS_SELECTED_MAX {
            return Err(Abort::PdoLength);
        }
        self.pdos = Pdos::listed(pdos);
        self.checked(catalogue)
    }

    fn checked<A: Application>(self, catalogue: &Catalogue<'_, A>) -> Result<Self, Abort> {
        for (at, index) in self.indices().enumerate() {
            let pdo = self.pdo(catalogue, index)?;
            for other in self.indices().skip(at + 1) {
                if other == index || pdo.excludes(&self.pdo(catalogue, other)?) {
                    return Err(Abort::Incompatible);
                }
            }
        }
        if self.bytes(catalogue) > self.room {
            return Err(Abort::PdoLength);
        }
        Ok(self)
    }

    fn pdo<A: Application>(&self, catalogue: &Catalogue<'_, A>, index: u16) -> Result<Object, Abort> {
        let object = catalogue.object(index).filter(|object| object.pdo() == Some(self.channel()));
        object.ok_or(Abort::NotMappable)
    }
}

/// When images are exchanged with the application.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Synchronisation {
    /// Outputs when they come, inputs by the local clock.
    FreeRun,
    /// On SyncManager events: inputs are updated when outputs came or inputs were fetched.
    SyncManager,
    /// At the SYNC signals of distributed clocks.
    Clocks,
}

/// How well the exchange of images keeps up with the MainDevice: 1C32h and 1C33h from entry 05 on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// 05: the shortest cycle without skipped images, in nanoseconds; computed before each mailbox request.
    pub minimum_cycle_ns: u32,
    /// 06: the time to read outputs and to write inputs, likewise.
    pub copy_ns: [u32; 2],
    /// 0B: images that arrived before the previous one was taken, or had not come at their SYNC0.
    pub missed_events: u16,
    /// 0C: cycles in which a pulse of SYNC0 was not served.
    pub cycle_too_small: u16,
    /// 20h: the last cycles had synchronisation errors.
    pub sync_error: bool,
    /// The cycle of distributed clocks in force.
    pub(crate) cycle: Option<Cycle>,
}

impl Timing {
    const NEW: Self = Self {
        minimum_cycle_ns: 0,
        copy_ns: [0; 2],
        missed_events: 0,
        cycle_too_small: 0,
        sync_error: false,
        cycle: None,
    };

    fn value(&self, of_inputs: bool, sub: u8) -> Option<u32> {
        let cycle = self.cycle;
        Some(match sub {
            0x02 => cycle.map_or(0, |cycle| cycle.sync0_ns.saturating_mul(cycle.subordinated)),
            0x03 => cycle.filter(|_| of_inputs).and_then(|cycle| cycle.inputs_ns).unwrap_or(0),
            0x05 => self.minimum_cycle_ns,
            0x06 => *self.copy_ns.get(usize::from(of_inputs))?,
            // No measurement in progress.
            0x08 => 0,
            0x0a => cycle.map_or(0, |cycle| cycle.sync0_ns),
            0x0b => self.missed_events.into(),
            0x0c => self.cycle_too_small.into(),
            0x20 => self.sync_error.into(),
            _ => return None,
        })
    }

    /// Counts `missed` outputs.
    pub(crate) fn note_missed(&mut self, missed: bool) {
        self.missed_events = self.missed_events.saturating_add(missed.into());
    }

    /// Resets the counters.
    pub(crate) fn reset(&mut self) {
        (self.missed_events, self.cycle_too_small, self.sync_error) = (0, 0, false);
    }
}

/// Values kept by the stack, initially those of power-on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Communication {
    /// 1C12h.
    pub outputs: Assignment,
    /// 1C13h.
    pub inputs: Assignment,
    /// 1C32h:01.
    outputs_synchronised: u16,
    /// 1C33h:01.
    inputs_synchronised: u16,
    /// The values of 1C32h and 1C33h about the exchange.
    pub timing: Timing,
    /// 10F1h:02: synchronisation errors until Op is left, or 0.
    pub(crate) sync_errors_max: u16,
    /// The SYNC signals that there are.
    pub(crate) offer: Offer,
}

impl Communication {
    const FREE_RUN: u16 = 0x00;
    const OWN_EVENT: u16 = 0x01;
    const SYNC0: u16 = 0x02;
    const SYNC1: u16 = 0x03;
    const OUTPUTS_EVENT: u16 = 0x22;

    /// After power-on.
    pub fn new(device: &Device) -> Self {
        Self {
            outputs: Assignment::of_device(device, Channel::Outputs),
            inputs: Assignment::of_device(device, Channel::Inputs),
            outputs_synchronised: Self::OWN_EVENT,
            inputs_synchronised: Self::OUTPUTS_EVENT,
            timing: Timing::NEW,
            sync_errors_max: 0,
            offer: Offer::default(),
        }
    }

    /// Whether inputs are updated only with outputs (1C33h:01 = 22h), and there are any outputs.
    pub fn inputs_follow_outputs<A: Application>(&self, catalogue: &Catalogue<'_, A>) -> bool {
        self.inputs_synchronised == Self::OUTPUTS_EVENT && self.outputs.bytes(catalogue) > 0
    }

    /// Takes over the application's assignment, if it makes one.
    pub fn follow(&mut self, application: &impl Application) {
        for assignment in [&mut self.outputs, &mut self.inputs] {
            if let Some(other) = application.assignment(assignment.channel()) {
                // The room is unchanged.
                assignment.pdos = other.pdos;
            }
        }
    }

    /// Synchronisation of both directions, if the settings are compatible. An active SYNC unit decides, whatever the settings are:
    /// most MainDevices set nothing else.
    pub fn synchronisation(&self) -> Option<Synchronisation> {
        match (self.outputs_synchronised, self.inputs_synchronised) {
            _ if self.timing.cycle.is_some() => Some(Synchronisation::Clocks),
            (Self::FREE_RUN, Self::FREE_RUN) => Some(Synchronisation::FreeRun),
            (Self::OWN_EVENT, Self::OWN_EVENT | Self::OUTPUTS_EVENT) => Some(Synchronisation::SyncManager),
            _ => None,
        }
    }

    /// Whether the settings demand distributed clocks.
    pub(crate) fn wants_clocks(&self) -> bool {
        let of_clocks = |setting| matches!(setting, Self::SYNC0 | Self::SYNC1);
        of_clocks(self.outputs_synchronised) || of_clocks(self.inputs_synchronised)
    }

    /// 1C32h:04 and 1C33h:04.
    fn supported(&self, of_inputs: bool) -> u32 {
        let sync0 = if self.offer.sync0 { SYNC0_TYPE } else { 0 };
        let sync1 = if self.offer.sync1 && of_inputs { SYNC1_TYPE } else { 0 };
        SYNC_TYPES | sync0 | sync1
    }

    /// 1C32h:01 and 1C33h:01: what is in force.
    fn types(&self) -> [u16; 2] {
        match self.timing.cycle {
            None => [self.outputs_synchronised, self.inputs_synchronised],
            Some(Cycle { inputs_ns: None, .. }) => [Self::SYNC0; 2],
            Some(_) => [Self::SYNC0, Self::SYNC1],
        }
    }

    /// The assignment in an object.
    pub fn assignment(&mut self, index: u16) -> Option<&mut Assignment> {
        match index {
            0x1c12 => Some(&mut self.outputs),
            0x1c13 => Some(&mut self.inputs),
            _ => None,
        }
    }

    /// A value kept by the stack.
    pub fn value(&mut self, index: u16, sub: u8) -> Option<u32> {
        match (index, sub) {
            (0x1c32 | 0x1c33, 1) => self.types().get(usize::from(index == 0x1c33)).copied().map(u32::from),
            (0x1c32 | 0x1c33, 4) => Some(self.supported(index == 0x1c33)),
            (0x1c32 | 0x1c33, _) => self.timing.value(index == 0x1c33, sub),
            (0x10f1, 2) => Some(self.sync_errors_max.into()),
            _ => self.assignment(index).map(|assignment| assignment.value(sub).into()),
        }
    }

    /// Writes a value kept by the stack.
    pub fn set<A: Application>(
        &mut self,
        catalogue: &Catalogue<'_, A>,
        index: u16,
        sub: u8,
        value: u16,
    ) -> Result<(), Abort> {
        match (index, sub, value) {
            (0x10f1, 2, _) => self.sync_errors_max = value,
            (0x1c32, 1, Self::FREE_RUN | Self::OWN_EVENT) => self.outputs_synchronised = value,
            (0x1c32, 1, Self::SYNC0) if self.offer.sync0 => self.outputs_synchronised = value,
            (0x1c33, 1, Self::SYNC0) if self.offer.sync0 => self.inputs_synchronised = value,
            (0x1c33, 1, Self::SYNC1) if self.offer.sync1 => self.inputs_synchronised = value,
            (0x1c33, 1, Self::FREE_RUN | Self::OWN_EVENT | Self::OUTPUTS_EVENT) => {
                self.inputs_synchronised = value
            }
            (0x1c32 | 0x1c33, 8, 0) => {}
            (0x1c32 | 0x1c33, 8, RESET_COUNTERS) => self.timing.reset(),
            (0x1c32 | 0x1c33, ..) => return Err(Abort::Range),
            _ => {
                let assignment = self.assignment(index).ok_or(Abort::General)?;
                *assignment = assignment.with(catalogue, sub, value)?;
            }
        }
        Ok(())
    }
}
