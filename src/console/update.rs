//! `update`: takes a new image from the terminal, by YMODEM, or by SSH as a file that is piped in.

// Others have no way to send one.
#[cfg(feature = "ssh")]
mod piped;
mod ymodem;

use core::fmt;

use embassy_time::{Duration, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use self::ymodem::{Action, CANCEL, Receiver, Stopped};
use super::session::Session;
use super::wait::Wait;
use crate::gateway::audit::Topic;
use crate::hal::{Update, UpdateError, Version};
use crate::language::{Words, Wrong};

/// Bytes taken from the stream at a time.
const CHUNK_BYTES_MAX: usize = 64;
/// The silence after which the terminal is back from its transfer, and shows text.
const BACK_AFTER: Duration = Duration::from_secs(1);
/// Pieces that are dropped before that, at most.
const DROPPED_MAX: usize = 1000;

/// Why no image was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failed {
    Stopped(Stopped),
    Refused(UpdateError),
}

impl fmt::Display for Failed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stopped(why) => why.fmt(f),
            Self::Refused(why) => why.fmt(f),
        }
    }
}

/// Receives a file from `stream` into `update`; one that is piped in begins with what was read `ahead`.
pub(super) async fn receive<IO, U>(
    stream: &mut IO,
    update: &mut U,
    allow_older: bool,
    #[cfg_attr(not(feature = "ssh"), allow(unused_variables))] ahead: Option<&[u8]>,
) -> Result<Result<Version, Failed>, IO::Error>
where
    IO: Read + Write,
    U: Update,
{
    #[cfg(feature = "ssh")]
    if let Some(ahead) = ahead.filter(|_| U::EXISTS) {
        let received = piped::receive(stream, update, allow_older, ahead).await?;
        return Ok(received.map_err(|why| why.map_or(Failed::Stopped(Stopped::Silent), Failed::Refused)));
    }
    // Refuse before the file is sent; from here on no other update can start.
    let begun = update.begin(None, allow_older).await;
    if !U::EXISTS || begun.is_err() {
        return Ok(Err(Failed::Refused(begun.err().unwrap_or(UpdateError::Failed))));
    }
    stream.flush().await?;
    let received = transfer(stream, update, allow_older).await;
    update.discard();
    let received = received?;
    if received.is_err() {
        send(stream, CANCEL).await?;
    }
    let mut chunk = [0; CHUNK_BYTES_MAX];
    for _ in 0..DROPPED_MAX {
        match with_timeout(BACK_AFTER, stream.read(&mut chunk)).await {
            Ok(Ok(1..)) => {}
            Ok(Ok(0)) => {
                Timer::after(BACK_AFTER).await;
                break;
            }
            Ok(Err(error)) => return Err(error),
            Err(_) => break,
        }
    }
    Ok(received)
}

async fn transfer<IO, U>(
    stream: &mut IO,
    update: &mut U,
    allow_older: bool,
) -> Result<Result<Version, Failed>, IO::Error>
where
    IO: Read + Write,
    U: Update,
{
    let (mut receiver, mut version) = (Receiver::new(), Version::new());
    let (mut chunk, mut bytes) = ([0; CHUNK_BYTES_MAX], 0..0);
    loop {
        let event = match bytes.next().and_then(|at| chunk.get(at)) {
            Some(byte) => receiver.feed(*byte),
            None => match with_timeout(receiver.patience(), stream.read(&mut chunk)).await {
                Ok(Ok(0)) => Action::Stopped(Stopped::Silent),
                Ok(read) => {
                    bytes = 0..read?;
                    continue;
                }
                Err(_) => receiver.silence(),
            },
        };
        let done = match event {
            Action::More => continue,
            Action::Send(bytes) => {
                send(stream, bytes).await?;
                continue;
            }
            Action::Done(bytes) => {
                send(stream, bytes).await?;
                return Ok(Ok(version));
            }
            Action::Stopped(why) => return Ok(Err(Failed::Stopped(why))),
            Action::Begin(length) => update.begin(length, allow_older).await,
            Action::Data => update.write(receiver.data()).await,
            Action::Finish => update.finish().await.map(|finished| version = finished),
        };
        match done {
            Ok(()) => send(stream, receiver.accepted()).await?,
            Err(why) => return Ok(Err(Failed::Refused(why))),
        }
    }
}

async fn send<IO: Write>(stream: &mut IO, bytes: &[u8]) -> Result<(), IO::Error> {
    stream.write_all(bytes).await?;
    stream.flush().await
}

impl Session<'_, '_> {
    /// `update`, or `update older`.
    pub(super) fn update(&mut self, words: &Words<'_>) -> Result<Wait, Wrong> {
        let word = words.take();
        let allow_older = !word.is_end();
        if allow_older {
            word.keyword(&[("older", ())], "older")?;
            words.end()?;
        }
        if allow_older && self.peer.is_some() {
            return Ok(self.fail(&"older firmware is taken at the gateway's own terminal only"));
        }
        Ok(Wait::Update { allow_older })
    }

    /// Reports the outcome; a new image is started.
    pub(super) fn updated(&mut self, received: Result<Version, Failed>) -> Wait {
        match received {
            Ok(version) => {
                self.audit(Topic::Update, format_args!("update to {version}"));
                self.out.line(format_args!("{version} is complete and genuine; it starts now, on trial"));
                Wait::Reboot
            }
            Err(why) => {
                self.audit(Topic::Update, format_args!("update failed: {why}"));
                self.fail(&why)
            }
        }
    }
}
