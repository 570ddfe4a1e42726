//! The gateway's files for an EtherCAT MainDevice: the settings, the log and the last frames, as `show` shows them.
//!
//! A file is read packet by packet, as the MainDevice asks for it, and written line by line into the draft of the settings. What the
//! MainDevice sends is checked as a whole when it is complete, saved, and put in force: all of it or nothing.

use embassy_time::{Duration, Instant, with_deadline};
use embedded_io_async::{ErrorKind, ErrorType, Write};
use ethercat_subdevice::foe::{FileError, FileErrorCode, Transfer};

use super::output::Output;
use super::show::{Show, Table};
use super::wait::Wait;
use crate::fieldbus::{File, FileBuffer, Owner, Packet, Work};
use crate::gateway::audit::{Actor, Topic};
use crate::gateway::reconfigure::{self, Refused, Unchanged};
use crate::gateway::{ApplyError, Gateway};
use crate::hal::{Store, StoreError, System};
use crate::language::{LineBuffer, Loader};
use crate::settings::{EthercatSettings, FileRights, Settings};

/// How long a MainDevice may take to write the settings, which nobody else can change meanwhile.
const WRITTEN_WITHIN: Duration = Duration::from_secs(60);

const OFF: &str = "no such file: the EtherCAT port has files off";
const READ_ONLY: &str = "the EtherCAT port has files read";
const CHANGED: &str = "the settings have changed meanwhile: read the file again";
const NOT_OPEN: &str = "the file is not open any more: it took too long";

/// What `mobgate.log` has.
const LOG: &[Show] = &[
    #[cfg(feature = "audit")] // As the topic.
    Show::Audit,
    Show::Log,
];

/// Serves the files that `buffer` names to a MainDevice, forever. A board with an EtherCAT controller may run it once.
pub async fn serve_files(
    gateway: &Gateway<'_>,
    buffer: &FileBuffer,
    store: &mut impl Store,
    system: &dyn System,
) -> ! {
    let mut next = None;
    loop {
        let work = match next.take() {
            Some(work) => work,
            None => buffer.work(Owner::Named).await,
        };
        match work {
            Work::Open(file, transfer) => {
                let opened = gateway.settings(|settings| may_open(settings.ethercat(), transfer));
                if let Err(error) = opened {
                    buffer.done(&work, Err(error));
                } else if transfer == Transfer::Read {
                    buffer.done(&work, Ok(Packet::new()));
                    next = Outgoing::new(buffer).send(gateway, system, file).await;
                } else {
                    next = receive(gateway, buffer, store, &work).await;
                }
            }
            Work::Write(_) | Work::Read(_) | Work::Finish => {
                buffer.done(&work, Err(FileError::new(FileErrorCode::Illegal, NOT_OPEN)));
            }
            Work::Discard | Work::Restart => buffer.done(&work, Ok(Packet::new())),
        }
    }
}

/// Whether the settings of the port permit `transfer`.
fn may_open(port: Option<&EthercatSettings>, transfer: Transfer) -> Result<(), FileError> {
    match (port.map(|port| port.files), transfer) {
        (Some(FileRights::Write), _) | (Some(FileRights::Read), Transfer::Read) => Ok(()),
        (Some(FileRights::Read), Transfer::Write) => {
            Err(FileError::new(FileErrorCode::AccessDenied, READ_ONLY))
        }
        (Some(FileRights::Off) | None, _) => Err(FileError::new(FileErrorCode::NotFound, OFF)),
    }
}

/// A file that is read, packet by packet.
struct Outgoing<'b> {
    buffer: &'b FileBuffer,
    packet: Packet,
    /// Bytes of the packet that the MainDevice waits for; 0 while it does not.
    room: usize,
    /// What came instead of a request for the next packet.
    ended: Option<Work>,
}

impl<'b> Outgoing<'b> {
    fn new(buffer: &'b FileBuffer) -> Self {
        Self { buffer, packet: Packet::new(), room: 0, ended: None }
    }

    /// Sends `file`; returns what there is to do instead if the MainDevice does not want it to its end.
    async fn send(mut self, gateway: &Gateway<'_>, system: &dyn System, file: File) -> Option<Work> {
        let sent = match file {
            File::Capture => self.frames(gateway).await,
            File::Log => self.tables(gateway, system, LOG).await,
            _ => self.tables(gateway, system, &[Show::Config]).await,
        };
        // The end of the file is a packet with room left.
        if let Ok(sent) = sent
            && self.asked().await.is_ok()
        {
            self.hand_out(sent);
        }
        self.ended
    }

    async fn frames(&mut self, gateway: &Gateway<'_>) -> Result<Result<(), FileError>, ErrorKind> {
        let Some(mut export) = gateway.export(self).await? else {
            return Ok(Err(FileError::new(FileErrorCode::NotFound, ApplyError::NoCapture)));
        };
        export.write_kept(self).await.map(Ok)
    }

    async fn tables(
        &mut self,
        gateway: &Gateway<'_>,
        system: &dyn System,
        tables: &[Show],
    ) -> Result<Result<(), FileError>, ErrorKind> {
        let changes = gateway.changes();
        let mut text = Output::new("\n", None);
        for what in tables {
            let mut table = Table::new(*what);
            while matches!(table.row(gateway, system, &mut text), Wait::Sent) {
                if *what == Show::Config && changes != gateway.changes() {
                    return Ok(Err(FileError::new(FileErrorCode::NotDefined, CHANGED)));
                }
                self.write_all(text.text.as_bytes()).await?;
                text.clear();
            }
        }
        Ok(Ok(()))
    }

