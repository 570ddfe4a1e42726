//! A session's state: what is typed, what commands work on, and the one that runs.

use core::fmt;

use super::complete::{Completion, candidates, complete};
use super::input::{Input, Typed};
use super::job::{Came, Job, Wait};
use super::output::Output;
use super::{Ended, Mode, PROMPT, PROMPT_UNSAVED};
use crate::gateway::Gateway;
use crate::gateway::direct_request::{NotAsked, Turn};
use crate::gateway::reconfigure::Unchanged;
use crate::hal::{StoreError, System};
use crate::language::{Warning, Words, Wrong};
use crate::port::ethercat::{EthercatPlace, LineWriter};
use crate::scanner::Pdu;
use crate::settings::PortId;

/// All of it.
pub(super) struct Console<'s, 'g> {
    pub(super) input: Input,
    pub(super) session: Session<'s, 'g>,
    job: Job<'g>,
    /// No more input comes.
    ended: bool,
}

/// What commands work on.
pub(super) struct Session<'s, 'g> {
    pub(super) gateway: &'s Gateway<'g>,
    pub(super) system: &'s dyn System,
    pub(super) out: Output,
    /// The number of the line for error texts, where input has lines and not a person before it.
    line_number: Option<u32>,
    /// Who had the last word about the line of the EtherCAT port, before the command.
    line_writer: Option<LineWriter>,
    /// The turn to ask units, while a command has it, and what it asks; the answer comes in place of the request.
    pub(super) turn: Option<Turn<'s, 'g>>,
    pub(super) unit: u8,
    pub(super) pdu: Pdu,
    /// How the session ends, as far as it has come.
    pub(super) ended: Ended,
}

impl<'s, 'g> Console<'s, 'g> {
    pub(super) fn new(gateway: &'s Gateway<'g>, system: &'s dyn System, mode: Mode) -> Self {
        let (line_end, line_number) = if mode.edits() { ("\r\n", None) } else { ("\n", Some(0)) };
        let session = Session {
            gateway,
            system,
            out: Output::new(line_end),
            line_number,
            line_writer: None,
            turn: None,
            unit: 0,
            pdu: Pdu::new(),
            ended: Ended::Left { refused: false },
        };
        Self { input: Input::new(mode), session, job: Job::Idle, ended: false }
    }

    /// Waits for the first key of a line.
    pub(super) fn start(&mut self) -> Wait {
        if self.ended {
            return Wait::Exit;
        }
        let prompt = if self.session.gateway.has_unsaved() { PROMPT_UNSAVED } else { PROMPT };
        self.input.start(prompt, &mut self.session.out);
        Wait::Key
    }

    /// Goes on behind what `came`.
    pub(super) fn step(&mut self, came: Came) -> Wait {
        let Self { input, session, job, ended } = self;
        let wait = match (&job, came) {
            (Job::Idle, Came::Key(byte)) => {
                let typed = input.feed(byte, &mut session.out);
                self.typed(typed)
            }
            (Job::Idle, Came::Typed(_)) => {
                *ended = true;
                let typed = input.end(&mut session.out);
                self.typed(typed)
            }
            _ => job.step(session, came),
        };
        if !matches!(wait, Wait::End) {
            return wait;
        }
        self.job = Job::Idle;
        self.session.turn = None;
        self.start()
    }

    fn typed(&mut self, typed: Typed) -> Wait {
        let Self { input, session, job, .. } = self;
        if let (Typed::Line | Typed::Wrong(_), Some(number)) = (&typed, &mut session.line_number) {
            *number = number.saturating_add(1);
        }
        match typed {
            Typed::More => Wait::Key,
            Typed::Line => {
                let words = Words::new(input.line());
                session.begin(&words, job).unwrap_or_else(|Wrong| session.fail(&words.wrong()))
            }
            Typed::Wrong(error) => session.fail(&error),
            Typed::Complete => {
                self.complete();
                Wait::Key
            }
            Typed::Leave => {
                if !self.ended {
                    session.out.line(format_args!("exit"));
                }
                Wait::Exit
            }
            Typed::Stop => {
                session.ended = Ended::Stopped;
                Wait::Exit
            }
            Typed::Foreign(foreign) => {
                session.ended = Ended::Foreign(foreign);
                Wait::Exit
            }
        }
    }

    /// Completes the word at the cursor, or shows how it could go on.
    fn complete(&mut self) {
        let Self { input: Input::Keys(editor), session, .. } = self else { return };
        let before = editor.before_cursor();
        match session.gateway.settings(|settings| complete(before, settings)) {
            Completion::None => editor.bell(),
            Completion::Append(text) => editor.insert_text(&text),
            Completion::Several => {
                session.out.end();
                session.gateway.settings(|settings| {
                    candidates(before, settings, &mut |word| session.out.put(format_args!("{word}  ")));
                });
                session.out.end();
                editor.redraw();
            }
        }
        editor.echo_to(&mut session.out);
    }
}

impl Session<'_, '_> {
    /// Says what is wrong; the command ends with that.
    pub(super) fn fail(&mut self, what: &dyn fmt::Display) -> Wait {
        self.ended = Ended::Left { refused: true };
        match self.line_number {
            Some(number) => self.out.line(format_args!("error: line {number}, {what}")),
            None => self.out.line(format_args!("error: {what}")),
        }
        Wait::End
    }

    /// Takes the turn to ask units at `port`.
    pub(super) fn take_turn(&mut self, port: PortId) -> Result<(), NotAsked> {
        self.turn = Some(self.gateway.turn(port)?);
        Ok(())
    }

    /// Asks `unit`.
    pub(super) fn ask_unit(&mut self, unit: u8, request: &[u8], typed_ends: bool) -> Wait {
        self.unit = unit;
        self.pdu.clear();
        // No request is longer than a PDU may be.
        let _ = self.pdu.extend_from_slice(request);
        Wait::Answer { typed_ends }
    }

    /// A line of the settings' language has to be applied.
    pub(super) fn change(&mut self) -> Wait {
        self.line_writer = self.writer();
        Wait::Change
    }

    /// Says what came of it.
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
            Ok(()) => self.out.line(format_args!("saved")),
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
        self.gateway.ethercat().map(EthercatPlace::line_writer)
    }
}

/// What a command waits for first, unless its words are wrong.
pub(super) type Begun = Result<Wait, Wrong>;
