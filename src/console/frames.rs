//! Recorded frames, and new ones as they arrive: one line of text each, or a file.

use embassy_time::Duration;

use super::rows::{Bytes, port_name, text};
use super::session::Session;
use super::wait::{Wait, WaitEvent};
use crate::capture::{Capture, Captured, Following, Head};
use crate::gateway::{ApplyError, Gateway};
use crate::language::{Words, Wrong};

/// Polling interval of `watch`.
const PAUSE: Duration = Duration::from_millis(50);
/// Bytes of a frame per step: in ASCII each may take four characters.
const PIECE_BYTES_MAX: usize = 128;

/// Shows frames in the order of their numbers.
pub(super) struct Frames<'g> {
    cursor: u32,
    /// Later frames are left for the next poll.
    end: u32,
    /// Set by `watch`: continues until a key is typed.
    following: Option<Following<'g>>,
    /// The frame being shown, and the bytes shown so far.
    frame: Option<Captured>,
    shown: usize,
}

impl<'g> Frames<'g> {
    /// The recorded frames.
    pub(super) fn last(gateway: &Gateway<'g>) -> Self {
        let end = gateway.capture().map_or(0, Capture::end);
        Self { cursor: 0, end, following: None, frame: None, shown: 0 }
    }

    /// Frames from now on.
    pub(super) fn to_come(gateway: &Gateway<'g>) -> Self {
        let last = Self::last(gateway);
        Self { cursor: last.end, following: gateway.capture().map(Capture::follow), ..last }
    }

    /// Shows the next piece of the frame, or starts the next frame.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        let Some(capture) = session.gateway.capture() else { return session.fail(&ApplyError::NoCapture) };
        if matches!(event, WaitEvent::Typed(_)) {
            return Wait::End;
        }
        if let Some(frame) = &mut self.frame {
            let rest = frame.bytes.get(self.shown..).unwrap_or_default();
            let piece = rest.get(..PIECE_BYTES_MAX).unwrap_or(rest);
            session.out.put(format_args!("{}", Bytes { kind: frame.head.kind, bytes: piece }));
            self.shown += piece.len();
            if piece.len() == rest.len() {
                self.shown = 0;
                if !capture.next_part(frame) {
                    session.out.end();
                    self.frame = None;
                }
            }
            return Wait::Sent;
        }
        if self.cursor == self.end {
            if self.following.is_none() {
                return Wait::End;
            }
            self.end = capture.end();
            return Wait::Pause(PAUSE);
        }
        self.frame = capture.next(&mut self.cursor);
        self.shown = 0;
        match &self.frame {
            Some(frame) => head(session, frame, self.cursor > frame.missed + 1),
            None => self.cursor = self.end,
        }
        Wait::Sent
    }
}

/// Shows a frame's header, and how many frames were lost before it if it `follows` others.
fn head(session: &mut Session<'_, '_>, frame: &Captured, follows: bool) {
    let Captured { head: Head { at, port, sent, verdict, .. }, missed, .. } = frame;
    if *missed > 0 && follows {
        session.out.line(format_args!("({missed} frames more)"));
    }
    let time = text(format_args!("{}.{:06}", at.as_secs(), at.as_micros() % 1_000_000));
    let name = port_name(session.gateway, *port);
    let direction = if *sent { ">" } else { "<" };
    let verdict = verdict.name();
    session.out.put(format_args!("{time:>14} {name:15} {direction} {verdict:10} "));
}

impl Session<'_, '_> {
    /// Starts or ends writing frames to a file.
    pub(super) fn capture(&mut self, words: &Words<'_>) -> Result<Wait, Wrong> {
        let word = words.take();
        if word.is_end() {
            return Err(word.expected("a file, or off"));
        }
        words.end()?;
        let file = Some(word.text).filter(|_| !word.is("off"));
        Ok(match self.system.capture(file) {
            Ok(()) => Wait::End,
            Err(error) => self.fail(&format_args!("{}: {error}", word.text)),
        })
    }
}
