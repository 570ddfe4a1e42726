//! The application layer's state machine: which requests are accepted, refused or ignored (ETG.1000.6, clause 6.4).
//!
//! [`AlMachine::request`] decides what to do about a request; its caller does it and reports back by [`AlMachine::reached`] or
//! [`AlMachine::refused`]. [`AlMachine::status`] and [`AlMachine::code`] are the resulting register values.

/// A state of the SubDevice. The values are those of AL control and AL status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum AlState {
    /// No mailbox, no process data.
    Init = 1,
    /// Mailbox.
    PreOp = 2,
    /// Mailbox for files only: new firmware.
    Boot = 3,
    /// Mailbox and inputs.
    SafeOp = 4,
    /// Mailbox, inputs and outputs.
    Op = 8,
}

impl AlState {
    const fn from_bits(bits: u16) -> Option<Self> {
        match bits & 0x0f {
            1 => Some(Self::Init),
            2 => Some(Self::PreOp),
            3 => Some(Self::Boot),
            4 => Some(Self::SafeOp),
            8 => Some(Self::Op),
            _ => None,
        }
    }

    /// Whether the mailbox works in this state.
    pub const fn has_mailbox(self) -> bool {
        !matches!(self, Self::Init)
    }

    /// Whether objects are served in this state.
    pub const fn has_objects(self) -> bool {
        matches!(self, Self::PreOp | Self::SafeOp | Self::Op)
    }

    /// Whether process data are exchanged in this state.
    pub const fn has_process_data(self) -> bool {
        matches!(self, Self::SafeOp | Self::Op)
    }
}

/// Why a state was refused or left: the AL status code (ETG.1020).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum AlStatusCode {
    /// No more specific code applies.
    Unspecified = 0x0001,
    /// A transition that the state machine does not have.
    InvalidStateChange = 0x0011,
    /// A state that does not exist.
    UnknownState = 0x0012,
    /// There is no Boot state.
    BootNotSupported = 0x0013,
    /// SM0 or SM1 does not fit the mailbox of Boot.
    InvalidBootMailbox = 0x0015,
    /// SM0 or SM1 does not fit the mailbox.
    InvalidMailbox = 0x0016,
    /// No outputs came within the watchdog time.
    SyncManagerWatchdog = 0x001b,
    /// SM2 does not fit the outputs.
    InvalidOutputs = 0x001d,
    /// SM3 does not fit the inputs.
    InvalidInputs = 0x001e,
    /// The requested synchronisation is not supported.
    SynchronisationNotSupported = 0x0028,
    /// SYNC0 was lost in Op.
    FatalSyncError = 0x002c,
    /// SYNC0 did not come before Op.
    NoSyncError = 0x002d,
    /// The settings of distributed clocks are not supported, or not those of 1C32h and 1C33h.
    InvalidDcConfiguration = 0x0030,
    /// A latch is assigned to the device.
    InvalidLatchConfiguration = 0x0031,
    /// Frames do not come in step with SYNC0.
    PllError = 0x0032,
    /// Too many pulses of SYNC0 were not served.
    SyncIoError = 0x0033,
    /// Too many cycles had no outputs.
    SyncTimeout = 0x0034,
    /// The cycle of the frames is too long.
    InvalidSyncCycle = 0x0035,
    /// The cycle of SYNC0 is too short.
    InvalidSync0Cycle = 0x0036,
    /// The application has more inputs than the assigned PDOs carry.
    InvalidInputMapping = 0x0024,
    /// The application has more outputs than the assigned PDOs carry.
    InvalidOutputMapping = 0x0025,
    /// The application's configuration does not allow the state.
    InconsistentSettings = 0x0026,
    /// The application is not ready.
    HardwareNotReady = 0x0052,
    /// The processor restarted.
    RestartedLocally = 0x0060,
    /// The modules are not those expected by the MainDevice.
    ModulesDiffer = 0x0070,
}

/// AL control, as the MainDevice wrote it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AlControl(pub u16);

impl AlControl {
    const ACKNOWLEDGE: u16 = 1 << 4;
    const IDENTIFICATION: u16 = 1 << 5;

    /// Whether the device identification is requested.
    pub const fn asks_identification(self) -> bool {
        self.0 & Self::IDENTIFICATION != 0
    }

    const fn acknowledges(self) -> bool {
        self.0 & Self::ACKNOWLEDGE != 0
    }
}

/// How to handle a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Nothing: an error was not acknowledged.
    Ignore,
    /// Stay: the state is already reached, or the request was refused. AL status must be written.
    Stay,
    /// Go one state up, if its preconditions are met.
    Up(AlState),
    /// Go down to a state; this cannot be refused.
    Down(AlState),
}

/// The state, and the pending error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AlMachine {
    state: AlState,
    fault: Option<AlStatusCode>,
    /// The fault was not a refusal: the device left its state, or started, by itself.
    pub(crate) fell: bool,
    identification: Option<u16>,
}

