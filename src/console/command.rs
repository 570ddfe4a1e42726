//! The commands of the console.
//!
//! A command is declared once, in [`COMMANDS`]: its name, its help, its completion, and what it does. The verbs of the settings'
//! language are declared there; [`Session::change`] runs them.

use embassy_time::Instant;

use super::ask::{Ask, READ_HELP, WRITE_HELP};
use super::candidate;
#[cfg(feature = "web")] // As its module.
use super::explain;
use super::frames::Frames;
use super::help::Help;
use super::job::Job;
use super::known::Known;
use super::log_in::Denied;
use super::point_command::PointCommand;
use super::run::{Run, command};
use super::session::Session;
use super::show::{self, Show, TOPICS, Table};
use super::wait::{Begun, Wait};
use crate::language::listed::listed;
use crate::language::{Offer, Problem, VERBS, Verb, Verbs, Word, Words, Wrong};
use crate::settings::Role::{self, Engineer, Operator, Viewer};
use crate::settings::USERS;

const PORTS: &[Offer] = &[Offer::Ports];
const POINTS: &[Offer] = &[Offer::Points];

/// The commands besides the lines of settings.
const COMMANDS: Verbs<Run> = &[
    (
        "show",
        command(Viewer, "show TOPIC\thow things are: ports, units, routes, ...", |session, words, job| {
            let show = show::topic(words)?;
            if let Some(denied) = show.denied(session) {
                return Ok(session.fail(&denied));
            }
            *job = match show {
                Show::Frames => Job::Frames(Frames::last(session.gateway)),
                show => Job::Show(Table::new(show)),
            };
            Ok(Wait::Sent)
        })
        .then(&[Offer::Each(|each| TOPICS.iter().for_each(|(word, _)| each(word)))], &[]),
    ),
    (
        "ping",
        command(
            Operator,
            "ping UNIT via PORT\tasks a unit for a sign of life (function 8)",
            |session, words, job| begun(session.ask(Ask::Ping, words), job, Job::Ask),
        ),
    ),
    (
        "scan",
        ordered(
            Engineer,
            "scan PORT [OPTION]...\tfinds the devices on a serial client's line
  OPTION: BAUD, units A-B, timeout T, function N
  Each speed is tried as 8E1, 8N1, 8O1 and 8N2 (ascii: 7E1, 7N2, 7O1, 8N1).
  Default: the port's own, then 9600 19200 38400 115200 57600 4800 2400 1200;
  units 1-247, 60ms and some characters, function 3; late ones again. A key
  or a line stops it. Others get 0A meanwhile; then the port is as before.
  scan P1 9600 19200 units 1-32",
            |session, words, job| begun(session.scan(words), job, Job::Scan),
        )
        .then(PORTS, &[]),
    ),
    (
        "tune",
        ordered(
            Engineer,
            "tune PORT [OPTION]...\tmeasures response times, proposes a timeout
tune PORT [units A-B] [count N]
  Asks each unit N times (2000), those that have responded so far unless
  some are named, with a timeout of 3s. Other traffic goes on.
  A key or a line stops it, and then it proposes nothing.",
            |session, words, job| begun(session.tune(words), job, Job::Tune),
        )
        .then(PORTS, &[]),
    ),
    (
        "read",
        command(Operator, READ_HELP, |session, words, job| {
            session.access(PointCommand::Read, Ask::Read, words, job)
        })
        .then(POINTS, POINTS),
    ),
    (
        "write",
        ordered(Operator, WRITE_HELP, |session, words, job| {
            session.access(PointCommand::Write, Ask::Write, words, job)
        })
        .then(POINTS, POINTS),
    ),
    #[cfg(feature = "web")] // As its module.
    explain::COMMAND,
    (
        "mark",
        of_points(
            Operator,
            "mark DEVICE FUNCTION FROM-TO\treads or writes all points there at once
  FUNCTION: 1 to 4 reads, 5, 6, 15 or 16 writes",
            |session, words, job| begun(session.point(PointCommand::Mark, words), job, Job::Point),
        )
        .then(&[Offer::Devices], &[Offer::Devices]),
    ),
    (
        "begin",
        of_points(
            Operator,
            "begin POINT\tbegins a safe write, which finish ends
  The point is neither read nor written until then.
  It ends without a write when nothing is set for 60s.",
            |session, words, job| begun(session.point(PointCommand::Begin, words), job, Job::Point),
        )
        .then(POINTS, POINTS),
    ),
    (
        "finish",
        of_points(
            Operator,
            "finish POINT\tends a safe write: the point is written",
            |session, words, job| begun(session.point(PointCommand::Finish, words), job, Job::Point),
        )
        .then(POINTS, POINTS),
    ),
    (
        "clear",
        ordered(
            Operator,
            "clear stats|log\tforgets counters or transactions
clear stats\tsets counters to zero, those of units too
clear log\tforgets the transactions",
            |session, words, _| {
                session.clear(topic(words, TOPICS_CLEAR, TOPICS_CLEAR_EXPECTED)?);
                Ok(Wait::End)
            },
        )
        .then(&[Offer::Each(|each| TOPICS_CLEAR.iter().for_each(|(word, _)| each(word)))], &[]),
    ),
    (
        "capture",
        ordered(
            Engineer,
            "capture FILE|off\twrites frames into a file, for Wireshark
capture FILE\ta new one (PCAPNG); on Linux
capture off\tends that
  By network, on boards too: port wire tcp server 5029 capture, then
  nc BOARD 5029 | wireshark -k -i -",
            |session, words, _| session.capture(words),
        ),
    ),
    (
        "watch",
        command(
            Viewer,
            "watch [points]\tshows what comes, until a key or a line
watch\tframes of all ports
watch points\tdata points whose status or values change",
            |session, words, job| {
                if words.peek().is_end() {
                    *job = Job::Frames(Frames::to_come(session.gateway));
                    return Ok(Wait::Sent);
                }
                topic(words, &[("points", ())], "points")?;
                begun(session.watch_points(), job, Job::Point)
            },
        )
        .then(&[Offer::Words(&["points"])], &[]),
    ),
    (
        "password",
        command(
            Engineer,
            "password NAME\tsets the password of a user
  It is asked for, at a terminal twice, and has 8 to 64 characters.",
            |session, words, _| session.password(words),
        )
        .then(&[Offer::Users], &[])
        .of_users(|session, _, _| Ok(session.fail(&Problem::NoUsers))),
    ),
    (
        "save",
        command(
            Engineer,
            "save [force]\tkeeps the settings for the next start
save\ttill then the prompt is mobgate*>
save force\talso where the file was edited since it was read",
            |_, words, _| save(words),
        )
        .then(&[Offer::Words(&["force"])], &[]),
    ),
    (
        "load",
        command(Engineer, "load\ttakes the saved settings back", |_, words, _| alone(words, Wait::Load)),
    ),
    (
        "update",
        command(
            Engineer,
            "update [older]\ttakes new firmware from this terminal, by YMODEM
update\tthen send the file: sb in Linux and minicom,
\tTransfer, YMODEM in Tera Term; Ctrl-C cancels
update older\talso if it is older than what runs here
  A file with a right signature starts at once, on trial: if it does not
  prove itself, what runs now comes back, with its settings.",
            |session, words, _| session.update(words),
        )
        .then(&[Offer::Words(&["older"])], &[]),
    ),
    (
        "reboot",
        ordered(Engineer, "reboot\tstarts again with the saved settings", |session, words, _| {
            let wait = alone(words, Wait::Reboot)?;
            session.out.line(format_args!("starting again"));
            Ok(wait)
        }),
    ),
    ("exit", command(Viewer, "exit\tends this session", |_, words, _| alone(words, Wait::Exit))),
    (
        "help",
        command(Viewer, "help [WORD]\tthis list, or all about a command", |session, words, job| {
            let word = words.take();
            words.end()?;
            *job = Job::Help(if word.is_end() {
                Help::overview(known, session.role)
            } else {
                Help::of(find(word)?)
            });
            Ok(Wait::Sent)
        })
        .then(&[Offer::Verbs], &[]),
    ),
];

