//! Process data: outputs as they arrive, inputs when due.

use embassy_time::Instant;

use super::{FREE_RUN_CYCLE, Seen, SubDevice};
use crate::al_state::AlState;
use crate::application::Application;
use crate::esc::{Esc, EscError, agree, read_agreed};
use crate::registers::Events;
use crate::sync_manager::Channel;

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// Reads the events together with new outputs.
    pub(super) async fn read_outputs_ahead(&mut self) -> Result<Events, EscError> {
        let bytes = usize::from(self.data_bytes(Channel::Outputs));
        let start = self.device.memory.start(Channel::Outputs);
        let image = self.images.outputs.get_mut(..bytes).unwrap_or_default();
        let events = Events(self.esc.outputs(start, image).await?);
        // Invalid until verified.
        self.images.outputs_valid &= !events.any(Events::OUTPUTS_WRITTEN);
        Ok(events)
    }

    /// Takes outputs, read `ahead` or not, and writes inputs; returns the state of the interrupt afterwards.
    pub(super) async fn exchange_data(&mut self, events: Events, ahead: bool) -> Result<Seen, EscError> {
        if !self.al.state().has_process_data() {
            return Ok(Seen::Nothing);
        }
        let came = self.images.outputs_due;
        let seen = if came { self.take_outputs(ahead).await? } else { Seen::Nothing };
        let due = match self.runs_free() {
            true => Instant::now() >= self.images.inputs_due,
            false => {
                let fetched = events.any(Events::INPUTS_FETCHED);
                self.follows_frames() && (came && !self.images.outputs_due || fetched)
            }
        };
        if due {
            self.write_inputs().await?;
        }
        Ok(seen)
    }

    /// Bytes of process data, as assigned.
    pub(super) fn data_bytes(&self, channel: Channel) -> u16 {
        let catalogue = self.catalogue();
        match channel {
            Channel::Inputs => self.communication.inputs.bytes(&catalogue),
            _ => self.communication.outputs.bytes(&catalogue),
        }
    }

    /// Most bytes of process data: limited by the plan, by triple buffers in the controller's memory, and by the buffer.
    pub(super) fn room(&self, channel: Channel) -> u16 {
        let buffer = if channel == Channel::Inputs { INPUTS } else { OUTPUTS };
        let room = self.device.memory.room(channel, self.memory_kib);
        u16::try_from(buffer).map_or(room, |buffer| room.min(buffer))
    }

    async fn read_outputs(&mut self, ahead: bool) -> Result<(), EscError> {
        let bytes = usize::from(self.data_bytes(Channel::Outputs));
        let start = self.device.memory.start(Channel::Outputs);
        let image = self.images.outputs.get_mut(..bytes).unwrap_or_default();
        match (self.application.proves_outputs(), ahead) {
            (false, true) => Ok(()),
            (false, false) => self.esc.read(start, image).await,
            (true, true) => agree(&mut self.esc, start, image).await,
            (true, false) => read_agreed(&mut self.esc, start, image).await,
        }
    }

    /// Takes outputs, unless a SyncManager changed meanwhile: once switched off, it does not protect its buffer. The outputs then
    /// stay due until the change is known.
    async fn take_outputs(&mut self, ahead: bool) -> Result<Seen, EscError> {
        self.images.outputs_valid = false;
        self.clocks.outputs_change();
        self.read_outputs(ahead).await?;
        let mut seen = Seen::Quiet;
        if self.esc.asks().await? {
            seen = Seen::Asserted;
            let events = Events(self.esc.events().await?);
            if events.any(Events::SYNC_MANAGER_CHANGED) {
                return Ok(seen);
            }
            self.communication.timing.note_missed(events.any(Events::OUTPUTS_WRITTEN));
        }
        (self.images.outputs_due, self.images.outputs_valid) = (false, true);
        match self.al.state() {
            _ if self.clocks.are_used() => self.clocks.outputs_ready(),
            AlState::Op => self.hand_out(),
            // SafeOp stores outputs without effect.
            _ if self.op_deadline.is_some() => self.op_with_outputs().await?,
            _ => {}
        }
        Ok(seen)
    }

    pub(super) fn hand_out(&mut self) {
        self.images.hand_out(self.device, &self.communication, &mut self.application);
    }

    pub(super) async fn write_inputs(&mut self) -> Result<(), EscError> {
        let inputs = self.images.gather(self.device, &self.communication, &mut self.application);
        if !inputs.is_empty() {
            self.esc.write(self.device.memory.start(Channel::Inputs), inputs).await?;
        }
        let (now, next) = (Instant::now(), self.images.inputs_due + FREE_RUN_CYCLE);
        // The time for writing them does not lengthen the cycle.
        self.images.inputs_due = if next > now { next } else { now + FREE_RUN_CYCLE };
        Ok(())
    }
}
