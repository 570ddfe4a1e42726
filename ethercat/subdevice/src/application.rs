//! What an application adds to the stack: object values, process data, and a veto on state changes.

use crate::al_state::{AlState, AlStatusCode};
use crate::assignment::Assignment;
use crate::coe::abort::Abort;
use crate::coe::emergency::Emergency;
use crate::eoe::{Ethernet, NoEthernet};
use crate::esc::EscError;
use crate::foe::{Files, NoFiles};
use crate::indicators::Indicators;
use crate::object::Object;
use crate::sync_manager::Channel;

/// An entry of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Address {
    /// The object.
    pub index: u16,
    /// The sub-index.
    pub sub: u8,
}

/// The application behind a SubDevice. The SubDevice's task makes the calls; none of them blocks.
pub trait Application {
    /// Writes the value at `at` into `into`, which has the entry's size, and returns its length: shorter only for texts.
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort>;

    /// Whether `value` may be written at `at`. The stack has checked access, state, length and range.
    fn check(&mut self, _at: Address, _value: &[u8]) -> Result<(), Abort> {
        Ok(())
    }

    /// Writes the checked `value`. A complete access checks all values before it writes the first.
    fn write(&mut self, at: Address, value: &[u8]);

    /// The result of the last write; `None` while it is in progress. Its SDO is answered once it ends, and no other is served
    /// before.
    fn written(&mut self) -> Option<Result<(), Abort>> {
        Some(Ok(()))
    }

    /// An object that is not in the device's table, such as a module's. It may change after a write, but stays while in a state
    /// with process data.
    fn object(&self, _index: u16) -> Option<Object> {
        None
    }

    /// The first of those objects from `index` on.
    fn next_object(&self, _index: u16) -> Option<u16> {
        None
    }

    /// The PDOs of a SyncManager, where the application assigns them instead of a MainDevice: those of its modules.
    fn assignment(&self, _channel: Channel) -> Option<Assignment> {
        None
    }

    /// The PDOs that a MainDevice assigned to a SyncManager, in order; before the first call they are those of the device's table.
    fn assigned(&mut self, _channel: Channel, _pdos: &[u16]) {}

    /// Whether outputs are accepted only if two successive reads agree, for a bus that may flip bits in process data. That doubles
    /// their traffic.
    fn proves_outputs(&self) -> bool {
        false
    }

    /// Whether errors are also reported as emergencies, to a MainDevice that accepts them.
    fn sends_emergencies(&self) -> bool {
        false
    }

    /// The application's next emergency; called when there is room for one, while [enabled](Self::sends_emergencies).
    fn emergency(&mut self) -> Option<Emergency> {
        None
    }

    /// The application's files, where the device's table has [file access](crate::device::Device::files).
    fn files(&mut self) -> Option<&mut impl Files> {
        None::<&mut NoFiles>
    }

    /// The application's Ethernet, where the device's table [offers](crate::device::Device::ethernet) it: an
    /// [`Eoe`](crate::eoe::Eoe).
    fn ethernet(&mut self) -> Option<&mut impl Ethernet> {
        None::<&mut NoEthernet>
    }

    /// Distinguishes the device from others of its kind when a MainDevice asks (ETG.1020, explicit device identification): the
    /// value of a selector or a setting. `None` means the station alias in the EEPROM.
    fn identification(&self) -> Option<u16> {
        None
    }

    /// The processor's worst-case overhead per process data cycle besides the bus to the controller: from the interrupt to the
    /// first access, and between accesses.
    fn cycle_fixed_ns(&self) -> u32 {
        25_000
    }

    /// Takes the outputs of a PDO, always from a single frame. Called in Op only, for each assigned PDO.
    fn outputs(&mut self, pdo: u16, bytes: &[u8]);

    /// Writes the inputs of a PDO.
    fn inputs(&mut self, pdo: u16, into: &mut [u8]);

    /// The outputs became invalid: Op was left, on request or because no outputs came.
    fn outputs_stopped(&mut self);

    /// Whether this is now the application of another device, which then takes over the controller; see
    /// [`SubDevice::run_until_fault`](crate::sub_device::SubDevice::run_until_fault).
    fn is_another_device(&self) -> bool {
        false
    }

    /// The controller failed and is restarted.
    fn failed(&mut self, _fault: EscError) {}

    /// Whether the device may go up to `state`; if not, the code is reported to the MainDevice.
    fn may_enter(&mut self, _state: AlState) -> Result<(), AlStatusCode> {
        Ok(())
    }

    /// SafeOp is refused: the planned sizes, the controller's memory (0006h) or the buffer have only `room` for the `bytes` of
    /// process data assigned to `channel`.
    fn memory_full(&mut self, _channel: Channel, _bytes: u16, _room: u16) {}

    /// The device's indicators changed.
    fn shows(&mut self, _indicators: Indicators) {}

    /// The state has changed.
    fn entered(&mut self, _state: AlState) {}
}
