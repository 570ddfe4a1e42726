//! Distributed clocks: outputs and inputs at the SYNC signals, and supervision of these (ETG.1020, "Synchronization").

use embassy_futures::select::{Either3, select, select3};
use embassy_time::{Duration, Instant, Timer};

use super::{SubDevice, Woken};
use crate::al_state::{AlState, AlStatusCode};
use crate::application::Application;
use crate::clocks::{Cycle, Ended, Offer, SyncSignals};
use crate::esc::{Esc, EscError};
use crate::sync_manager::Channel;

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// The same with the SYNC signals at the processor's pins. Without them distributed clocks are refused, whatever the device's
    /// table offers.
    #[must_use]
    pub fn with_sync(mut self, signals: Option<&'static SyncSignals>) -> Self {
        self.clocks.signals = signals;
        self.communication.offer = self.sync_offer();
        self
    }

    /// What the device's table offers, if there are signals.
    pub(super) fn sync_offer(&self) -> Offer {
        self.clocks.signals.map_or(Offer::default(), |_| self.device.sync_offer())
    }

    /// Waits for the controller's interrupt, a pulse, or the next deadline.
    pub(super) async fn wake_up(&self, attention: &mut impl AsyncFnMut(), until: Instant) -> Woken {
        let pulse = SyncSignals::pulsed(self.clocks.awaited());
        // An interrupt is served after the pulses; behind them it would wait for the end of a noisy signal.
        match select3(attention(), pulse, Timer::at(until)).await {
            Either3::First(()) => Woken::Interrupt,
            Either3::Second(()) => Woken::Pulse,
            Either3::Third(()) => Woken::Time,
        }
    }

    /// Switches to distributed clocks with `cycle`, or away from them.
    pub(super) fn use_clocks(&mut self, cycle: Option<Cycle>) {
        self.clocks.start(cycle);
        self.communication.timing.cycle = cycle;
    }

    /// Serves pulses of the SYNC signals that have come, and notices when none come.
    pub(super) async fn serve_pulses(&mut self) -> Result<(), EscError> {
        if !self.clocks.are_used() {
            return Ok(());
        }
        let due = self.clocks.take_due(self.data_bytes(Channel::Outputs) > 0);
        let in_op = self.al.state() == AlState::Op;
        let enters_op = due.ended.is_some() && self.op_deadline.is_some() && self.clocks.are_in_step();
        // Before anything that takes time.
        if due.outputs && in_op || enters_op {
            self.hand_out();
        }
        if due.inputs {
            self.write_inputs().await?;
        }
        match due.ended {
            Some(ended) if in_op => self.cycle_ended(ended).await?,
            Some(_) if enters_op => {
                self.clocks.begin_op();
                self.enter_op().await?;
            }
            _ => {}
        }
        if self.al.state() == AlState::Op && !self.clocks.are_alive() {
            self.fall(AlState::SafeOp, AlStatusCode::FatalSyncError).await?;
        }
        Ok(())
    }

    /// Judges a cycle in Op.
    async fn cycle_ended(&mut self, ended: Ended) -> Result<(), EscError> {
        let timing = &mut self.communication.timing;
        let code = match ended {
            Ended::Overrun => {
                timing.cycle_too_small = timing.cycle_too_small.saturating_add(1);
                AlStatusCode::SyncIoError
            }
            Ended::Good | Ended::NoOutputs => AlStatusCode::SyncTimeout,
        };
        timing.note_missed(ended == Ended::NoOutputs);
        timing.sync_error = self.clocks.errors() > 0;
        match self.communication.sync_errors_max {
            0 => Ok(()),
            most if self.clocks.errors() <= most => Ok(()),
            _ => self.fall(AlState::SafeOp, code).await,
        }
    }

    /// Why Op is not reached in time.
    pub(super) fn op_refusal(&self) -> AlStatusCode {
        match self.clocks.are_used() {
            true if !self.clocks.are_alive() => AlStatusCode::NoSyncError,
            true if self.images.outputs_valid => AlStatusCode::PllError,
            _ => AlStatusCode::SyncManagerWatchdog,
        }
    }

    /// Lets the next pulse of SYNC0 pass if a message would take until then: outputs do not wait for mail.
    pub(super) async fn let_pulse_pass(&mut self) -> Result<(), EscError> {
        let Some(next) = self.clocks.next() else { return Ok(()) };
        let mailbox = self.device.memory.mailbox_bytes;
        let takes = self.esc.cycle_cost(mailbox, mailbox, false).nanos(self.application.cycle_fixed_ns());
        let takes = Duration::from_nanos(takes.into());
        let now = Instant::now();
        if next <= now || now + takes < next {
            return Ok(());
        }
        // One that is late is not waited for.
        let pulse = SyncSignals::pulsed(self.clocks.awaited());
        select(pulse, Timer::at(next + takes)).await;
        self.serve_pulses().await
    }
}
