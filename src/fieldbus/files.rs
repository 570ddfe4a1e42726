//! The gateway's files for a MainDevice, by FoE: new firmware, which it writes in Boot and only there, and by their names settings,
//! log and capture, in the other states.
//!
//! The SubDevice's task takes a packet into a buffer, or hands one out; the owner of the file does the work meanwhile: that of the
//! flash ([`Gateway::take_firmware`]), or that of the named files ([`serve_files`](crate::console::serve_files)). The MainDevice
//! hears that the device is busy.
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
/// The files with a name.
// Images without them have no owner for them.
#[cfg(feature = "files")]
const NAMES: &[(&str, File)] =
    &[("mobgate.conf", File::Settings), ("mobgate.log", File::Log), ("capture.pcapng", File::Capture)];
#[cfg(not(feature = "files"))]
const NAMES: &[(&str, File)] = &[];
/// Why a file is not opened while an owner is at the one before.
const BUSY: &str = "the last transfer is still being dealt with: ask again";

/// Bytes of a packet.
pub(crate) type Packet = Vec<u8, PAYLOAD_BYTES_MAX>;

/// The files of the gateway: none, or those of a [`FileBuffer`].
pub trait GatewayFiles: Files {
    /// In which states MainDevices use them.
    const ACCESS: FileAccess;

    /// The SubDevice has changed its state.
    fn entered(&mut self, _state: AlState) {}
}

impl GatewayFiles for NoFiles {
    const ACCESS: FileAccess = FileAccess::None;
}

/// A file of the gateway.
// Without named files only the first is ever opened.
#[cfg_attr(not(feature = "files"), allow(dead_code))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum File {
    Firmware,
    Settings,
    Log,
    Capture,
}

impl File {
    fn called(name: &str) -> Option<Self> {
        let end = name.len().checked_sub(EXTENSION.len()).and_then(|at| name.get(at..));
        if end.is_some_and(|end| end.eq_ignore_ascii_case(EXTENSION)) {
            return Some(Self::Firmware);
        }
        let named = NAMES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name));
        named.map(|(_, file)| *file)
    }

    const fn owner(self) -> Owner {
        match self {
            Self::Firmware => Owner::Flash,
            _ => Owner::Named,
        }
    }
}

/// Who does the work for a file.
#[cfg_attr(not(feature = "files"), allow(dead_code))] // As `File`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Owner {
    Flash,
    Named,
}

/// What the owner of a file is to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Work {
    Open(File, Transfer),
    Write(Packet),
    /// To hand out the next so many bytes; fewer are the end of the file.
    Read(usize),
    Finish,
    Discard,
    /// The image is complete, and the MainDevice has left Boot.
    Restart,
}

/// Hands files between the SubDevice's task and their owners, one packet at a time. A static of the board.
pub struct FileBuffer {
    state: Mutex<CriticalSectionRawMutex, RefCell<State>>,
    flash: Signal<CriticalSectionRawMutex, ()>,
    named: Signal<CriticalSectionRawMutex, ()>,
}

struct State {
    /// Whether anybody owns a flash, or the named files.
    has_flash: bool,
    has_named: bool,
    /// The file opened last.
    file: File,
    /// Not taken by the owner yet.
    work: Option<Work>,
    /// The owner is at some work.
    busy: bool,
    /// The result of the work that was begun last counts.
    awaited: bool,
    /// With the packet that was read.
    result: Option<Result<Packet, FileError>>,
    /// A whole image waits for a restart.
    complete: bool,
}

impl State {
    /// Whether `file` cannot be opened yet. An owner finds out by itself that its last file was given up, but for the one that
    /// is in the middle of something, or has lost its turn to the other.
    fn is_occupied(&self, file: File) -> bool {
        match (self.file.owner(), file.owner()) {
            // The flash just begins anew.
            (Owner::Flash, Owner::Flash) => false,
            (Owner::Named, Owner::Named) => self.busy,
            _ => self.busy || self.work.is_some(),
        }
    }
}

