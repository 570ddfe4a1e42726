//! The SDO server: reads and writes objects, in one message or in segments (ETG.1000.6, clause 5.6.2).

use super::abort::Abort;
use super::service::Service;
use crate::application::{Address, Application};
use crate::dictionary::{Bytes, Dictionary, OBJECT_BYTES_MAX, Target};
use crate::mailbox::Payload;

/// Bytes of an SDO without following data.
const SDO_BYTES: usize = 8;
/// Least data bytes in a segment, used or not.
const SEGMENT_BYTES_MIN: usize = SDO_BYTES - 1;

const COMPLETE: u8 = 1 << 4;
const TOGGLE: u8 = 1 << 4;
const EXPEDITED: u8 = 1 << 1;
const SIZE_INDICATED: u8 = 1 << 0;
const LAST: u8 = 1 << 0;
/// Responses to a download, and to a segment of one.
const DOWNLOADED: u8 = 0x60;
const SEGMENT_DOWNLOADED: u8 = 0x20;

/// A request: its first eight bytes, and the rest.
type Request<'a> = (&'a [u8; SDO_BYTES], &'a [u8]);

/// The server with at most one open transfer.
#[derive(Debug, Default)]
pub struct SdoServer {
    open: Option<Transfer>,
    bytes: Bytes,
    /// A write in progress in the application.
    writing: Option<Writing>,
}

/// The written entry, and the command of the response.
#[derive(Debug, Clone, Copy)]
struct Writing {
    at: Address,
    command: u8,
}

#[derive(Debug, Clone, Copy)]
struct Transfer {
    target: Target,
    toggle: bool,
    kind: Kind,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// Bytes sent so far.
    Upload(usize),
    /// Bytes announced.
    Download(usize),
}

impl SdoServer {
    /// Handles a request; the response has at most `room` bytes.
    pub(super) fn request<A: Application>(
        &mut self,
        request: Request<'_>,
        dictionary: &mut Dictionary<'_, A>,
        room: usize,
    ) -> Option<Payload> {
        let (&[command, low, high, sub, ..], _) = request;
        let named = Address { index: u16::from_le_bytes([low, high]), sub };
        let target = Target { at: named, complete: command & COMPLETE != 0 };
        let open = self.open.map_or(named, |transfer| transfer.target.at);
        let (at, response) = match command >> 5 {
            0 => (open, self.download_segment(request, dictionary)),
            1 => (named, self.download(target, request, dictionary)),
            2 => (named, self.upload(target, dictionary, room)),
            3 => (open, self.upload_segment(command, room)),
            // The client's abort gets no response.
            4 => {
                self.open = None;
                return None;
            }
            _ => (named, Err(Abort::UnknownCommand)),
        };
        let response = response.unwrap_or_else(|abort| {
            self.open = None;
            aborted(at, abort)
        });
        match self.writing {
            Some(_) => self.written(dictionary.application),
            None => Some(response),
        }
    }

    /// Whether a write is in progress in the application.
    pub(super) fn is_writing(&self) -> bool {
        self.writing.is_some()
    }

    /// The response to the write, once the application has completed it.
    pub(super) fn written(&mut self, application: &mut impl Application) -> Option<Payload> {
        let Writing { at, command } = self.writing?;
        let outcome = application.written()?;
        self.writing = None;
        Some(match outcome {
            Ok(()) if command == DOWNLOADED => downloaded(at),
            Ok(()) => downloaded_segment(command),
            Err(abort) => aborted(at, abort),
        })
    }

    fn upload<A: Application>(
        &mut self,
        target: Target,
        dictionary: &mut Dictionary<'_, A>,
        room: usize,
    ) -> Result<Payload, Abort> {
        // A new transfer silently replaces an open one.
        self.open = None;
        self.bytes = dictionary.read(target)?;
        let size = self.bytes.len();
        let complete = if target.complete { COMPLETE } else { 0 };
        if (1..=4).contains(&size) {
            let mut data = [0; 4];
            data.iter_mut().zip(&self.bytes).for_each(|(place, &byte)| *place = byte);
            let unused = (4 - size as u8) << 2;
            return Ok(initiated(
                0x40 | complete | unused | EXPEDITED | SIZE_INDICATED,
                target.at,
                data,
                &[],
            ));
        }
        let sent = size.min(room - SDO_BYTES);
        if sent < size {
            self.open = Some(Transfer { target, toggle: false, kind: Kind::Upload(sent) });
        }
        let data = self.bytes.get(..sent).unwrap_or_default();
        Ok(initiated(0x40 | complete | SIZE_INDICATED, target.at, (size as u32).to_le_bytes(), data))
    }

