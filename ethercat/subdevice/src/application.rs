//! What an application adds to the stack: values of objects, process data, and its word on changes of state.

use crate::al_state::{AlState, AlStatusCode};
use crate::assignment::Assignment;
use crate::coe::abort::Abort;
use crate::coe::emergency::Emergency;
use crate::esc::EscError;
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

/// The application behind a SubDevice. Calls come from the SubDevice's task, none of them waits.
pub trait Application {
    /// Writes the value at `at` into `into`, which has the entry's size, and gives its length: shorter for a text only.
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort>;

    /// Whether `value` may be written at `at`. The stack has checked access, state, length and range.
    fn check(&mut self, _at: Address, _value: &[u8]) -> Result<(), Abort> {
        Ok(())
    }

    /// Writes `value`, which was checked. In a complete access all values are checked before the first is written.
    fn write(&mut self, at: Address, value: &[u8]);

    /// How what was written last ended; none while it goes on. Its SDO is answered when it has ended, and no other is
    /// served before.
    fn written(&mut self) -> Option<Result<(), Abort>> {
        Some(Ok(()))
    }

    /// An object that is not in the device's table, such as a module's. It may be another one after a write, and stays while a state with
    /// process data is kept.
    fn object(&self, _index: u16) -> Option<Object> {
        None
    }

    /// The first of those objects from `index` on.
    fn next_object(&self, _index: u16) -> Option<u16> {
        None
    }

    /// Which PDOs a SyncManager carries, where the application decides that and no MainDevice: those of its modules.
    fn assignment(&self, _channel: Channel) -> Option<Assignment> {
        None
    }

    /// Which PDOs a MainDevice has assigned to a SyncManager, in their order; before the first call they are those of the device's table.
    fn assigned(&mut self, _channel: Channel, _pdos: &[u16]) {}

    /// Whether outputs are taken only when two readings in a row agree, on a bus that may turn bits in process data. That doubles
    /// their traffic.
    fn proves_outputs(&self) -> bool {
        false
    }

    /// Whether errors are also reported by emergencies, for a MainDevice that takes them.
    fn sends_emergencies(&self) -> bool {
        false
    }

    /// The next emergency of its own; asked for when there is room for one, while [they are sent](Self::sends_emergencies).
    fn emergency(&mut self) -> Option<Emergency> {
        None
    }

    /// What tells the device from others of its kind when a MainDevice asks for that (ETG.1020, explicit device identification): the
    /// value of a selector or a setting. None is the station alias that stands in the EEPROM.
    fn identification(&self) -> Option<u16> {
        None
    }

    /// What the processor takes for a cycle of process data beside the bus to the controller, at most: from the interrupt to the first
    /// access, and in between.
    fn cycle_fixed_ns(&self) -> u32 {
        25_000
    }

    /// Takes the outputs of a PDO, always those of one frame. Called in Op only, for each assigned PDO.
    fn outputs(&mut self, pdo: u16, bytes: &[u8]);

    /// Writes the inputs of a PDO.
    fn inputs(&mut self, pdo: u16, into: &mut [u8]);

    /// The outputs are not valid any more: Op was left, on request, or since no outputs came.
    fn outputs_stopped(&mut self);

    /// Whether it is the application of another device now: the controller is left then, see
    /// [`SubDevice::run_until_fault`](crate::sub_device::SubDevice::run_until_fault).
    fn is_another_device(&self) -> bool {
        false
    }

    /// The controller failed: it is started anew.
    fn failed(&mut self, _fault: EscError) {}

    /// Whether the device may go up to `state`; the code is shown to the MainDevice if not.
    fn may_enter(&mut self, _state: AlState) -> Result<(), AlStatusCode> {
        Ok(())
    }

    /// SafeOp is refused since the controller's memory (0006h) holds `room` of the `bytes` of process data that are assigned to `channel`.
    fn memory_full(&mut self, _channel: Channel, _bytes: u16, _room: u16) {}

    /// What the device's lights show from now on.
    fn shows(&mut self, _indicators: Indicators) {}

    /// The state has changed.
    fn entered(&mut self, _state: AlState) {}
}
