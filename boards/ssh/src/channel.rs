//! The channel of a session (RFC 4254): what its client asks for, and how much each side may send.

use core::fmt::Write as _;

use embedded_io_async::{Read, Write};
use heapless::String;

use crate::Error;
use crate::link::Link;
use crate::terminal::{Terminal, WINDOW_BYTES};
use crate::wire::Reader;

const GLOBAL_REQUEST: u8 = 80;
const GLOBAL_FAILURE: u8 = 82;
const OPEN: u8 = 90;
const OPENED: u8 = 91;
const OPEN_FAILED: u8 = 92;
const WINDOW_ADJUST: u8 = 93;
const DATA: u8 = 94;
const EXTENDED_DATA: u8 = 95;
const END: u8 = 96;
const CLOSE: u8 = 97;
const REQUEST: u8 = 98;
const SUCCESS: u8 = 99;
const FAILURE: u8 = 100;

const UNKNOWN_CHANNEL_TYPE: u32 = 3;
const RESOURCE_SHORTAGE: u32 = 4;
/// The command that takes a file, which the client sends behind it. Others have no input.
const TAKES_A_FILE: &[u8] = b"update";
/// The number of the only channel.
const OWN_NUMBER: u32 = 0;

/// The longest data of one message, each way.
pub(crate) const DATA_BYTES_MAX: usize = 512;

/// How a session talks to its client.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Keys of a terminal.
    Keys,
    /// Lines of a program or a file.
    Lines,
    /// One line.
    Line,
}

pub(crate) struct Channel {
    /// What the client calls it; `None` before it is open.
    theirs: Option<u32>,
    /// Bytes that may be sent, in all and at a time.
    window: u32,
    longest: u32,
    /// Bytes that the client may send.
    open_window: usize,
    /// The client has a terminal: its size, as a report to the console.
    terminal: Option<String<24>>,
    kind: Option<Kind>,
    closed: bool,
    /// The board takes new firmware.
    has_updates: bool,
}

/// The size of a terminal as xterm reports it; empty if the client does not know it (RFC 4254, 6.2).
fn size_report(fields: &mut Reader<'_>) -> Result<String<24>, Error> {
    let (columns, rows) = (fields.number()?, fields.number()?);
    let mut report = String::new();
    // Two numbers of four digits fit.
    if (1..10_000).contains(&columns) {
        let _ = write!(report, "\x1b[8;{};{columns}t", rows.min(9_999));
    }
    Ok(report)
}

impl Channel {
    pub(crate) const fn new(has_updates: bool) -> Self {
        Self {
            has_updates,
            theirs: None,
            window: 0,
            longest: 0,
            open_window: 0,
            terminal: None,
            kind: None,
            closed: false,
        }
    }

    /// How the session talks, once it has begun.
    pub(crate) const fn kind(&self) -> Option<Kind> {
        self.kind
    }

    /// The client has closed the channel.
    pub(crate) const fn is_closed(&self) -> bool {
        self.closed
    }

    /// Bytes that may be sent now.
    pub(crate) fn room(&self) -> usize {
        (self.window.min(self.longest) as usize).min(DATA_BYTES_MAX)
    }

    fn is(&self, fields: &mut Reader<'_>) -> Result<(), Error> {
        let is_open = fields.number()? == OWN_NUMBER && self.theirs.is_some() && !self.closed;
        if is_open { Ok(()) } else { Err(Error::MALFORMED) }
    }
}

/// The response to a message.
enum Response {
    None,
    Opened(u32),
    NotOpened { theirs: u32, reason: u32 },
    Global,
    Request(bool),
    Unimplemented,
}

impl Channel {
    /// Handles a message.
    fn take(&mut self, number: u8, mut fields: Reader<'_>, terminal: &Terminal) -> Result<Response, Error> {
        match number {
            GLOBAL_REQUEST => {
                fields.string()?;
                return Ok(if fields.flag()? { Response::Global } else { Response::None });
            }
            OPEN => return self.open(fields),
            WINDOW_ADJUST..=REQUEST => self.is(&mut fields)?,
            _ => return Ok(Response::Unimplemented),
        }
        match number {
            WINDOW_ADJUST => {
                self.window = self.window.checked_add(fields.number()?).ok_or(Error::MALFORMED)?;
            }
            DATA | EXTENDED_DATA => {
                if number == EXTENDED_DATA {
                    fields.number()?;
                }
                let data = fields.string()?;
                self.open_window = self.open_window.checked_sub(data.len()).ok_or(Error::MALFORMED)?;
                // The window never exceeds the room. A single line has no further input.
                if number == DATA && !terminal.has_ended() && !terminal.type_in(data) {
                    return Err(Error::MALFORMED);
                }
            }
            END => terminal.end(),
            CLOSE => self.closed = true,
            _ => return self.request(fields, terminal),
        }
        Ok(Response::None)
    }

