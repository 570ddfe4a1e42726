//! The state that commands work on.

use core::fmt;
use core::net::IpAddr;

use embassy_time::Timer;

use super::asks::Asks;
use super::mode::{Ended, Mode};
use super::output::{COLUMNS, Output};
use super::wait::{Wait, WaitEvent};
use crate::fieldbus::{EthercatState, LineWriter};
use crate::gateway::Gateway;
use crate::gateway::audit::{Actor, Topic, Way};
use crate::gateway::cut_off::{CutOff, cut_off};
use crate::gateway::direct_request::{DirectRequestError, Turn};
use crate::gateway::reconfigure::Unchanged;
use crate::hal::{StoreError, System};
use crate::language::{Warning, WithoutSecrets, Words};
use crate::scanner::Pdu;
use crate::settings::{Name, PortId, Role, Settings};

/// The session as its commands see it.
pub(super) struct Session<'s, 'g> {
    pub(super) gateway: &'s Gateway<'g>,
    pub(super) system: &'s dyn System,
    /// Where the user is, if not at the gateway.
    pub(super) peer: Option<IpAddr>,
    /// The configured port through which the user is connected, if any.
    pub(super) port: Option<PortId>,
    /// The authenticated user.
    pub(super) user: Name,
    /// What the user may do.
    pub(super) role: Role,
    /// How the next line is interpreted.
    pub(super) asks: Asks,
    /// Wrong passwords so far.
    // Used only with the feature `users`.
    #[cfg_attr(not(feature = "users"), allow(dead_code))]
    pub(super) failures: u8,
    /// The current command has failed.
    pub(super) failed: bool,
    /// No further line is read.
    pub(super) ends: bool,
    pub(super) out: Output,
    /// The line number for errors, in sessions without an editor.
    pub(super) line_number: Option<u32>,
    /// What last set the line of the EtherCAT port, before the command.
    line_writer: Option<LineWriter>,
    /// The turn for direct requests, while a command has it, and the request; the response replaces it.
    pub(super) turn: Option<Turn<'s, 'g>>,
    pub(super) unit: u8,
    pub(super) pdu: Pdu,
    /// How the session ended, so far.
    pub(super) ended: Ended,
}

impl<'s, 'g> Session<'s, 'g> {
    pub(super) fn new(gateway: &'s Gateway<'g>, system: &'s dyn System, mode: Mode<'_>) -> Self {
        let (line_end, columns, line_number) =
            if mode.edits() { ("\r\n", Some(COLUMNS), None) } else { ("\n", None, Some(0)) };
        Self {
            gateway,
            system,
            peer: mode.peer(),
            port: mode.port(),
            // Names of users fit.
            user: Name::try_from(mode.user()).unwrap_or_default(),
            // The lowest role until log-in.
            role: if mode.peer().is_none() { Role::Engineer } else { Role::Viewer },
            asks: Asks::first(mode),
            failures: 0,
            failed: false,
            ends: false,
            out: Output::new(line_end, columns),
            line_number,
            line_writer: None,
            turn: None,
            unit: 0,
            pdu: Pdu::new(),
            ended: Ended::Left { refused: false },
        }
    }
}

