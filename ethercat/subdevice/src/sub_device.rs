//! The SubDevice: serves a controller's events, one after the other.
//!
//! A pass reads the event register and does what it says: a request for a state (`states`), a changed SyncManager (`checks`), a message (`mail`), process data
//! (`data`). Which events raise the interrupt follows from what can be done about them, so a request that must wait for
//! room does not keep the interrupt up.

mod checks;
mod data;
mod mail;
mod states;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};

use crate::al_state::{AlMachine, AlState};
use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::coe::Coe;
use crate::communication::{Communication, Synchronisation};
use crate::device::Device;
use crate::esc::{CycleCost, Esc, EscError};
use crate::mailbox::Mailbox;
use crate::process::{INPUTS_BYTES, Images, OUTPUTS_BYTES};
use crate::registers::{AL_EVENT_MASK, Events};
use crate::sync_manager::Channel;

/// How long Op may wait for the first outputs.
pub const OUTPUTS_WAIT: Duration = Duration::from_millis(1_000);
/// How often inputs are renewed in free run.
pub const FREE_RUN_CYCLE: Duration = Duration::from_millis(1);
/// How often the application is asked whether a write has ended.
const WRITING_PAUSE: Duration = Duration::from_millis(1);
/// How often the application is asked for emergencies, while they are sent.
const EMERGENCY_PAUSE: Duration = Duration::from_millis(20);
/// How often the controller is looked at where it has nothing to tell: one that was lost cannot tell, and its PDI watchdog runs
/// out after 100 ms unless a MainDevice sets it.
pub const LOOK_INTERVAL: Duration = Duration::from_millis(50);
/// Looks at the events in a row at most, whatever a MainDevice does meanwhile.
const PASSES_MAX: usize = 64;
/// How long the controller is left alone when it did not answer.
pub const RESTART_PAUSE: Duration = Duration::from_millis(10);

/// PDI control: the SyncManager is off, and the repeat request that was served.
const PDI_CONTROL_OFF: u8 = 1 << 0;
const PDI_CONTROL_REPEAT: u8 = 1 << 1;

/// What was seen of the interrupt, behind all that clears events of process data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seen {
    /// Nobody looked.
    Nothing,
    /// It was not asked for.
    Quiet,
    /// It was asked for.
    DirectRequestState,
}

/// A SubDevice on a controller, for an application.
///
/// It has buffers for `OUTPUTS` and `INPUTS` bytes of process data. An image that is longer than they are, or than the controller's
/// memory holds, is refused: when PDOs are assigned by the abort code 06040042h, on the way to SafeOp by 0025h and 0024h.
pub struct SubDevice<E, A, const OUTPUTS: usize = OUTPUTS_BYTES, const INPUTS: usize = INPUTS_BYTES> {
    device: &'static Device,
    esc: E,
    application: A,
    /// How many SyncManagers the controller has.
    sync_managers: u8,
    /// How many KiB of process memory.
    memory_kib: u8,
    al: AlMachine,
    communication: Communication,
    mailbox: Mailbox,
    coe: Coe,
    images: Images<OUTPUTS, INPUTS>,
    /// The events that raise the interrupt, as far as the controller was told.
    mask: Option<Events>,
    /// When the controller last proved that it is the one that was started.
    proved: Instant,
    /// Op was asked for, and waits for outputs until then.
    op_deadline: Option<Instant>,
}