impl FileBuffer {
    /// An empty buffer.
    pub const fn new() -> Self {
        let state = State {
            has_flash: false,
            has_named: false,
            file: File::Firmware,
            work: None,
            busy: false,
            awaited: false,
            result: None,
            complete: false,
        };
        Self { state: Mutex::new(RefCell::new(state)), flash: Signal::new(), named: Signal::new() }
    }

    fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        self.state.lock(|state| change(&mut state.borrow_mut()))
    }

    fn wanted(&self, owner: Owner) -> &Signal<CriticalSectionRawMutex, ()> {
        match owner {
            Owner::Flash => &self.flash,
            Owner::Named => &self.named,
        }
    }

    /// Begins `work`; the result of what is in progress does not count any more.
    fn begin(&self, work: Work) {
        let owner = self.with(|state| {
            if let Work::Open(file, _) = work {
                state.file = file;
            }
            state.awaited = work != Work::Discard;
            (state.work, state.result) = (Some(work), None);
            state.file.owner()
        });
        self.wanted(owner).signal(());
    }

    fn refuse(&self, error: impl Into<FileError>) {
        self.with(|state| (state.awaited, state.result) = (false, Some(Err(error.into()))));
    }

    /// Waits for work. To be called by the `owner` of files, and then [`done`](Self::done).
    pub(crate) async fn work(&self, owner: Owner) -> Work {
        self.with(|state| match owner {
            Owner::Flash => state.has_flash = true,
            Owner::Named => state.has_named = true,
        });
        loop {
            let taken = self.with(|state| {
                let work = if state.file.owner() == owner { state.work.take() } else { None };
                state.busy |= work.is_some();
                work
            });
            match taken {
                Some(work) => return work,
                None => self.wanted(owner).wait().await,
            }
        }
    }

    /// The result of the work, with the packet that was read.
    pub(crate) fn done(&self, work: &Work, result: Result<Packet, FileError>) {
        self.with(|state| {
            state.busy = false;
            // Not that of what came before, while the next is waiting.
            if state.awaited && state.work.is_none() {
                state.awaited = false;
                state.complete = *work == Work::Finish && state.file == File::Firmware && result.is_ok();
                state.result = Some(result);
            }
        });
    }
}

impl Files for &FileBuffer {
    fn open(&mut self, opening: &Opening<'_>) {
        let Opening { transfer, name, state, .. } = *opening;
        let Some(file) = File::called(name) else { return self.refuse(FileErrorCode::NotFound) };
        let (has_owner, occupied) = self.with(|state| match file.owner() {
            Owner::Flash => (state.has_flash, state.is_occupied(file)),
            Owner::Named => (state.has_named, state.is_occupied(file)),
        });
        let in_boot = state == AlState::Boot;
        match (file, transfer) {
            _ if !has_owner => self.refuse(FileErrorCode::NotFound),
            (File::Firmware, Transfer::Read) | (File::Log | File::Capture, Transfer::Write) => {
                self.refuse(FileErrorCode::AccessDenied);
            }
            (File::Firmware, _) if !in_boot => self.refuse(FileErrorCode::BootstrapOnly),
            (File::Settings | File::Log | File::Capture, _) if in_boot => {
                self.refuse(FileErrorCode::NotInBootstrap);
            }
            _ if occupied => self.refuse(FileError::new(FileErrorCode::Illegal, BUSY)),
            _ => self.begin(Work::Open(file, transfer)),
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
        self.with(|state| state.result.take()).map(|result| result.map(|_| ()))
    }

    fn read(&mut self, into: &mut [u8]) -> Option<Result<usize, FileError>> {
        let (result, is_asked) = self.with(|state| (state.result.take(), state.awaited));
        if result.is_none() && !is_asked {
            self.begin(Work::Read(into.len()));
        }
        result.map(|result| {
            let packet = result?;
            into.iter_mut().zip(&packet).for_each(|(into, byte)| *into = *byte);
            Ok(packet.len())
        })
    }

    fn abort(&mut self) {
        self.begin(Work::Discard);
    }
}

impl GatewayFiles for &FileBuffer {
    const ACCESS: FileAccess = FileAccess::WithBoot;

    fn entered(&mut self, state: AlState) {
        if state != AlState::Boot && self.with(|state| core::mem::take(&mut state.complete)) {
            self.begin(Work::Restart);
        }
    }
}
