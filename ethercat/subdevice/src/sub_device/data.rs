//! Process data: outputs as they come, inputs when they are due.

use embassy_time::Instant;

use super::{FREE_RUN_CYCLE, SubDevice};
use crate::al_state::AlState;
use crate::application::Application;
use crate::esc::{Esc, EscError, read_agreed};
use crate::registers::Events;
use crate::sync_manager::Channel;

impl<E: Esc, A: Application> SubDevice<E, A> {
    /// Takes outputs and gives inputs.
    pub(super) async fn exchange_data(&mut self, events: Events) -> Result<(), EscError> {
        if !self.al.state().has_process_data() {
            return Ok(());
        }
        if events.any(Events::OUTPUTS_WRITTEN) {
            self.read_outputs().await?;
        }
        if !self.al.state().has_process_data() {
            return Ok(());
        }
        let due = match self.runs_free() {
            true => Instant::now() >= self.images.inputs_due,
            false => events.any(Events(Events::OUTPUTS_WRITTEN.0 | Events::INPUTS_FETCHED.0)),
        };
        if due { self.write_inputs().await } else { Ok(()) }
    }

    /// Bytes of process data, as they are assigned.
    pub(super) fn data_bytes(&self, channel: Channel) -> u16 {
        match channel {
            Channel::Inputs => self.communication.inputs.bytes(self.device),
            _ => self.communication.outputs.bytes(self.device),
        }
    }

    async fn read_outputs(&mut self) -> Result<(), EscError> {
        let bytes = usize::from(self.data_bytes(Channel::Outputs));
        let image = self.images.outputs.get_mut(..bytes).unwrap_or_default();
        if image.is_empty() {
            return Ok(());
        }
        let start = self.device.memory.start(Channel::Outputs);
        self.images.outputs_valid = false;
        match self.application.proves_outputs() {
            true => read_agreed(&mut self.esc, start, image).await?,
            false => self.esc.read(start, image).await?,
        }
        // A SyncManager that was switched off under the reading did not keep its buffer from being written.
        if Events(self.esc.events().await?).any(Events::SYNC_MANAGER_CHANGED)
            && !self.sync_managers_changed().await?
        {
            return Ok(());
        }
        self.images.outputs_valid = true;
        match self.al.state() {
            AlState::Op => self.hand_out(),
            // In SafeOp outputs are kept, but have no effect.
            _ if self.op_deadline.is_some() => self.op_with_outputs().await?,
            _ => {}
        }
        Ok(())
    }

    pub(super) fn hand_out(&mut self) {
        self.images.hand_out(self.device, &self.communication, &mut self.application);
    }

    pub(super) async fn write_inputs(&mut self) -> Result<(), EscError> {
        let inputs = self.images.gather(self.device, &self.communication, &mut self.application);
        if !inputs.is_empty() {
            self.esc.write(self.device.memory.start(Channel::Inputs), inputs).await?;
        }
        self.images.inputs_due = Instant::now() + FREE_RUN_CYCLE;
        Ok(())
    }
}