impl<E: Esc, A: Application> SubDevice<E, A> {
    /// A SubDevice that is what `device` says, with buffers as images in a controller of 4 KiB need.
    pub fn new(device: &'static Device, esc: E, application: A) -> Self {
        Self::with_buffers(device, esc, application)
    }
}

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// The same with other buffers: `SubDevice::<_, _, 1500, 1486>::with_buffers(...)`.
    pub fn with_buffers(device: &'static Device, esc: E, application: A) -> Self {
        Self {
            device,
            esc,
            application,
            sync_managers: 0,
            memory_kib: 0,
            al: AlMachine::new(None),
            communication: Communication::new(device),
            mailbox: Mailbox::default(),
            coe: Coe::default(),
            images: Images::default(),
            mask: None,
            proved: Instant::MIN,
            op_deadline: None,
        }
    }

    /// The state it is in.
    pub fn state(&self) -> AlState {
        self.al.state()
    }

    /// What a cycle of process data costs on the way to the controller, as PDOs are assigned.
    pub fn cycle_cost(&self) -> CycleCost {
        let bytes = |channel| self.data_bytes(channel);
        let proves = self.application.proves_outputs();
        self.esc.cycle_cost(bytes(Channel::Outputs), bytes(Channel::Inputs), proves)
    }

    /// The shortest cycle in which no outputs are missed (1C32h:05): what it costs, and what the application takes beside that.
    pub fn cycle_ns_min(&self) -> u32 {
        self.cycle_cost().nanos(self.application.cycle_fixed_ns())
    }

    /// How often outputs came before those before them were taken, since SafeOp was entered (1C32h:0B).
    pub fn outputs_missed(&self) -> u16 {
        self.communication.timing.missed_events
    }

    /// The controller.
    pub fn esc(&mut self) -> &mut E {
        &mut self.esc
    }

    fn catalogue(&self) -> Catalogue<'_, A> {
        Catalogue { device: self.device, application: &self.application }
    }

    /// The application.
    pub fn application(&mut self) -> &mut A {
        &mut self.application
    }

    /// Serves the controller for ever. `attention` waits for the controller's interrupt (a level), or for as long as may pass
    /// between two looks where there is none. A controller that fails is started anew.
    pub async fn run(&mut self, mut attention: impl AsyncFnMut()) -> ! {
        loop {
            self.run_until_fault(&mut attention).await;
            Timer::after(RESTART_PAUSE).await;
        }
    }

    /// [`run`](Self::run) until the controller fails, or the application is another device's.
    pub async fn run_until_fault(&mut self, attention: &mut impl AsyncFnMut()) {
        if let Err(fault) = self.serve_until_fault(attention).await {
            self.application.failed(fault);
        }
        self.application.outputs_stopped();
    }

    /// Is what `device` says from its next start on.
    pub fn become_device(&mut self, device: &'static Device) {
        (self.device, self.communication) = (device, Communication::new(device));
    }

    async fn serve_until_fault(&mut self, attention: &mut impl AsyncFnMut()) -> Result<(), EscError> {
        self.start().await?;
        let mut asked = false;
        loop {
            self.serve_asked(asked).await?;
            if self.application.is_another_device() {
                return Ok(());
            }
            let look = Instant::now() + LOOK_INTERVAL;
            let due = self.due().map_or(look, |due| due.min(look));
            asked = matches!(select(attention(), Timer::at(due)).await, Either::First(()));
        }
    }

    /// Does all that there is to do now. [`start`](Self::start) comes first.
    pub async fn serve(&mut self) -> Result<(), EscError> {
        self.serve_asked(false).await
    }

    /// The same. If the controller `asked` for it, that is for new outputs, most of the time.
    async fn serve_asked(&mut self, asked: bool) -> Result<(), EscError> {
        let mut ahead = asked && self.al.state() == AlState::Op && self.data_bytes(Channel::Outputs) > 0;
        // An interrupt that is still asked for is told of again, or found by the next look.
        for _ in 0..PASSES_MAX {
            if !self.pass(core::mem::take(&mut ahead)).await? {
                break;
            }
        }
        self.update_mask().await
    }

    /// Looks whether the controller is the one that was started, unless its interrupt has just shown that: one that was reset
    /// does not know any more what to interrupt for.
    async fn prove(&mut self) -> Result<(), EscError> {
        if self.proved.elapsed() < LOOK_INTERVAL {
            return Ok(());
        }
        let mut mask = [0; 4];
        self.esc.read(AL_EVENT_MASK, &mut mask).await?;
        if self.mask != Some(Events(u32::from_le_bytes(mask))) {
            return Err(EscError::Restarted);
        }
        self.proved = Instant::now();
        Ok(())
    }

    /// When something is due without an event, beside the look after [`LOOK_INTERVAL`].
    pub fn due(&self) -> Option<Instant> {
        let inputs = self.runs_free().then_some(self.images.inputs_due);
        let writes = self.al.state().has_mailbox() && self.coe.is_writing();
        let written = writes.then(|| Instant::now() + WRITING_PAUSE);
        let emergencies = self.al.state().has_mailbox() && self.application.sends_emergencies();
        let emergency = emergencies.then(|| Instant::now() + EMERGENCY_PAUSE);
        [inputs, self.op_deadline, written, emergency].into_iter().flatten().min()
    }

    /// Does what one look at the events asks for, with outputs read `ahead` or not; false when the interrupt is not asked for
    /// any more: until then a processor that is woken by edges would not be woken again.
    async fn pass(&mut self, ahead: bool) -> Result<bool, EscError> {
        let events = match ahead {
            true => self.read_outputs_ahead().await?,
            false => Events(self.esc.events().await?),
        };
        // Before anything is done about them: a chip that was reset has events as well, but does not tell them.
        match ahead && self.mask.is_some_and(|mask| events.any(mask)) {
            true => self.proved = Instant::now(),
            false => self.prove().await?,
        }
        self.images.outputs_due |= events.any(Events::OUTPUTS_WRITTEN);
        if events.any(Events::AL_CONTROL) {
            self.al_control().await?;
            return Ok(true);
        }
        if events.any(Events::SYNC_MANAGER_CHANGED) {
            self.sync_managers_changed().await?;
            return Ok(true);
        }
        if events.any(Events::WATCHDOG) {
            self.watchdog().await?;
        }
        let seen = self.exchange_data(events, ahead).await?;
        self.op_without_outputs().await?;
        match seen {
            // What the events say may have changed meanwhile.
            Seen::DirectRequestState => Ok(true),
            Seen::Quiet => self.exchange_mail(events).await,
            Seen::Nothing => Ok(self.exchange_mail(events).await? || events.any(self.wanted())),
        }
    }

    fn runs_free(&self) -> bool {
        self.al.state().has_process_data()
            && self.communication.synchronisation() == Some(Synchronisation::FreeRun)
    }

    /// The events that something can be done about now.
    fn wanted(&self) -> Events {
        let data = self.al.state().has_process_data();
        // In Op inputs follow the outputs, as far as that was asked for.
        let follow =
            self.al.state() == AlState::Op && self.communication.inputs_follow_outputs(&self.catalogue());
        Events(Events::AL_CONTROL.0 | Events::SYNC_MANAGER_CHANGED.0)
            .with_if(self.takes_requests(), Events::MAILBOX_WRITTEN)
            .with_if(self.waits_for_mailbox(), Events::MAILBOX_FETCHED)
            .with_if(data, Events(Events::WATCHDOG.0 | Events::OUTPUTS_WRITTEN.0))
            .with_if(data && !self.runs_free() && !follow, Events::INPUTS_FETCHED)
    }

    async fn update_mask(&mut self) -> Result<(), EscError> {
        let mask = self.wanted();
        if self.mask != Some(mask) {
            self.esc.write(AL_EVENT_MASK, &mask.0.to_le_bytes()).await?;
            self.mask = Some(mask);
        }
        Ok(())
    }

    /// Lets a SyncManager work, or not. What was acknowledged stays so.
    async fn switch(&mut self, channel: Channel, on: bool) -> Result<(), EscError> {
        let repeat = channel == Channel::MailboxIn && self.mailbox.acknowledged();
        let off = if on { 0 } else { PDI_CONTROL_OFF };
        self.esc.write(channel.pdi_control(), &[off | if repeat { PDI_CONTROL_REPEAT } else { 0 }]).await
    }
}
