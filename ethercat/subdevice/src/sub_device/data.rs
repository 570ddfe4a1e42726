//! Process data: outputs as they come, inputs when they are due.

use embassy_time::Instant;

use super::{FREE_RUN_CYCLE, Seen, SubDevice};
use crate::al_state::AlState;
use crate::application::Application;
use crate::esc::{Esc, EscError, agree, read_agreed};
use crate::registers::Events;
use crate::sync_manager::Channel;

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// The events, and new outputs with them.
    pub(super) async fn read_outputs_ahead(&mut self) -> Result<Events, EscError> {
        let bytes = usize::from(self.data_bytes(Channel::Outputs));
        let start = self.device.memory.start(Channel::Outputs);
        let image = self.images.outputs.get_mut(..bytes).unwrap_or_default();
        let events = Events(self.esc.outputs(start, image).await?);
        // They are none before they are known to be whole.
        self.images.outputs_valid &= !events.any(Events::OUTPUTS_WRITTEN);
        Ok(events)
    }

    /// Takes outputs, which were read `ahead` or not, and gives inputs; what was seen of the interrupt behind that.
    pub(super) async fn exchange_data(&mut self, events: Events, ahead: bool) -> Result<Seen, EscError> {
        if !self.al.state().has_process_data() {
            return Ok(Seen::Nothing);
        }
        let came = self.images.outputs_due;
        let seen = if came { self.take_outputs(ahead).await? } else { Seen::Nothing };
        let due = match self.runs_free() {
            true => Instant::now() >= self.images.inputs_due,
            false => came && !self.images.outputs_due || events.any(Events::INPUTS_FETCHED),
        };
        if due {
            self.write_inputs().await?;
        }
        Ok(seen)
    }

    /// Bytes of process data, as they are assigned.
    pub(super) fn data_bytes(&self, channel: Channel) -> u16 {
        let catalogue = self.catalogue();
        match channel {
            Channel::Inputs => self.communication.inputs.bytes(&catalogue),
            _ => self.communication.outputs.bytes(&catalogue),
        }
    }

    /// The most bytes of process data: as planned, as the controller's memory holds them three times, and as there is a buffer for.
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

    /// Takes outputs, unless a SyncManager was changed meanwhile: one that was switched off did not keep its buffer from being
    /// written. They stay due then, until it is known what was changed.
    async fn take_outputs(&mut self, ahead: bool) -> Result<Seen, EscError> {
        self.images.outputs_valid = false;
        self.read_outputs(ahead).await?;
        let mut seen = Seen::Quiet;
        if self.esc.asks().await? {
            seen = Seen::DirectRequestState;
            let events = Events(self.esc.events().await?);
            if events.any(Events::SYNC_MANAGER_CHANGED) {
                return Ok(seen);
            }
            self.communication.note_missed(events.any(Events::OUTPUTS_WRITTEN));
        }
        (self.images.outputs_due, self.images.outputs_valid) = (false, true);
        match self.al.state() {
            AlState::Op => self.hand_out(),
            // In SafeOp outputs are kept, but have no effect.
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
        // What writing them takes does not add to the cycle.
        self.images.inputs_due = if next > now { next } else { now + FREE_RUN_CYCLE };
        Ok(())
    }
}