    /// Waits until the MainDevice wants a packet.
    async fn asked(&mut self) -> Result<(), ErrorKind> {
        if self.room > 0 {
            return Ok(());
        }
        match self.buffer.work(Owner::Named).await {
            Work::Read(room) => {
                self.room = room;
                Ok(())
            }
            other => {
                self.ended = Some(other);
                Err(ErrorKind::ConnectionAborted)
            }
        }
    }

    fn hand_out(&mut self, sent: Result<(), FileError>) {
        let packet = core::mem::take(&mut self.packet);
        let work = Work::Read(core::mem::take(&mut self.room));
        self.buffer.done(&work, sent.map(|()| packet));
    }
}

impl ErrorType for Outgoing<'_> {
    type Error = ErrorKind;
}

impl Write for Outgoing<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        self.asked().await?;
        let count = bytes.len().min(self.room.saturating_sub(self.packet.len()));
        // Fits: a packet has what a mailbox carries at most.
        let _ = self.packet.extend_from_slice(bytes.get(..count).unwrap_or_default());
        if self.packet.len() == self.room {
            self.hand_out(Ok(()));
        }
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

/// Receives the settings behind `opening`, and puts them in force; returns what there is to do instead of their next packet.
async fn receive(
    gateway: &Gateway<'_>,
    buffer: &FileBuffer,
    store: &mut impl Store,
    opening: &Work,
) -> Option<Work> {
    let mut draft = reconfigure::draft(gateway).await;
    let until = Instant::now() + WRITTEN_WITHIN;
    buffer.done(opening, Ok(Packet::new()));
    let mut lacks = None;
    let mut look = |number, line: &str, settings: &Settings| {
        Refused::follow(&mut lacks, gateway, (number, line), settings);
    };
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut draft, &mut line).with_observer(&mut look);
    loop {
        let work = with_deadline(until, buffer.work(Owner::Named)).await.ok()?;
        let Work::Write(packet) = &work else {
            if work != Work::Finish {
                return Some(work);
            }
            break;
        };
        let fed = loader.feed(packet).map_err(Unchanged::from);
        let is_good = fed.is_ok();
        answer(gateway, buffer, &work, fed);
        if !is_good {
            return None;
        }
    }
    let mut taken = loader.finish().map_err(Unchanged::from);
    if let (Ok(()), Some(lacks)) = (&taken, lacks) {
        taken = Err(Unchanged::Refused(lacks));
    }
    if taken.is_ok() {
        taken = take_over(gateway, store, &mut draft).await;
    }
    answer(gateway, buffer, &Work::Finish, taken);
    None
}

/// Puts the settings of a whole file in force, and saves them.
async fn take_over(
    gateway: &Gateway<'_>,
    store: &mut impl Store,
    draft: &mut Settings,
) -> Result<(), Unchanged> {
    let why = gateway.settings(|in_force| {
        // The file that was read has none.
        draft.keep_passwords(in_force);
        cut_off(in_force.ethercat(), draft.ethercat())
    });
    match why {
        Some(why) => Err(StoreError::Refused(why).into()),
        None => reconfigure::commit(gateway, store, draft, Actor::Ethercat).await,
    }
}

/// Why the MainDevice could not take back what it has written.
fn cut_off(before: Option<&EthercatSettings>, after: Option<&EthercatSettings>) -> Option<&'static str> {
    match (before, after) {
        (_, None) => Some("this would cut you off: the EtherCAT port is gone"),
        (_, Some(after)) if after.files != FileRights::Write => {
            Some("this would cut you off: the EtherCAT port has no files write")
        }
        (Some(before), Some(after)) if before.interface != after.interface => {
            Some("this would cut you off: the EtherCAT port has another interface")
        }
        _ => None,
    }
}

/// Tells the MainDevice, and the audit trail unless it is only a packet.
fn answer(gateway: &Gateway<'_>, buffer: &FileBuffer, work: &Work, result: Result<(), Unchanged>) {
    let what = match &result {
        Err(_) => Some((Topic::Settings, "mobgate.conf is refused: nothing has changed")),
        Ok(()) if *work == Work::Finish => Some((Topic::Save, "mobgate.conf is in force and saved")),
        Ok(()) => None,
    };
    // What is refused may be anything, also a password: only the MainDevice is told.
    if let Some((topic, what)) = what {
        gateway.audit(topic, Actor::Ethercat, format_args!("{what}"));
    }
    let refused = |why| match &why {
        // Without "saved settings".
        Unchanged::Text(error) => FileError::new(FileErrorCode::NotDefined, error),
        Unchanged::Refused(error) => FileError::new(FileErrorCode::NotDefined, error),
        Unchanged::Store(StoreError::Refused(why)) => FileError::new(FileErrorCode::AccessDenied, why),
        Unchanged::Store(error @ StoreError::Full(_)) => FileError::new(FileErrorCode::DiskFull, error),
        Unchanged::Store(error) => FileError::new(FileErrorCode::FlashFailed, error),
        error => FileError::new(FileErrorCode::NotDefined, error),
    };
    buffer.done(work, result.map(|()| Packet::new()).map_err(refused));
}