/// A command whose lines the audit trail has.
const fn ordered(role: Role, help: &'static str, run: Run) -> Verb<Run> {
    command(role, help, run).audited()
}

/// The same of data points; refused by images without them.
const fn of_points(role: Role, help: &'static str, run: Run) -> Verb<Run> {
    ordered(role, help, run).of_points(|session, _, _| Ok(session.fail(&Problem::NoPoints)))
}

/// Words of other consoles, with their equivalents here.
const ELSEWHERE: &[(&str, &str)] = &[
    ("?", "help"),
    ("quit", "exit"),
    ("q", "exit"),
    ("logout", "exit"),
    ("ls", "show config"),
    ("list", "show config"),
    ("config", "show config"),
    ("status", "show ports"),
    ("ports", "show ports"),
    ("units", "show units"),
    ("log", "show log"),
    ("version", "show version"),
    ("undo", "load (takes the saved settings back) or delete"),
    ("no", "delete"),
    ("remove", "delete"),
    ("set", "edit"),
    ("commit", "save"),
    ("restart", "reboot"),
    ("upgrade", "update"),
];

/// The command at this index.
pub(super) fn known(at: usize) -> Option<Known> {
    match VERBS.get(at) {
        Some(verb) => Some(Known::new(verb)),
        None => {
            let at = at.checked_sub(VERBS.len())?;
            let more = || candidate::COMMANDS.get(at - COMMANDS.len());
            COMMANDS.get(at).or_else(more).map(Known::new)
        }
    }
}

