//! A session: its input and the running command.

use super::complete::{Completion, candidates, complete};
use super::input::{Input, Typed};
use super::job::Job;
use super::mode::{Ended, Mode, PROMPT, PROMPT_CANDIDATE, PROMPT_UNSAVED};
use super::session::Session;
use super::update::Failed;
use super::wait::{Wait, WaitEvent};
use crate::gateway::Gateway;
use crate::gateway::audit::Topic;
use crate::hal::{System, Version};
use crate::language::{Words, Wrong};
use crate::settings::USERS;

/// A session.
pub(super) struct Shell<'s, 'g> {
    pub(super) input: Input,
    pub(super) session: Session<'s, 'g>,
    job: Job<'g>,
    /// The input has ended.
    ended: bool,
}

impl<'s, 'g> Shell<'s, 'g> {
    pub(super) fn new(gateway: &'s Gateway<'g>, system: &'s dyn System, mode: Mode<'_>) -> Self {
        let mut session = Session::new(gateway, system, mode);
        session.check_users();
        Self { input: Input::new(mode), session, job: Job::Idle, ended: false }
    }

    /// Waits for the first key of a line.
    pub(super) fn start(&mut self) -> Wait {
        let Self { session, input, ended, .. } = self;
        if *ended || session.ends {
            return Wait::Exit;
        }
        let prompt = match session.gateway.candidate() {
            Some(candidate) if candidate.is_open() => PROMPT_CANDIDATE,
            _ if session.gateway.has_unsaved() => PROMPT_UNSAVED,
            _ => PROMPT,
        };
        input.start(prompt, &session.asks, &mut session.out);
        Wait::Key
    }

    /// Runs the next step after `event`.
    pub(super) fn step(&mut self, event: WaitEvent) -> Wait {
        let Self { input, session, job, ended } = self;
        let wait = match (&job, event) {
            (Job::Idle, WaitEvent::Key(byte)) => {
                let typed = input.feed(byte, &mut session.out);
                self.typed(typed)
            }
            (Job::Idle, WaitEvent::Typed(_)) => {
                *ended = true;
                let typed = input.end(&mut session.out);
                self.typed(typed)
            }
            _ => job.step(session, event),
        };
        let Self { input, session, job, .. } = self;
        if let (Wait::Change, Job::Scan(scan)) = (wait, &*job) {
            // Proposed lines run as if they were typed.
            session.gateway.settings(|settings| input.replace(|line| scan.line(settings, line)));
        }
        if !matches!(wait, Wait::End) {
            return wait;
        }
        let was_idle = matches!(job, Job::Idle);
        self.job = Job::Idle;
        self.session.turn = None;
        let wait = self.start();
        match event {
            // This input did not stop the command: it begins the next one.
            WaitEvent::Key(byte @ b' '..=b'~') if !was_idle => self.step(WaitEvent::Key(byte)),
            _ => wait,
        }
    }

    /// Reports the outcome of an update; a new image is started.
    pub(super) fn updated(&mut self, received: Result<Version, Failed>) -> Wait {
        match self.session.updated(received) {
            Wait::End => self.start(),
            wait => wait,
        }
    }

    fn typed(&mut self, typed: Typed) -> Wait {
        let Self { input, session, job, .. } = self;
        if let (Typed::Line | Typed::Wrong(_), Some(number)) = (&typed, &mut session.line_number) {
            *number = number.saturating_add(u32::from(!USERS || !session.asks.is_log_in()));
        }
        match typed {
            Typed::More => Wait::Key,
            Typed::Columns(columns) => {
                session.out.columns = Some(columns);
                Wait::Key
            }
            Typed::Line if !session.check_role() => Wait::End,
            Typed::Line if USERS && session.asks.prompt().is_some() => {
                let edits = matches!(input, Input::Keys(_));
                session.answered(input.line(), edits)
            }
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
                let what = format_args!("a console session ended: {foreign}");
                session.gateway.audit_refusal(Topic::RefusedClient, None, session.peer, what);
                session.ended = Ended::Foreign(foreign);
                Wait::Exit
            }
        }
    }

    /// Completes the word at the cursor, or lists the candidates.
    fn complete(&mut self) {
        let Self { input: Input::Keys(editor), session, .. } = self else { return };
        if USERS && session.asks.prompt().is_some() {
            return;
        }
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