impl AlMachine {
    const ERROR: u16 = 1 << 4;
    const IDENTIFICATION_LOADED: u16 = 1 << 5;

    /// In Init, with an error if that was not planned.
    pub const fn new(fault: Option<AlStatusCode>) -> Self {
        Self { state: AlState::Init, fault, fell: true, identification: None }
    }

    /// The current state.
    pub const fn state(&self) -> AlState {
        self.state
    }

    /// The error that has not been acknowledged.
    pub const fn fault(&self) -> Option<AlStatusCode> {
        self.fault
    }

    /// The value of the register AL status.
    pub const fn status(&self) -> u16 {
        let error = if self.fault.is_some() { Self::ERROR } else { 0 };
        let loaded = if self.identification.is_some() { Self::IDENTIFICATION_LOADED } else { 0 };
        self.state as u16 | error | loaded
    }

    /// The value of the register AL status code: the error's code, or the identification while it is loaded.
    pub const fn code(&self) -> u16 {
        match (self.fault, self.identification) {
            (Some(code), _) => code as u16,
            (None, Some(id)) => id,
            (None, None) => 0,
        }
    }

    /// Judges a request.
    pub fn request(&mut self, control: AlControl) -> Step {
        let wanted = AlState::from_bits(control.0);
        self.identification = None;
        if self.fault.is_some() {
            // Going to Init is always safe, so it needs no acknowledgement.
            if !control.acknowledges() && wanted != Some(AlState::Init) {
                return Step::Ignore;
            }
            self.fault = None;
        }
        let Some(wanted) = wanted else { return self.refused(AlStatusCode::UnknownState) };
        match (self.state, wanted) {
            (from, to) if from == to => Step::Stay,
            (_, AlState::Init) => Step::Down(AlState::Init),
            (AlState::Init, AlState::Boot) => Step::Up(AlState::Boot),
            // Boot is aside: only Init leads there and back.
            (AlState::Boot, _) | (_, AlState::Boot) => self.refused(AlStatusCode::InvalidStateChange),
            (from, to) if to < from => Step::Down(to),
            (AlState::Init, AlState::PreOp)
            | (AlState::PreOp, AlState::SafeOp)
            | (AlState::SafeOp, AlState::Op) => Step::Up(wanted),
            _ => self.refused(AlStatusCode::InvalidStateChange),
        }
    }

    /// The requested state was reached.
    pub fn reached(&mut self, state: AlState) {
        self.state = state;
    }

    /// A request was refused with `code`; the state stays.
    pub fn refused(&mut self, code: AlStatusCode) -> Step {
        (self.fault, self.fell) = (Some(code), false);
        Step::Stay
    }

    /// The device fell back to `state` by itself.
    pub fn fell(&mut self, state: AlState, code: AlStatusCode) {
        self.state = state;
        self.identification = None;
        (self.fault, self.fell) = (Some(code), true);
    }

