//! New firmware from a MainDevice: a file that it writes by FoE in Boot, and only there.
//!
//! The SubDevice's task takes a packet into a buffer; the owner of the flash writes it ([`Gateway::take_firmware`]), while the
//! MainDevice hears that the device is busy.
//!
//! [`Gateway::take_firmware`]: crate::gateway::Gateway::take_firmware

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::foe::{FileAccess, FileError, FileErrorCode, Files, NoFiles, Opening, Transfer};
use ethercat_subdevice::mailbox::PAYLOAD_BYTES_MAX;
use heapless::Vec;

/// How the names of images end.
const EXTENSION: &str = ".mgu";

/// Bytes of a packet.
pub(crate) type Packet = Vec<u8, PAYLOAD_BYTES_MAX>;

/// The files of the gateway: none, or those of a [`FirmwareBuffer`].
pub trait GatewayFiles: Files {
    /// In which states MainDevices use them.
    const ACCESS: FileAccess;

    /// The SubDevice has changed its state.
    fn entered(&mut self, _state: AlState) {}
}

impl GatewayFiles for NoFiles {
    const ACCESS: FileAccess = FileAccess::None;
}

/// What the owner of the flash is to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Work {
    Begin,
    Write(Packet),
    Finish,
    Discard,
    /// The image is complete, and the MainDevice has left Boot.
    Restart,
}

/// Hands an image from the SubDevice's task to the owner of the flash, one packet at a time. A static of the board.
pub struct FirmwareBuffer {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    wanted: Signal<CriticalSectionRawMutex, ()>,
}

struct State {
    /// Whether anybody owns a flash.
    has_owner: bool,
    /// Not taken by the owner yet.
    work: Option<Work>,
    /// The owner is at it, and its result counts.
    going: bool,
    result: Option<Result<(), FileError>>,
    /// A whole image waits for a restart.
    complete: bool,
}

impl FirmwareBuffer {
    /// An empty buffer.
    pub const fn new() -> Self {
        let state = State { has_owner: false, work: None, going: false, result: None, complete: false };
        Self { state: Mutex::new(RefCell::new(state)), wanted: Signal::new() }
    }

    fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        self.state.lock(|state| change(&mut state.borrow_mut()))
    }

    /// Begins `work`; the result of what is in progress does not count any more.
    fn begin(&self, work: Work) {
        self.with(|state| {
            (state.work, state.going, state.result) = (Some(work), false, None);
        });
        self.wanted.signal(());
    }

    fn refuse(&self, error: impl Into<FileError>) {
        self.with(|state| state.result = Some(Err(error.into())));
    }

    /// Waits for work. To be called by the owner of the flash, and then [`done`](Self::done).
    pub(crate) async fn work(&self) -> Work {
        self.with(|state| state.has_owner = true);
        loop {
            if let Some(work) = self.with(|state| {
                state.going = state.work.is_some();
                state.work.take()
            }) {
                return work;
            }
            self.wanted.wait().await;
        }
    }

    /// The result of the work.
    pub(crate) fn done(&self, work: &Work, result: Result<(), FileError>) {
        self.with(|state| {
            if state.going {
                state.going = false;
                state.complete = *work == Work::Finish && result.is_ok();
                state.result = Some(result);
            }
        });
    }
}

impl Files for &FirmwareBuffer {
    fn open(&mut self, opening: &Opening<'_>) {
        let Opening { transfer, name, state, .. } = *opening;
        let is_image = name
            .len()
            .checked_sub(EXTENSION.len())
            .and_then(|at| name.get(at..))
            .is_some_and(|end| end.eq_ignore_ascii_case(EXTENSION));
        match transfer {
            _ if !is_image || !self.with(|state| state.has_owner) => self.refuse(FileErrorCode::NotFound),
            Transfer::Read => self.refuse(FileErrorCode::AccessDenied),
            Transfer::Write if state != AlState::Boot => self.refuse(FileErrorCode::BootstrapOnly),
            Transfer::Write => self.begin(Work::Begin),
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        match Packet::from_slice(bytes) {
            Ok(packet) => self.begin(Work::Write(packet)),
            // No mailbox carries more.
            Err(_) => self.refuse(FileErrorCode::DiskFull),
        }
    }

    fn finish(&mut self) {
        self.begin(Work::Finish);
    }

    fn done(&mut self) -> Option<Result<(), FileError>> {
        self.with(|state| state.result.take())
    }

    fn read(&mut self, _into: &mut [u8]) -> Option<Result<usize, FileError>> {
        Some(Err(FileErrorCode::AccessDenied.into()))
    }

    fn abort(&mut self) {
        self.begin(Work::Discard);
    }
}

impl GatewayFiles for &FirmwareBuffer {
    const ACCESS: FileAccess = FileAccess::WithBoot;

    fn entered(&mut self, state: AlState) {
        if state != AlState::Boot && self.with(|state| core::mem::take(&mut state.complete)) {
            self.begin(Work::Restart);
        }
    }
}
