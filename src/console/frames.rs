//! The last frames, and those that come: a line of text each, or a file.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use embedded_io_async::{Read, Write};

use super::command::Session;
use super::rows::{Bytes, port_name, text};
use crate::capture::{Capture, Captured, Head};
use crate::config::Words;
use crate::gateway::ApplyError;
use crate::hal::{Store, System};

/// How often a watcher looks.
const PAUSE: Duration = Duration::from_millis(50);

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Shows the frames from number `cursor` on.
    pub(super) async fn frames(&mut self, cursor: &mut u32) -> Result<(), IO::Error> {
        let Some(capture) = self.gateway.capture() else {
            return self.fail(format_args!("{}", ApplyError::NoCapture)).await;
        };
        // Those that come meanwhile are for the next call.
        let end = capture.end();
        while *cursor != end {
            let Some(frame) = capture.next(cursor) else { break };
            self.frame(&frame, *cursor > frame.missed + 1).await?;
        }
        Ok(())
    }

    async fn frame(&mut self, frame: &Captured, follows: bool) -> Result<(), IO::Error> {
        let Captured { head: Head { at, port, kind, sent, verdict, .. }, bytes, missed } = frame;
        if *missed > 0 && follows {
            self.out.line(format_args!("({missed} frames more)")).await?;
        }
        let time = text::<24>(format_args!("{}.{:06}", at.as_secs(), at.as_micros() % 1_000_000));
        let name = port_name(self.gateway, *port);
        let direction = if *sent { ">" } else { "<" };
        let verdict = verdict.name();
        self.out.text_only(format_args!("{time:>14} {name:15} {direction} {verdict:10} ")).await?;
        // A frame is longer than a line of output may be.
        for part in bytes.chunks(32) {
            self.out.text_only(format_args!("{}", Bytes { kind: *kind, bytes: part })).await?;
        }
        self.out.line(format_args!("")).await
    }

    /// Writes the frames that come into the file that is named, or no more.
    pub(super) async fn capture(&mut self, words: &Words<'_>) -> Result<(), IO::Error> {
        let word = words.take();
        let checked = match word.is_end() {
            true => Err(word.expected("a file, or off")),
            false => words.end(),
        };
        if checked.is_err() {
            return self.fail(format_args!("{}", words.wrong())).await;
        }
        let file = Some(word.text).filter(|_| !word.is("off"));
        match self.system.capture(file) {
            Ok(()) => Ok(()),
            Err(error) => self.fail(format_args!("{}: {error}", word.text)).await,
        }
    }

    /// Shows frames as they come, until something is typed.
    pub(super) async fn watch(&mut self) -> Result<(), IO::Error> {
        let mut cursor = self.gateway.capture().map_or(0, |capture| capture.end());
        let _following = self.gateway.capture().map(Capture::follow);
        loop {
            self.frames(&mut cursor).await?;
            if self.stops(PAUSE).await? || self.gateway.capture().is_none() {
                return Ok(());
            }
        }
    }

    /// Shows what there is to see, and waits for the next look; says whether something was typed instead.
    pub(super) async fn stops(&mut self, pause: Duration) -> Result<bool, IO::Error> {
        self.out.flush().await?;
        let mut typed = [0; 16];
        match select(self.out.read(&mut typed), Timer::after(pause)).await {
            Either::First(read) => read.map(|_| true),
            Either::Second(()) => Ok(false),
        }
    }
}
