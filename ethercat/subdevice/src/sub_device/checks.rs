//! Checks of the SyncManagers' settings, and fallbacks to a lower state.

use super::SubDevice;
use crate::al_state::{AlState, AlStatusCode};
use crate::application::Application;
use crate::coe::emergency::Cause;
use crate::esc::{Esc, EscError};
use crate::registers::{SYNC_MANAGER_ACTIVATE, SYNC_MANAGER_BYTES, SYNC_MANAGERS, WATCHDOG_STATUS};
use crate::sync_manager::{Channel, SYNC_MANAGERS_USED, SyncManager};

/// The SyncManagers' registers.
pub(super) type SyncManagers = [SyncManager; SYNC_MANAGERS_USED];

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// Falls back to `state` with `code`.
    pub(super) async fn fall(&mut self, state: AlState, code: AlStatusCode) -> Result<(), EscError> {
        self.op_deadline = None;
        self.go_down(state).await?;
        self.al.fell(state, code);
        self.report(Cause::ProcessDataLost, code);
        self.entered(state);
        self.write_status().await
    }

    /// Handles the process data watchdog's event.
    pub(super) async fn watchdog(&mut self) -> Result<(), EscError> {
        let expired = self.read_word(WATCHDOG_STATUS).await? & 1 == 0;
        if !expired {
            return Ok(());
        }
        (self.images.outputs_valid, self.images.outputs_due) = (false, false);
        match self.al.state() {
            AlState::Op => self.fall(AlState::SafeOp, AlStatusCode::SyncManagerWatchdog).await,
            _ => Ok(()),
        }
    }

    /// A SyncManager's activation was written: it may be off now, have been cleared, or request a repetition.
    pub(super) async fn sync_managers_changed(&mut self) -> Result<(), EscError> {
        let found = self.read_sync_managers().await?;
        let state = self.al.state();
        if !state.has_mailbox() {
            return Ok(());
        }
        if let Err(code) = self.check_mailboxes(&found, state) {
            return self.fall(AlState::Init, code).await;
        }
        if state.has_process_data()
            && let Err(code) = self.check_process_data(&found)
        {
            return self.fall(AlState::PreOp, code).await;
        }
        let [_, mailbox, outputs, inputs] = found;
        self.images.outputs_due &= outputs.was_written();
        if state.has_process_data() && self.data_bytes(Channel::Inputs) > 0 && !inputs.was_written() {
            self.write_inputs().await?;
        }
        if !mailbox.is_full() {
            self.mailbox.fetched();
        }
        match self.mailbox.is_repeat(mailbox.repeat()) {
            true => self.repeat_message(mailbox.repeat()).await,
            false => Ok(()),
        }
    }

    /// Checks the mailboxes, which are the same in every `state` that has them.
    pub(super) fn check_mailboxes(&self, found: &SyncManagers, state: AlState) -> Result<(), AlStatusCode> {
        let bytes = self.device.memory.mailbox_bytes;
        let out = self.check(found, Channel::MailboxOut, bytes);
        out.and_then(|()| self.check(found, Channel::MailboxIn, bytes)).map_err(|code| match state {
            AlState::Boot => AlStatusCode::InvalidBootMailbox,
            _ => code,
        })
    }

    pub(super) fn check_process_data(&self, found: &SyncManagers) -> Result<(), AlStatusCode> {
        self.check(found, Channel::Outputs, self.data_bytes(Channel::Outputs))?;
        self.check(found, Channel::Inputs, self.data_bytes(Channel::Inputs))
    }

    fn check(&self, found: &SyncManagers, channel: Channel, bytes: u16) -> Result<(), AlStatusCode> {
        found[channel as usize].check(channel, self.device.memory.start(channel), bytes)
    }

    /// Reads the SyncManagers, including unused ones: only reading all of them clears the change event.
    pub(super) async fn read_sync_managers(&mut self) -> Result<SyncManagers, EscError> {
        let mut bytes = [0; 8 * SYNC_MANAGERS_USED];
        self.esc.read(SYNC_MANAGERS, &mut bytes).await?;
        for unused in SYNC_MANAGERS_USED as u16..self.sync_managers.into() {
            let block = SYNC_MANAGERS + SYNC_MANAGER_BYTES * unused;
            self.esc.read(block + SYNC_MANAGER_ACTIVATE, &mut [0]).await?;
        }
        let mut blocks = bytes.as_chunks::<8>().0.iter();
        Ok([(); SYNC_MANAGERS_USED].map(|()| {
            blocks.next().map_or_else(SyncManager::default, |&block| SyncManager::from_bytes(block))
        }))
    }
}
