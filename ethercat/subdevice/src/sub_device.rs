//! The SubDevice: serves a controller's events one by one.
//!
//! A pass reads the event register and dispatches: a state request (`states`), a changed SyncManager (`checks`), a message
//! (`mail`), process data (`data`). The interrupt mask contains only events that can be served now, so a request that must wait for
//! room does not hold the interrupt asserted.

mod checks;
mod clocked;
mod data;
mod mail;
mod states;

use embassy_time::{Duration, Instant, Timer};

use crate::al_state::{AlMachine, AlState};
use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::clocks::Clocks;
use crate::coe::Coe;
use crate::communication::{Communication, Synchronisation};
use crate::device::Device;
use crate::esc::{CycleCost, Esc, EscError};
use crate::foe::Foe;
use crate::mailbox::Mailbox;
use crate::process::{INPUTS_BYTES, Images, OUTPUTS_BYTES};
use crate::registers::{AL_EVENT_MASK, Events};
use crate::sync_manager::Channel;

/// How long Op waits for the first outputs.
pub const OUTPUTS_WAIT: Duration = Duration::from_millis(1_000);
/// Update period of inputs in free run.
pub const FREE_RUN_CYCLE: Duration = Duration::from_millis(1);
/// Interval at which the application is polled for the end of a write, or of its part in a file transfer, or for an Ethernet frame.
const WRITING_PAUSE: Duration = Duration::from_millis(1);
/// Interval at which the application is polled for emergencies, while they are enabled.
const EMERGENCY_PAUSE: Duration = Duration::from_millis(20);
/// Interval of liveness checks without events: a controller that was reset sends none, and its PDI watchdog expires after 100 ms
/// unless a MainDevice sets it.
pub const LOOK_INTERVAL: Duration = Duration::from_millis(50);
/// Most passes in a row, whatever a MainDevice does meanwhile.
const PASSES_MAX: usize = 64;

/// Why the SubDevice wakes up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Woken {
    /// By the controller's interrupt.
    Interrupt,
    /// By a SYNC signal.
    Pulse,
    /// Something else is due.
    Time,
}

/// Pause before a failed controller is restarted.
pub const RESTART_PAUSE: Duration = Duration::from_millis(10);

/// PDI control: SyncManager off, and acknowledgement of the repeat request.
const PDI_CONTROL_OFF: u8 = 1 << 0;
const PDI_CONTROL_REPEAT: u8 = 1 << 1;

/// State of the interrupt, after all accesses that clear process data events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seen {
    /// Not checked.
    Nothing,
    Quiet,
    Asserted,
}

/// A SubDevice on a controller, for an application.
///
/// It has buffers for `OUTPUTS` and `INPUTS` bytes of process data. An image that exceeds them, or the controller's memory, is
/// refused: during PDO assignment with abort code 06040042h, on the way to SafeOp with 0025h or 0024h.
pub struct SubDevice<E, A, const OUTPUTS: usize = OUTPUTS_BYTES, const INPUTS: usize = INPUTS_BYTES> {
    device: &'static Device,
    esc: E,
    application: A,
    /// Number of SyncManagers in the controller.
    sync_managers: u8,
    /// KiB of process memory.
    memory_kib: u8,
    al: AlMachine,
    communication: Communication,
    mailbox: Mailbox,
    coe: Coe,
    foe: Foe,
    images: Images<OUTPUTS, INPUTS>,
    clocks: Clocks,
    /// The interrupt mask as the controller has it.
    mask: Option<Events>,
    /// When the controller last proved that it was not reset.
    proved: Instant,
    /// Op was requested, and waits for outputs until then.
    op_deadline: Option<Instant>,
}

