//! Runs a command without a terminal: returns its output piece by piece until it ends or is stopped.

use core::net::IpAddr;

use embassy_futures::select::{Either, select};

use super::job::Job;
use super::mode::Mode;
use super::session::Session;
use super::wait::{Wait, WaitEvent};
use crate::gateway::Gateway;
use crate::hal::System;
use crate::language::{LineError, Words, Wrong};
use crate::settings::{Name, PortId, Role};

/// Why a command did not start.
#[derive(Debug)]
pub(crate) enum NotBegun {
    /// A word is invalid.
    Line(LineError),
    /// It cannot run now; [`Running::text`] has the reason.
    Failed,
}

/// A command that runs for a network user.
pub(crate) struct Running<'s, 'g> {
    session: Session<'s, 'g>,
    job: Job<'g>,
    wait: Wait,
}

impl<'s, 'g> Running<'s, 'g> {
    /// A user connected through `port`, without a command yet.
    pub(crate) fn new(
        gateway: &'s Gateway<'g>,
        system: &'s dyn System,
        (name, role): (&Name, Role),
        peer: IpAddr,
        port: PortId,
    ) -> Self {
        let mode = Mode::User { name, peer, port, edits: false };
        let mut session = Session::new(gateway, system, mode);
        session.role = role;
        Self { session, job: Job::Idle, wait: Wait::End }
    }

    /// Starts the command in a line.
    pub(crate) fn begin(&mut self, line: &str) -> Result<(), NotBegun> {
        let words = Words::new(line);
        let begun = self.session.begin(&words, &mut self.job);
        self.wait = begun.map_err(|Wrong| NotBegun::Line(words.wrong()))?;
        if self.session.failed { Err(NotBegun::Failed) } else { Ok(()) }
    }

    /// The output of the last call of [`next`](Self::next).
    pub(crate) fn text(&self) -> &str {
        &self.session.out.text
    }

    pub(crate) fn has_failed(&self) -> bool {
        self.session.failed
    }

    /// Runs until there is output; returns `false` at the end. `stop` stops it like a key at a terminal.
    pub(crate) async fn next(&mut self, stop: impl AsyncFn()) -> bool {
        self.session.out.clear();
        while self.session.out.text.is_empty() {
            let wait = self.wait;
            let event = match wait {
                Wait::Sent => WaitEvent::Nothing,
                Wait::Pause(_) | Wait::Rest(_) | Wait::Response { .. } | Wait::Open { .. } => {
                    let stopped =
                        async { if wait.listens() { stop().await } else { core::future::pending().await } };
                    match select(self.session.wait(wait), stopped).await {
                        Either::First(event) => event,
                        Either::Second(()) => WaitEvent::Typed(1),
                    }
                }
                // There is no input, and the commands that run here wait for nothing else.
                _ => return false,
            };
            self.wait = self.job.step(&mut self.session, event);
        }
        true
    }
}