    fn upload_segment(&mut self, command: u8, room: usize) -> Result<Payload, Abort> {
        let Some(Transfer { target, toggle, kind: Kind::Upload(sent) }) = self.open else {
            return Err(Abort::UnknownCommand);
        };
        if toggle != (command & TOGGLE != 0) {
            return Err(Abort::Toggle);
        }
        let rest = self.bytes.get(sent..).unwrap_or_default();
        let data = rest.get(..room - 1).unwrap_or(rest);
        let last = data.len() == rest.len();
        let next = Transfer { target, toggle: !toggle, kind: Kind::Upload(sent + data.len()) };
        self.open = (!last).then_some(next);
        let padding = [0; SEGMENT_BYTES_MIN];
        let unused = padding.get(data.len()..).unwrap_or_default();
        let command = (command & TOGGLE) | (unused.len() as u8) << 1 | if last { LAST } else { 0 };
        Ok(Service::SdoResponse.message(&[&[command], data, unused]))
    }

    fn download<A: Application>(
        &mut self,
        target: Target,
        (initiate, data): Request<'_>,
        dictionary: &mut Dictionary<'_, A>,
    ) -> Result<Payload, Abort> {
        self.open = None;
        dictionary.check_writable(target)?;
        let &[command, _, _, _, ref value @ ..] = initiate;
        if command & EXPEDITED != 0 {
            let used = match command & SIZE_INDICATED {
                0 => dictionary.entry_bytes(target.at).min(4),
                _ => 4 - usize::from(command >> 2 & 3),
            };
            dictionary.write(target, value.get(..used).unwrap_or_default())?;
            self.writing = Some(Writing { at: target.at, command: DOWNLOADED });
            return Ok(downloaded(target.at));
        }
        let announced = u32::from_le_bytes(*value) as usize;
        if announced > OBJECT_BYTES_MAX {
            return Err(Abort::TooLong);
        }
        self.bytes.clear();
        self.append(data, announced)?;
        if data.len() == announced {
            dictionary.write(target, &self.bytes)?;
            self.writing = Some(Writing { at: target.at, command: DOWNLOADED });
        } else {
            self.open = Some(Transfer { target, toggle: false, kind: Kind::Download(announced) });
        }
        Ok(downloaded(target.at))
    }

    fn download_segment<A: Application>(
        &mut self,
        (segment, behind): Request<'_>,
        dictionary: &mut Dictionary<'_, A>,
    ) -> Result<Payload, Abort> {
        let Some(Transfer { target, toggle, kind: Kind::Download(announced) }) = self.open else {
            return Err(Abort::UnknownCommand);
        };
        let &[command, ref first @ ..] = segment;
        if toggle != (command & TOGGLE != 0) {
            return Err(Abort::Toggle);
        }
        // Only the shortest message may have unused bytes.
        let unused = if behind.is_empty() { usize::from(command >> 1 & 7) } else { 0 };
        self.append(first.get(..SEGMENT_BYTES_MIN - unused).unwrap_or_default(), announced)?;
        self.append(behind, announced)?;
        if command & LAST != 0 {
            if self.bytes.len() != announced {
                return Err(Abort::LengthMismatch);
            }
            self.open = None;
            dictionary.write(target, &self.bytes)?;
            self.writing = Some(Writing { at: target.at, command: SEGMENT_DOWNLOADED | (command & TOGGLE) });
        } else {
            self.open = Some(Transfer { target, toggle: !toggle, kind: Kind::Download(announced) });
        }
        Ok(downloaded_segment(SEGMENT_DOWNLOADED | (command & TOGGLE)))
    }

    fn append(&mut self, data: &[u8], announced: usize) -> Result<(), Abort> {
        if self.bytes.len() + data.len() > announced {
            return Err(Abort::LengthMismatch);
        }
        self.bytes.extend_from_slice(data).map_err(|_| Abort::TooLong)
    }
}

fn initiated(command: u8, at: Address, value: [u8; 4], data: &[u8]) -> Payload {
    let [low, high] = at.index.to_le_bytes();
    Service::SdoResponse.message(&[&[command, low, high, at.sub], &value, data])
}

fn downloaded(at: Address) -> Payload {
    initiated(DOWNLOADED, at, [0; 4], &[])
}

fn downloaded_segment(command: u8) -> Payload {
    Service::SdoResponse.message(&[&[command], &[0; SEGMENT_BYTES_MIN]])
}

/// An abort has the service of a request, as either side may send it.
fn aborted(at: Address, abort: Abort) -> Payload {
    let [low, high] = at.index.to_le_bytes();
    Service::SdoRequest.message(&[&[0x80, low, high, at.sub], &(abort as u32).to_le_bytes()])
}