impl<E: Esc, A: Application> SubDevice<E, A> {
    /// A SubDevice described by `device`, with buffers for a controller of 4 KiB.
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
            foe: Foe::default(),
            images: Images::default(),
            clocks: Clocks::default(),
            mask: None,
            proved: Instant::MIN,
            op_deadline: None,
        }
    }

    /// The current state.
    pub fn state(&self) -> AlState {
        self.al.state()
    }

    /// Bus cost of a process data cycle with the present assignment.
    pub fn cycle_cost(&self) -> CycleCost {
        let bytes = |channel| self.data_bytes(channel);
        let proves = self.application.proves_outputs();
        self.esc.cycle_cost(bytes(Channel::Outputs), bytes(Channel::Inputs), proves)
    }

    /// The shortest cycle without missed outputs (1C32h:05): the bus cost plus the application's overhead.
    pub fn cycle_ns_min(&self) -> u32 {
        self.cycle_cost().nanos(self.application.cycle_fixed_ns())
    }

    /// The time to read outputs, from their frame on, and to write inputs (1C32h:06, 1C33h:06).
    fn copy_ns(&self) -> [u32; 2] {
        let (outputs, inputs) = (self.data_bytes(Channel::Outputs), self.data_bytes(Channel::Inputs));
        let proves = self.application.proves_outputs();
        let fixed = self.application.cycle_fixed_ns();
        [(outputs, 0, proves), (0, inputs, false)]
            .map(|(outputs, inputs, proves)| self.esc.cycle_cost(outputs, inputs, proves).nanos(fixed))
    }

    /// Number of outputs overwritten before they were taken, since SafeOp was entered (1C32h:0B).
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

    /// Serves the controller forever. `attention` waits for the controller's interrupt (a level), or without one for the polling
    /// interval. A failed controller is restarted.
    pub async fn run(&mut self, mut attention: impl AsyncFnMut()) -> ! {
        loop {
            self.run_until_fault(&mut attention).await;
            Timer::after(RESTART_PAUSE).await;
        }
    }

    /// [`run`](Self::run) until the controller fails, or the application changes to another device.
    pub async fn run_until_fault(&mut self, attention: &mut impl AsyncFnMut()) {
        if let Err(fault) = self.serve_until_fault(attention).await {
            self.application.failed(fault);
        }
        self.application.outputs_stopped();
    }

    /// Switches to `device` with its next start.
    pub fn become_device(&mut self, device: &'static Device) {
        (self.device, self.communication) = (device, Communication::new(device));
        self.communication.offer = self.sync_offer();
    }

    async fn serve_until_fault(&mut self, attention: &mut impl AsyncFnMut()) -> Result<(), EscError> {
        self.start().await?;
        let mut woken = Woken::Time;
        loop {
            match woken {
                // Nothing is asked of the controller.
                Woken::Pulse => {
                    self.serve_pulses().await?;
                    self.update_mask().await?;
                }
                Woken::Interrupt | Woken::Time => self.serve_asked(woken == Woken::Interrupt).await?,
            }
            if self.application.is_another_device() {
                return Ok(());
            }
            let look = Instant::now() + LOOK_INTERVAL;
            let due = self.due().map_or(look, |due| due.min(look));
            woken = self.wake_up(attention, due).await;
        }
    }

    /// Serves all pending events. Call [`start`](Self::start) first.
    pub async fn serve(&mut self) -> Result<(), EscError> {
        self.serve_asked(false).await
    }

    /// The same. If the controller `asked` for it, the event most likely announces new outputs.
    async fn serve_asked(&mut self, asked: bool) -> Result<(), EscError> {
        let has_outputs = self.al.state() == AlState::Op && self.data_bytes(Channel::Outputs) > 0;
        // Those that wait for SYNC0 are not overwritten without an event.
        let mut ahead = asked && has_outputs && !self.clocks.have_outputs();
        // An interrupt that is still asserted triggers again, or the next check finds it.
        for _ in 0..PASSES_MAX {
            self.serve_pulses().await?;
            if !self.pass(core::mem::take(&mut ahead)).await? {
                break;
            }
        }
        self.update_mask().await
    }

    /// Checks that the controller was not reset, unless its interrupt has just proved that: after a reset its interrupt mask is
    /// lost.
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

    /// Next deadline without an event, besides the check after [`LOOK_INTERVAL`].
    pub fn due(&mut self) -> Option<Instant> {
        let inputs = self.runs_free().then_some(self.images.inputs_due);
        let writes = self.al.state().has_objects() && self.coe.is_writing() || self.foe.is_working();
        // Frames come without a word, unless `attention` ends with one.
        let polls = writes || self.ethernet().is_some();
        let written = polls.then(|| Instant::now() + WRITING_PAUSE);
        let emergencies = self.al.state().has_objects() && self.application.sends_emergencies();
        let emergency = emergencies.then(|| Instant::now() + EMERGENCY_PAUSE);
        let sync = self.clocks.lost_at().filter(|_| self.al.state() == AlState::Op);
        [inputs, self.op_deadline, written, emergency, sync].into_iter().flatten().min()
    }

    /// Serves one read of the events, with outputs read `ahead` or not; returns false once the interrupt is deasserted: an
    /// edge-triggered processor would not wake again before that.
    async fn pass(&mut self, ahead: bool) -> Result<bool, EscError> {
        let events = match ahead {
            true => self.read_outputs_ahead().await?,
            false => Events(self.esc.events().await?),
        };
        // Before serving them: a reset chip also has events, but does not interrupt.
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
            // There may be new events.
            Seen::Asserted => Ok(true),
            Seen::Quiet => self.exchange_mail(events).await,
            Seen::Nothing => Ok(self.exchange_mail(events).await? || events.any(self.wanted())),
        }
    }

    fn runs_free(&self) -> bool {
        self.al.state().has_process_data()
            && self.communication.synchronisation() == Some(Synchronisation::FreeRun)
    }

    fn follows_frames(&self) -> bool {
        self.communication.synchronisation() == Some(Synchronisation::SyncManager)
    }

    /// The events that can be served now.
    fn wanted(&mut self) -> Events {
        let data = self.al.state().has_process_data();
        // In Op, inputs follow the outputs if so configured.
        let follow =
            self.al.state() == AlState::Op && self.communication.inputs_follow_outputs(&self.catalogue());
        Events(Events::AL_CONTROL.0 | Events::SYNC_MANAGER_CHANGED.0)
            .with_if(self.takes_requests(), Events::MAILBOX_WRITTEN)
            .with_if(self.waits_for_mailbox(), Events::MAILBOX_FETCHED)
            .with_if(data, Events(Events::WATCHDOG.0 | Events::OUTPUTS_WRITTEN.0))
            .with_if(data && self.follows_frames() && !follow, Events::INPUTS_FETCHED)
    }

    async fn update_mask(&mut self) -> Result<(), EscError> {
        let mask = self.wanted();
        if self.mask != Some(mask) {
            self.esc.write(AL_EVENT_MASK, &mask.0.to_le_bytes()).await?;
            self.mask = Some(mask);
        }
        Ok(())
    }

    /// Switches a SyncManager on or off. The repeat acknowledgement stays.
    async fn switch(&mut self, channel: Channel, on: bool) -> Result<(), EscError> {
        let repeat = channel == Channel::MailboxIn && self.mailbox.acknowledged();
        let off = if on { 0 } else { PDI_CONTROL_OFF };
        self.esc.write(channel.pdi_control(), &[off | if repeat { PDI_CONTROL_REPEAT } else { 0 }]).await
    }
}
