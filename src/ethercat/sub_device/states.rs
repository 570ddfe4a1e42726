//! Changes of state: what each needs, and what the device falls back for by itself (ETG.1000.6, clause 6.4.1).

use embassy_time::Instant;

use super::{OUTPUTS_WAIT, SubDevice};
use crate::ethercat::al_state::{AlControl, AlMachine, AlState, AlStatusCode, Step};
use crate::ethercat::application::Application;
use crate::ethercat::coe::Coe;
use crate::ethercat::coe::emergency::Cause;
use crate::ethercat::esc::{Esc, EscError};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AL_STATUS_CODE, DC_ACTIVATION, STATION_ALIAS, SYNC_MANAGER_STATUS, SYNC_MANAGERS,
    WATCHDOG_STATUS,
};
use crate::ethercat::sync_manager::{Channel, SYNC_MANAGERS_USED, SyncManager};

/// A SyncManager's status: the mailbox is full.
const MAILBOX_FULL: u8 = 1 << 3;
/// PDI control: the repeat request was served.
const REPEAT_ACKNOWLEDGE: u8 = 1 << 1;

/// Why a state was not reached.
enum Failure {
    /// The MainDevice is told.
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

/// The SyncManagers' registers, and whether SM1 is full.
struct SyncManagers {
    channels: [SyncManager; SYNC_MANAGERS_USED],
    mailbox_full: bool,
}

impl<E: Esc, A: Application> SubDevice<E, A> {
    /// Takes the controller over: in Init, all SyncManagers off, with an error if there was another state before, in the
    /// controller or here.
    pub async fn start(&mut self) -> Result<(), EscError> {
        let before = self.read_word(AL_STATUS).await? & 0x0f;
        let fell = before != AlState::Init as u16 || self.al.state() != AlState::Init;
        let fault = fell.then_some(AlStatusCode::RestartedLocally).or(self.al.fault());
        for channel in Channel::ALL {
            self.switch(channel, false).await?;
        }
        self.al = AlMachine::new(fault);
        self.op_deadline = None;
        self.mask = None;
        self.write_status().await
    }