impl Session<'_, '_> {
    /// Who is at the console, for the audit trail.
    pub(super) fn actor(&self) -> Actor<'_> {
        match self.peer {
            None => Actor::Local,
            Some(peer) if self.user.is_empty() => Actor::Peer(peer),
            Some(peer) => Actor::User { name: &self.user, peer },
        }
    }

    /// Writes a line of the audit trail.
    pub(super) fn audit(&self, topic: Topic, what: fmt::Arguments<'_>) {
        self.gateway.audit(topic, self.actor(), what);
    }

    /// Writes an audited command that has started; all its words were valid.
    pub(super) fn audit_command(&self, is_audited: bool, words: &Words<'_>) {
        if is_audited && !self.failed {
            self.audit(Topic::Command, format_args!("{}", WithoutSecrets(words.line)));
        }
    }

    /// Writes a command that the role may not run.
    pub(super) fn audit_denied(&self, command: &str) {
        let what = format_args!("{command} is denied to the role {}", self.role);
        self.gateway.audit_refusal(Topic::DeniedCommand, None, self.peer, what);
    }

    /// Writes a `line` of settings as typed.
    pub(super) fn audit_line(&self, line: &str) {
        self.audit(Topic::Settings, format_args!("{}", WithoutSecrets(line)));
    }

    /// Writes the changes that `new` settings make.
    pub(super) fn audit_difference(&self, new: &Settings) {
        self.gateway.audit_difference(self.actor(), new);
    }

    /// Refuses `new` settings that would cut off the session.
    pub(super) fn ahead(&self, new: &Settings) -> Result<(), CutOff> {
        let way = Way { port: self.port, by_name: false };
        let why = self.gateway.settings(|in_force| cut_off(in_force, new, self.actor(), way));
        why.map_or(Ok(()), Err)
    }

    /// Reports an error, which ends the command.
    pub(super) fn fail(&mut self, what: &dyn fmt::Display) -> Wait {
        self.failed = true;
        self.ended = Ended::Left { refused: true };
        match self.line_number {
            Some(number @ 1..) => self.out.line(format_args!("error: line {number}, {what}")),
            _ => self.out.line(format_args!("error: {what}")),
        }
        Wait::End
    }

    /// Takes the turn for direct requests at `port`.
    pub(super) fn take_turn(&mut self, port: PortId) -> Result<(), DirectRequestError> {
        self.turn = Some(self.gateway.turn(port)?);
        Ok(())
    }

    /// Asks `unit`.
    pub(super) fn ask_unit(&mut self, unit: u8, request: &[u8], typed_ends: bool) -> Wait {
        self.unit = unit;
        self.pdu.clear();
        // Requests fit a PDU.
        let _ = self.pdu.extend_from_slice(request);
        Wait::Response { typed_ends }
    }

    /// Waits for the time, or for the units of the turn.
    pub(super) async fn wait(&mut self, wait: Wait) -> WaitEvent {
        match (wait, &self.turn) {
            (Wait::Pause(time) | Wait::Rest(time), _) => Timer::after(time).await,
            (Wait::Response { .. }, Some(turn)) => {
                return WaitEvent::Response(turn.ask(self.unit, &mut self.pdu).await);
            }
            (Wait::Open { line, timeout, alone }, Some(turn)) => {
                return WaitEvent::Opened(turn.try_on(line, timeout, alone).await);
            }
            _ => {}
        }
        WaitEvent::Nothing
    }

    /// Applies a line of the settings' language.
    pub(super) fn change(&mut self) -> Wait {
        self.line_writer = self.writer();
        Wait::Change
    }

    /// Reports the outcome.
    pub(super) fn changed(&mut self, changed: Result<Option<Warning>, Unchanged>) {
        let writer = self.writer();
        if let Some(writer @ LineWriter::SettingsOver(_)) = writer.filter(|_| writer != self.line_writer) {
            self.out.line(format_args!("warning: the line of the ethercat port: {writer}"));
        }
        match changed {
            Ok(Some(warning)) => self.out.line(format_args!("warning: {warning}")),
            Ok(None) => {}
            Err(error) => _ = self.fail(&error),
        }
    }

    pub(super) fn saved(&mut self, saved: Result<(), StoreError>) {
        match saved {
            Ok(()) => {
                self.audit(Topic::Save, format_args!("save"));
                self.out.line(format_args!("saved"));
            }
            Err(error) => _ = self.fail(&error),
        }
    }

    pub(super) fn loaded(&mut self, loaded: Result<usize, Unchanged>) {
        match loaded {
            Ok(0) => _ = self.fail(&"nothing is saved"),
            Ok(_) => self.out.line(format_args!("loaded")),
            Err(error) => _ = self.fail(&error),
        }
    }

    fn writer(&self) -> Option<LineWriter> {
        self.gateway.ethercat().map(EthercatState::line_writer)
    }
}