pub(super) fn commands() -> impl Iterator<Item = Known> {
    (0..).map_while(known)
}

/// The command that `word` names.
pub(super) fn find(word: Word<'_>) -> Result<Known, Wrong> {
    let name = |at| known(at).map(|known| known.name);
    let found = commands().find(|known| word.is(known.name));
    found.ok_or_else(|| word.unknown(&name, ELSEWHERE, "a command (see help)"))
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Clear {
    Stats,
    Log,
}

const TOPICS_CLEAR: &[(&str, Clear)] = &[("stats", Clear::Stats), ("log", Clear::Log)];
const TOPICS_CLEAR_EXPECTED: &str = listed!(TOPICS_CLEAR);

impl<'g> Session<'_, 'g> {
    /// Runs a line. A command of several steps becomes the `job`.
    pub(super) fn begin(&mut self, words: &Words<'_>, job: &mut Job<'g>) -> Result<Wait, Wrong> {
        let verb = words.take();
        if verb.is_end() {
            return Ok(Wait::End);
        }
        let known = find(verb)?;
        if words.peek().is("?") {
            *job = Job::Help(Help::of(known));
            return Ok(Wait::Sent);
        }
        self.failed = false;
        if USERS && self.role < known.role {
            self.audit_denied(known.name);
            return Ok(self.fail(&Denied::Role { needed: known.role, own: self.role }));
        }
        match verb.lookup(COMMANDS).or_else(|| verb.lookup(candidate::COMMANDS)) {
            Some(command) => {
                let begun = (command.run)(self, words, job)?;
                self.audit_command(command.audited, words);
                Ok(begun)
            }
            None => Ok(self.change()),
        }
    }

    /// `read` and `write` of a point, or of a unit directly. Units are numbers; names begin with a letter.
    fn access(
        &mut self,
        command: PointCommand,
        ask: Ask,
        words: &Words<'_>,
        job: &mut Job<'g>,
    ) -> Result<Wait, Wrong> {
        if words.peek().begins_with_digit() {
            return begun(self.ask(ask, words), job, Job::Ask);
        }
        begun(self.point(command, words), job, Job::Point)
    }

    fn clear(&self, what: Clear) {
        match what {
            Clear::Stats => {
                for port in self.gateway.port_states() {
                    port.stats.clear(Instant::now());
                    port.units(|units| units.clear_counters());
                }
            }
            Clear::Log => self.gateway.log().clear(),
        }
    }
}

/// Makes a started command the `job`.
fn begun<'g, J>(begun: Begun<J>, job: &mut Job<'g>, make: fn(J) -> Job<'g>) -> Result<Wait, Wrong> {
    let (begun, wait) = begun?;
    if let Some(begun) = begun {
        *job = make(begun);
    }
    Ok(wait)
}

/// A command without arguments.
fn alone(words: &Words<'_>, wait: Wait) -> Result<Wait, Wrong> {
    words.end()?;
    Ok(wait)
}

/// `save`, or `save force`.
fn save(words: &Words<'_>) -> Result<Wait, Wrong> {
    let whatever = !words.peek().is_end();
    if whatever {
        words.take().keyword(&[("force", ())], "force")?;
    }
    words.end()?;
    Ok(Wait::Save { whatever })
}

/// Parses the last word of a line as a topic of `table`.
fn topic<T: Copy>(words: &Words, table: &[(&'static str, T)], expected: &'static str) -> Result<T, Wrong> {
    let topic = words.take().keyword(table, expected)?;
    words.end()?;
    Ok(topic)
}