    /// Takes a request for a state.
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
                self.application.entered(state);
            }
            Step::Up(state) => self.go_up(state).await?,
        }
        if faulty && self.al.fault().is_none() {
            self.coe.emergencies.clear();
        }
        if control.asks_identification() {
            let alias = self.read_word(STATION_ALIAS).await?;
            self.al.identify(alias);
        }
        self.write_status().await
    }

    async fn go_up(&mut self, state: AlState) -> Result<(), EscError> {
        let prepared = match state {
            AlState::PreOp => self.prepare_pre_op().await,
            AlState::SafeOp => self.prepare_safe_op().await,
            _ => self.prepare_op(),
        };
        match prepared {
            Ok(()) if self.op_deadline.is_some() => {}
            Ok(()) => {
                self.al.reached(state);
                self.application.entered(state);
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

    async fn prepare_pre_op(&mut self) -> Result<(), Failure> {
        let found = self.read_sync_managers().await?;
        self.check_mailboxes(&found)?;
        self.application.may_enter(AlState::PreOp)?;
        let repeat = found.channels[Channel::MailboxIn as usize].repeat();
        self.mailbox.start(self.device.memory.mailbox_bytes, repeat);
        self.coe = Coe::default();
        self.switch(Channel::MailboxOut, true).await?;
        self.acknowledge_repeat(repeat).await?;
        Ok(())
    }

    async fn prepare_safe_op(&mut self) -> Result<(), Failure> {
        let mut activation = [0];
        self.esc.read(DC_ACTIVATION, &mut activation).await?;
        if activation[0] & 1 != 0 {
            return Err(AlStatusCode::InvalidDcConfiguration.into());
        }
        self.communication.synchronisation().ok_or(AlStatusCode::SynchronisationNotSupported)?;
        let found = self.read_sync_managers().await?;
        self.check_process_data(&found)?;
        self.application.may_enter(AlState::SafeOp)?;
        self.images.outputs_valid = false;
        for channel in [Channel::Outputs, Channel::Inputs] {
            self.switch(channel, self.data_bytes(channel) > 0).await?;
        }
        // Without a first image the MainDevice's reads would fail, and the working counter with them.
        self.write_inputs().await?;
        Ok(())
    }

    /// Op needs outputs: the deadline is set if they have not come yet.
    fn prepare_op(&mut self) -> Result<(), Failure> {
        self.application.may_enter(AlState::Op)?;
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

    /// The outputs came that Op waited for.
    pub(super) async fn op_with_outputs(&mut self) -> Result<(), EscError> {
        self.op_deadline = None;
        self.hand_out();
        self.al.reached(AlState::Op);
        self.application.entered(AlState::Op);
        self.write_status().await
    }

    /// Refuses Op if the outputs took too long.
    pub(super) async fn op_without_outputs(&mut self) -> Result<(), EscError> {
        if self.op_deadline.is_none_or(|deadline| Instant::now() < deadline) {
            return Ok(());
        }
        self.op_deadline = None;
        self.refuse(AlState::Op, AlStatusCode::SyncManagerWatchdog);
        self.write_status().await
    }

    /// Ends what a lower state does not have.
    async fn go_down(&mut self, state: AlState) -> Result<(), EscError> {
        if self.al.state() == AlState::Op {
            self.application.outputs_stopped();
        }
        if !state.has_process_data() {
            self.switch(Channel::Outputs, false).await?;
            self.switch(Channel::Inputs, false).await?;
        }
        if !state.has_mailbox() {
            self.switch(Channel::MailboxOut, false).await?;
            self.switch(Channel::MailboxIn, false).await?;
        }
        Ok(())
    }

    /// Falls back to `state`, and says why.
    async fn fall(&mut self, state: AlState, code: AlStatusCode) -> Result<(), EscError> {
        self.op_deadline = None;
        self.go_down(state).await?;
        self.al.fell(state, code);
        self.report(Cause::ProcessDataLost, code);
        self.application.entered(state);
        self.write_status().await
    }

    fn report(&mut self, cause: Cause, code: AlStatusCode) {
        if self.device.emergencies && self.al.state().has_mailbox() {
            self.coe.emergencies.raise(cause, code);
        }
    }

    /// The process data watchdog's event.
    pub(super) async fn watchdog(&mut self) -> Result<(), EscError> {
        let expired = self.read_word(WATCHDOG_STATUS).await? & 1 == 0;
        if !expired {
            return Ok(());
        }
        self.images.outputs_valid = false;
        match self.al.state() {
            AlState::Op => self.fall(AlState::SafeOp, AlStatusCode::SyncManagerWatchdog).await,
            _ => Ok(()),
        }
    }

    /// Some SyncManager's activation was written: it may be off now, or ask for a repetition.
    pub(super) async fn sync_managers_changed(&mut self) -> Result<(), EscError> {
        let found = self.read_sync_managers().await?;
        let state = self.al.state();
        if !state.has_mailbox() {
            return Ok(());
        }
        if let Err(code) = self.check_mailboxes(&found) {
            return self.fall(AlState::Init, code).await;
        }
        if state.has_process_data()
            && let Err(code) = self.check_process_data(&found)
        {
            return self.fall(AlState::PreOp, code).await;
        }
        if !found.mailbox_full {
            self.mailbox.fetched();
        }
        let repeat = found.channels[Channel::MailboxIn as usize].repeat();
        if self.mailbox.is_repeat(repeat) { self.repeat_message(repeat).await } else { Ok(()) }
    }

    /// Tells the MainDevice that its repeat request was served.
    pub(super) async fn acknowledge_repeat(&mut self, repeat: bool) -> Result<(), EscError> {
        let acknowledge = if repeat { REPEAT_ACKNOWLEDGE } else { 0 };
        self.esc.write(Channel::MailboxIn.pdi_control(), &[acknowledge]).await
    }

    fn check_mailboxes(&self, found: &SyncManagers) -> Result<(), AlStatusCode> {
        let bytes = self.device.memory.mailbox_bytes;
        self.check(found, Channel::MailboxOut, bytes)?;
        self.check(found, Channel::MailboxIn, bytes)
    }

    fn check_process_data(&self, found: &SyncManagers) -> Result<(), AlStatusCode> {
        self.check(found, Channel::Outputs, self.data_bytes(Channel::Outputs))?;
        self.check(found, Channel::Inputs, self.data_bytes(Channel::Inputs))
    }

    fn check(&self, found: &SyncManagers, channel: Channel, bytes: u16) -> Result<(), AlStatusCode> {
        found.channels[channel as usize].check(channel, self.device.memory.start(channel), bytes)
    }

    /// Reading all of them also clears the event that one was changed.
    async fn read_sync_managers(&mut self) -> Result<SyncManagers, EscError> {
        let mut bytes = [0; 8 * SYNC_MANAGERS_USED];
        self.esc.read(SYNC_MANAGERS, &mut bytes).await?;
        let mut blocks = bytes.as_chunks::<8>().0.iter();
        let channels = [(); SYNC_MANAGERS_USED].map(|()| {
            blocks.next().map_or_else(SyncManager::default, |&block| SyncManager::from_bytes(block))
        });
        let status = bytes[8 * Channel::MailboxIn as usize + SYNC_MANAGER_STATUS as usize];
        Ok(SyncManagers { channels, mailbox_full: status & MAILBOX_FULL != 0 })
    }

    /// No flag is ever seen without its code: the code comes first, and goes last.
    async fn write_status(&mut self) -> Result<(), EscError> {
        let (status, code) = (self.al.status().to_le_bytes(), self.al.code().to_le_bytes());
        if self.al.code() != 0 {
            self.esc.write(AL_STATUS_CODE, &code).await?;
            self.esc.write(AL_STATUS, &status).await
        } else {
            self.esc.write(AL_STATUS, &status).await?;
            self.esc.write(AL_STATUS_CODE, &code).await
        }
    }

    async fn read_word(&mut self, register: u16) -> Result<u16, EscError> {
        let mut word = [0; 2];
        self.esc.read(register, &mut word).await?;
        Ok(u16::from_le_bytes(word))
    }
}
