//! State changes requested by the MainDevice, and their preconditions (ETG.1000.6, clause 6.4.1).

use embassy_time::Instant;

use super::{OUTPUTS_WAIT, SubDevice};
use crate::al_state::{AlControl, AlMachine, AlState, AlStatusCode, Step};
use crate::application::Application;
use crate::clocks::SyncUnit;
use crate::coe::Coe;
use crate::coe::emergency::Cause;
use crate::eoe::Ethernet;
use crate::esc::{Esc, EscError};
use crate::foe::FileAccess;
use crate::registers::{AL_CONTROL, AL_STATUS, AL_STATUS_CODE, STATION_ALIAS, SYNC_MANAGERS_PRESENT};
use crate::sync_manager::{Channel, SYNC_MANAGERS_MAX};

/// Why a state was not reached.
enum Failure {
    /// The code is reported to the MainDevice.
    Refused(AlStatusCode),
    /// The controller failed.
    Esc(EscError),
}

impl From<EscError> for Failure {
    fn from(error: EscError) -> Self {
        Self::Esc(error)
    }
}

impl From<AlStatusCode> for Failure {
    fn from(code: AlStatusCode) -> Self {
        Self::Refused(code)
    }
}

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// Takes over the controller: in Init, with all SyncManagers off, and with an error if the controller or the SubDevice was in
    /// another state before.
    pub async fn start(&mut self) -> Result<(), EscError> {
        let mut present = [0; 2];
        self.esc.read(SYNC_MANAGERS_PRESENT, &mut present).await?;
        let [sync_managers, memory_kib] = present;
        (self.sync_managers, self.memory_kib) = (sync_managers.min(SYNC_MANAGERS_MAX), memory_kib);
        self.communication.outputs.room = self.room(Channel::Outputs);
        self.communication.inputs.room = self.room(Channel::Inputs);
        let before = self.read_word(AL_STATUS).await? & 0x0f;
        let fell = before != AlState::Init as u16 || self.al.state() != AlState::Init;
        let fault = fell.then_some(AlStatusCode::RestartedLocally).or(self.al.fault());
        for channel in Channel::ALL {
            self.switch(channel, false).await?;
        }
        self.al = AlMachine::new(fault);
        self.entered(AlState::Init);
        self.op_deadline = None;
        self.use_clocks(None);
        self.mask = None;
        self.proved = Instant::now();
        self.write_status().await
    }

    /// Handles a state request.
    pub(super) async fn al_control(&mut self) -> Result<(), EscError> {
        let control = AlControl(self.read_word(AL_CONTROL).await?);
        let faulty = self.al.fault().is_some();
        self.op_deadline = None;
        match self.al.request(control) {
            Step::Ignore => return Ok(()),
            Step::Stay => {}
            Step::Down(state) => {
                self.go_down(state).await?;
                self.al.reached(state);
                self.entered(state);
            }
            Step::Up(state) => self.go_up(state).await?,
        }
        if faulty && self.al.fault().is_none() {
            self.coe.emergencies.clear();
        }
        if control.asks_identification() {
            let id = match self.application.identification() {
                Some(id) => id,
                None => self.read_word(STATION_ALIAS).await?,
            };
            // 0 means no identification.
            if id != 0 {
                self.al.identify(id);
            }
        }
        self.write_status().await
    }

    async fn go_up(&mut self, state: AlState) -> Result<(), EscError> {
        let prepared = match state {
            AlState::PreOp | AlState::Boot => self.prepare_mailboxes(state).await,
            AlState::SafeOp => self.prepare_safe_op().await,
            _ => self.prepare_op(),
        };
        match prepared {
            Ok(()) if self.op_deadline.is_some() => {}
            Ok(()) => {
                self.al.reached(state);
                self.entered(state);
            }
            Err(Failure::Refused(code)) => self.refuse(state, code),
            Err(Failure::Esc(error)) => return Err(error),
        }
        Ok(())
    }

    fn refuse(&mut self, state: AlState, code: AlStatusCode) {
        self.al.refused(code);
        match state {
            AlState::SafeOp => self.report(Cause::SafeOpRefused, code),
            AlState::Op => self.report(Cause::OpRefused, code),
            _ => {}
        }
    }

    async fn prepare_mailboxes(&mut self, state: AlState) -> Result<(), Failure> {
        if state == AlState::Boot && self.device.files != FileAccess::WithBoot {
            return Err(AlStatusCode::BootNotSupported.into());
        }
        let found = self.read_sync_managers().await?;
        self.check_mailboxes(&found, state)?;
        self.application.may_enter(state)?;
        self.communication.follow(&self.application);
        let repeat = found[Channel::MailboxIn as usize].repeat();
        self.mailbox.start(self.device.memory.mailbox_bytes, repeat);
        self.coe = Coe::default();
        if let Some(ethernet) = self.application.ethernet() {
            ethernet.start();
        }
        self.switch(Channel::MailboxOut, true).await?;
        // The present repeat bit is no request, and is acknowledged at once.
        self.switch(Channel::MailboxIn, true).await?;
        Ok(())
    }

    async fn prepare_safe_op(&mut self) -> Result<(), Failure> {
        let unit = SyncUnit::read(&mut self.esc).await?;
        match self.communication.synchronisation() {
            _ if unit.is_on() => {}
            _ if self.communication.wants_clocks() => return Err(AlStatusCode::InvalidDcConfiguration.into()),
            None => return Err(AlStatusCode::SynchronisationNotSupported.into()),
            Some(_) => {}
        }
        self.application.may_enter(AlState::SafeOp)?;
        self.communication.follow(&self.application);
        for (channel, code) in [
            (Channel::Outputs, AlStatusCode::InvalidOutputMapping),
            (Channel::Inputs, AlStatusCode::InvalidInputMapping),
        ] {
            let (bytes, room) = (self.data_bytes(channel), self.room(channel));
            if bytes > room {
                self.application.memory_full(channel, bytes, room);
                return Err(code.into());
            }
        }
        let found = self.read_sync_managers().await?;
        self.check_process_data(&found)?;
        // By the PDOs that are assigned now.
        let cycle = unit.cycle(self.communication.offer, self.cycle_ns_min())?;
        self.use_clocks(cycle);
        (self.images.outputs_valid, self.images.outputs_due) = (false, false);
        self.communication.timing.reset();
        for channel in [Channel::Outputs, Channel::Inputs] {
            self.switch(channel, self.data_bytes(channel) > 0).await?;
        }
        // Without a first image, the MainDevice's reads would fail, and reduce the working counter.
        self.write_inputs().await?;
        Ok(())
    }

    /// Op needs outputs: sets the deadline if they have not arrived yet.
    fn prepare_op(&mut self) -> Result<(), Failure> {
        self.application.may_enter(AlState::Op)?;
        if self.clocks.are_used() {
            self.clocks.begin_op();
            self.op_deadline = Some(Instant::now() + OUTPUTS_WAIT);
            return Ok(());
        }
        if self.data_bytes(Channel::Outputs) == 0 {
            return Ok(());
        }
        if self.images.outputs_valid {
            self.hand_out();
        } else {
            self.op_deadline = Some(Instant::now() + OUTPUTS_WAIT);
        }
        Ok(())
    }

    /// Enters Op, as the outputs that it needs have arrived.
    pub(super) async fn op_with_outputs(&mut self) -> Result<(), EscError> {
        self.hand_out();
        self.enter_op().await
    }

    /// The same, with outputs that the application has.
    pub(super) async fn enter_op(&mut self) -> Result<(), EscError> {
        self.op_deadline = None;
        self.al.reached(AlState::Op);
        self.entered(AlState::Op);
        self.write_status().await
    }

    /// Refuses Op if the outputs are overdue.
    pub(super) async fn op_without_outputs(&mut self) -> Result<(), EscError> {
        if self.op_deadline.is_none_or(|deadline| Instant::now() < deadline) {
            return Ok(());
        }
        self.op_deadline = None;
        self.refuse(AlState::Op, self.op_refusal());
        self.write_status().await
    }

    /// The state has changed, with which a transfer of a file ends: the file may be open in the state before only.
    pub(super) fn entered(&mut self, state: AlState) {
        if let Some(files) = self.application.files() {
            self.foe.end(files);
        }
        self.application.entered(state);
    }

    /// Stops what a lower state does not have.
    pub(super) async fn go_down(&mut self, state: AlState) -> Result<(), EscError> {
        if self.al.state() == AlState::Op {
            self.application.outputs_stopped();
        }
        if !state.has_process_data() {
            self.use_clocks(None);
            self.switch(Channel::Outputs, false).await?;
            self.switch(Channel::Inputs, false).await?;
        }
        if !state.has_mailbox() {
            self.switch(Channel::MailboxOut, false).await?;
            self.switch(Channel::MailboxIn, false).await?;
        }
        Ok(())
    }

    pub(super) fn report(&mut self, cause: Cause, code: AlStatusCode) {
        let sends = self.device.emergencies || self.application.sends_emergencies();
        if sends && self.al.state().has_objects() {
            self.coe.emergencies.raise(cause, code);
        }
    }

    /// Order of writes: an error flag must never be visible without its code.
    pub(super) async fn write_status(&mut self) -> Result<(), EscError> {
        self.application.shows(self.al.indicators());
        let (status, code) = (self.al.status().to_le_bytes(), self.al.code().to_le_bytes());
        if self.al.code() != 0 {
            self.esc.write(AL_STATUS_CODE, &code).await?;
            self.esc.write(AL_STATUS, &status).await
        } else {
            self.esc.write(AL_STATUS, &status).await?;
            self.esc.write(AL_STATUS_CODE, &code).await
        }
    }

    pub(super) async fn read_word(&mut self, register: u16) -> Result<u16, EscError> {
        let mut word = [0; 2];
        self.esc.read(register, &mut word).await?;
        Ok(u16::from_le_bytes(word))
    }
}