    /// Shows the device's identification, below SafeOp and without an error.
    pub fn identify(&mut self, id: u16) {
        if self.fault.is_none() && self.state < AlState::SafeOp {
            self.identification = Some(id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{AlControl, AlMachine, AlState, AlStatusCode, Step};

    const STATES: [AlState; 4] = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op];

    fn in_state(state: AlState) -> AlMachine {
        AlMachine { state, ..AlMachine::new(None) }
    }

    fn faulty(state: AlState) -> AlMachine {
        let mut machine = in_state(state);
        machine.fell(state, AlStatusCode::Unspecified);
        machine
    }

    #[test]
    fn only_single_steps_lead_up_and_any_lead_down() {
        for (at, from) in STATES.into_iter().enumerate() {
            for (wanted, to) in STATES.into_iter().enumerate() {
                let mut machine = in_state(from);
                let step = machine.request(AlControl(to as u16));
                match wanted as i32 - at as i32 {
                    ..0 => assert_eq!(step, Step::Down(to)),
                    0 => assert_eq!((step, machine.code()), (Step::Stay, 0)),
                    1 => assert_eq!(step, Step::Up(to)),
                    _ => assert_eq!((step, machine.code()), (Step::Stay, 0x0011), "{from:?} to {to:?}"),
                }
            }
        }
    }

    #[test]
    fn states_that_do_not_exist_are_refused_with_0012() {
        for state in STATES {
            for wanted in [0, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15] {
                let mut machine = in_state(state);
                assert_eq!(machine.request(AlControl(wanted)), Step::Stay);
                assert_eq!((machine.status(), machine.code()), (state as u16 | 0x10, 0x0012));
            }
        }
    }

    #[test]
    fn boot_is_between_init_and_init() {
        let step = |from, to| {
            let mut machine = in_state(from);
            (machine.request(AlControl(to as u16)), machine.code())
        };
        let boot = AlState::Boot;
        assert_eq!(
            STATES.map(|from| step(from, boot)),
            [(Step::Up(boot), 0), (Step::Stay, 0x0011), (Step::Stay, 0x0011), (Step::Stay, 0x0011)]
        );
        assert_eq!(
            STATES.map(|to| step(boot, to)),
            [
                (Step::Down(AlState::Init), 0),
                (Step::Stay, 0x0011),
                (Step::Stay, 0x0011),
                (Step::Stay, 0x0011)
            ]
        );
        assert_eq!(step(boot, boot), (Step::Stay, 0));
    }

    #[test]
    fn an_error_is_ended_by_an_acknowledgement_or_by_init_and_by_nothing_else() {
        let mut machine = faulty(AlState::PreOp);
        assert_eq!(machine.request(AlControl(2)), Step::Ignore);
        assert_eq!((machine.status(), machine.code()), (0x12, 1));
        assert_eq!(machine.request(AlControl(0x12)), Step::Stay);
        assert_eq!((machine.status(), machine.code()), (0x02, 0));

        assert_eq!(faulty(AlState::PreOp).request(AlControl(0x14)), Step::Up(AlState::SafeOp));
        assert_eq!(faulty(AlState::Op).request(AlControl(1)), Step::Down(AlState::Init));
    }

    #[test]
    fn an_identification_is_shown_until_a_request_without_that_bit() {
        let mut machine = in_state(AlState::PreOp);
        assert_eq!(machine.request(AlControl(0x22)), Step::Stay);
        machine.identify(0x1234);
        assert_eq!((machine.status(), machine.code()), (0x22, 0x1234));
        machine.request(AlControl(0x02));
        assert_eq!((machine.status(), machine.code()), (0x02, 0));
    }

    #[test]
    fn an_identification_ends_when_the_device_falls_back() {
        let mut machine = in_state(AlState::PreOp);
        machine.identify(0x1234);
        machine.fell(AlState::Init, AlStatusCode::InvalidMailbox);
        assert_eq!((machine.status(), machine.code()), (0x11, 0x0016));
    }

    #[test]
    fn an_identification_never_hides_an_error() {
        let mut machine = faulty(AlState::Init);
        machine.identify(0x1234);
        assert_eq!((machine.status(), machine.code()), (0x11, 1));
    }

    #[test]
    fn each_state_has_its_mailbox_objects_process_data_and_identification() {
        for (state, mailbox, objects, process_data) in [
            (AlState::Init, false, false, false),
            (AlState::PreOp, true, true, false),
            (AlState::Boot, true, false, false),
            (AlState::SafeOp, true, true, true),
            (AlState::Op, true, true, true),
        ] {
            let has = (state.has_mailbox(), state.has_objects(), state.has_process_data());
            assert_eq!(has, (mailbox, objects, process_data), "{state:?}");
            let mut machine = in_state(state);
            machine.identify(7);
            let expected = if state < AlState::SafeOp { (state as u16 | 0x20, 7) } else { (state as u16, 0) };
            assert_eq!((machine.status(), machine.code()), expected, "{state:?}");
        }
        for bit in 0..16 {
            assert_eq!(AlControl(1 << bit).asks_identification(), bit == 5);
            // Only bit 4 acknowledges; the others that are no state are looked past.
            let step = faulty(AlState::PreOp).request(AlControl(2 | 1 << bit));
            let expected = match bit {
                4 => Step::Stay,
                _ => Step::Ignore,
            };
            assert_eq!(step, expected, "{bit}");
        }
    }

    #[test]
    fn what_was_reached_and_what_it_fell_to_is_the_state() {
        let mut machine = AlMachine::new(Some(AlStatusCode::RestartedLocally));
        assert_eq!((machine.status(), machine.code()), (0x11, 0x0060));
        assert_eq!(machine.request(AlControl(0x12)), Step::Up(AlState::PreOp));
        machine.reached(AlState::PreOp);
        assert_eq!((machine.state(), machine.fault()), (AlState::PreOp, None));
        assert_eq!(machine.refused(AlStatusCode::InvalidInputs), Step::Stay);
        assert_eq!((machine.state(), machine.fault()), (AlState::PreOp, Some(AlStatusCode::InvalidInputs)));
        machine.fell(AlState::SafeOp, AlStatusCode::SyncManagerWatchdog);
        assert_eq!((machine.status(), machine.code()), (0x14, 0x001b));
    }

    #[test]
    fn a_fault_is_the_devices_own_unless_it_was_refused_to_the_main_device() {
        let fell = |machine: &AlMachine| (machine.indicators().fault.is_some(), machine.indicators().fell);
        let mut machine = AlMachine::new(Some(AlStatusCode::RestartedLocally));
        assert_eq!(fell(&machine), (true, true));
        machine.request(AlControl(0x12));
        machine.refused(AlStatusCode::InvalidMailbox);
        assert_eq!(fell(&machine), (true, false));
        machine.fell(AlState::Init, AlStatusCode::InvalidMailbox);
        assert_eq!(fell(&machine), (true, true));
        machine.request(AlControl(1));
        assert!(!fell(&machine).0);
        assert_eq!(machine.indicators().state, AlState::Init);
    }
}