    fn open(&mut self, mut fields: Reader<'_>) -> Result<Response, Error> {
        let kind = fields.string()?;
        let theirs = fields.number()?;
        let refused = |reason| Ok(Response::NotOpened { theirs, reason });
        if kind != b"session" {
            return refused(UNKNOWN_CHANNEL_TYPE);
        }
        if self.theirs.is_some() {
            return refused(RESOURCE_SHORTAGE);
        }
        (self.window, self.longest) = (fields.number()?, fields.number()?);
        (self.theirs, self.open_window) = (Some(theirs), WINDOW_BYTES);
        Ok(Response::Opened(theirs))
    }

    fn request(&mut self, mut fields: Reader<'_>, terminal: &Terminal) -> Result<Response, Error> {
        let (what, wants_response) = (fields.string()?, fields.flag()?);
        let done = match what {
            b"pty-req" if self.kind.is_none() => {
                fields.string()?;
                self.terminal = Some(size_report(&mut fields)?);
                true
            }
            b"window-change" if self.terminal.is_some() => {
                // If there is no room, the next report has the size.
                self.kind != Some(Kind::Keys) || terminal.type_in(size_report(&mut fields)?.as_bytes())
            }
            b"shell" if self.kind.is_none() => {
                self.kind = Some(if self.terminal.is_some() { Kind::Keys } else { Kind::Lines });
                self.terminal.as_ref().is_none_or(|size| terminal.type_in(size.as_bytes()))
            }
            b"exec" if self.kind.is_none() => self.run(fields.string()?, terminal),
            _ => false,
        };
        Ok(if wants_response { Response::Request(done) } else { Response::None })
    }

    /// Runs a line, or some.
    fn run(&mut self, lines: &[u8], terminal: &Terminal) -> bool {
        let done = terminal.type_in(lines) && terminal.type_in(b"\n");
        if done {
            self.kind = Some(Kind::Line);
            if !self.has_updates || lines.trim_ascii() != TAKES_A_FILE {
                terminal.end();
            }
            if self.terminal.is_some() {
                terminal.make_raw();
            }
        }
        done
    }
}

impl<S: Read + Write> Link<'_, S> {
    /// Handles the packets that have arrived. A pending future must not be dropped, unless the connection ends.
    pub(crate) async fn handle(&mut self, channel: &mut Channel, terminal: &Terminal) -> Result<(), Error> {
        while let Some(payload) = self.arrived().await? {
            let (number, fields) = self.read(payload)?;
            let response = channel.take(number, fields, terminal)?;
            let theirs = channel.theirs.unwrap_or_default();
            match response {
                Response::None => {}
                Response::Opened(theirs) => {
                    let (window, longest) = (WINDOW_BYTES as u32, DATA_BYTES_MAX as u32);
                    self.send(OPENED, |message| {
                        message.number(theirs).number(OWN_NUMBER).number(window).number(longest);
                    })
                    .await?;
                }
                Response::NotOpened { theirs, reason } => {
                    self.send(OPEN_FAILED, |message| {
                        message.number(theirs).number(reason).string(b"").string(b"");
                    })
                    .await?;
                }
                Response::Global => self.send(GLOBAL_FAILURE, |_| {}).await?,
                Response::Request(done) => {
                    let number = if done { SUCCESS } else { FAILURE };
                    self.send(number, |message| _ = message.number(theirs)).await?;
                }
                Response::Unimplemented => self.unimplemented().await?,
            }
        }
        Ok(())
    }

    /// Widens the client's window once half of it has been used and read.
    pub(crate) async fn open_window(
        &mut self,
        channel: &mut Channel,
        terminal: &Terminal,
    ) -> Result<(), Error> {
        let free = WINDOW_BYTES.saturating_sub(channel.open_window + terminal.unread());
        let Some(theirs) = channel.theirs.filter(|_| free >= WINDOW_BYTES / 2 && !terminal.has_ended())
        else {
            return Ok(());
        };
        channel.open_window += free;
        self.send(WINDOW_ADJUST, |message| _ = message.number(theirs).number(free as u32)).await
    }

    /// Sends the console's output, as much as the window allows.
    pub(crate) async fn show(&mut self, channel: &mut Channel, text: &[u8]) -> Result<(), Error> {
        let theirs = channel.theirs.unwrap_or_default();
        channel.window = channel.window.saturating_sub(text.len() as u32);
        self.send(DATA, |message| _ = message.number(theirs).string(text)).await
    }

    /// Sends the exit status, and closes the channel.
    pub(crate) async fn finish(&mut self, channel: &Channel, status: u32) -> Result<(), Error> {
        let theirs = channel.theirs.unwrap_or_default();
        self.send(REQUEST, |message| {
            message.number(theirs).string(b"exit-status").flag(false).number(status);
        })
        .await?;
        self.send(END, |message| _ = message.number(theirs)).await?;
        self.send(CLOSE, |message| _ = message.number(theirs)).await
    }
}
