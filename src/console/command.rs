//! The commands: what a line begins.

use embassy_time::Instant;

use super::ask::Ask;
use super::frames::Frames;
use super::help::Help;
use super::job::Job;
use super::point_command::PointCommand;
use super::session::Session;
use super::show::{Show, Table};
use super::wait::{Begun, Wait};
use crate::language::{Words, Wrong};

/// What a command's first word asks for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Command {
    Help,
    /// A line of the settings' language.
    Settings,
    Show,
    Clear,
    Ask(Ask),
    Scan,
    Tune,
    Capture,
    Watch,
    /// What is done with a data point at once.
    Point(PointCommand),
    Save,
    /// A command that has no words of its own.
    Alone(Wait),
}

/// Every command, in the order of `help`.
pub(super) const COMMANDS: &[(&str, Command)] = &[
    ("help", Command::Help),
    ("port", Command::Settings),
    ("server", Command::Settings),
    ("route", Command::Settings),
    ("device", Command::Settings),
    ("point", Command::Settings),
    ("slave", Command::Settings),
    ("edit", Command::Settings),
    ("insert", Command::Settings),
    ("move", Command::Settings),
    ("delete", Command::Settings),
    ("network", Command::Settings),
    ("mdns", Command::Settings),
    ("show", Command::Show),
    ("read", Command::Point(PointCommand::Read)),
    ("write", Command::Point(PointCommand::Write)),
    ("mark", Command::Point(PointCommand::Mark)),
    ("begin", Command::Point(PointCommand::Begin)),
    ("finish", Command::Point(PointCommand::Finish)),
    ("clear", Command::Clear),
    ("ping", Command::Ask(Ask::Ping)),
    ("scan", Command::Scan),
    ("tune", Command::Tune),
    ("capture", Command::Capture),
    ("watch", Command::Watch),
    ("save", Command::Save),
    ("load", Command::Alone(Wait::Load)),
    ("reboot", Command::Alone(Wait::Reboot)),
    ("exit", Command::Alone(Wait::Exit)),
];

pub(super) const TOPICS_SHOW: &[(&str, Show)] = &[
    ("ports", Show::Ports),
    ("servers", Show::Servers),
    ("routes", Show::Routes),
    ("units", Show::Units),
    ("clients", Show::Clients),
    ("stats", Show::Stats),
    ("points", Show::Points),
    ("devices", Show::Devices),
    ("registers", Show::Registers),
    ("config", Show::Config),
    ("network", Show::Network),
    ("log", Show::Log),
    ("frames", Show::Frames),
    ("version", Show::Version),
];

#[derive(Debug, Clone, Copy)]
pub(super) enum Clear {
    Stats,
    Log,
}

pub(super) const TOPICS_CLEAR: &[(&str, Clear)] = &[("stats", Clear::Stats), ("log", Clear::Log)];

#[derive(Debug, Clone, Copy)]
pub(super) enum Watch {
    Points,
}

/// What is watched besides frames.
pub(super) const TOPICS_WATCH: &[(&str, Watch)] = &[("points", Watch::Points)];

impl<'g> Session<'_, 'g> {
    /// Begins what the words of a line say: a command that takes more than this step becomes the `job`.
    pub(super) fn begin(&mut self, words: &Words<'_>, job: &mut Job<'g>) -> Result<Wait, Wrong> {
        let verb = words.take();
        if verb.is_end() {
            return Ok(Wait::End);
        }
        let begins_with_digit = words.peek().begins_with_digit();
        Ok(match verb.keyword(COMMANDS, "a command (see help)")? {
            Command::Settings => self.change(),
            Command::Show => {
                *job = match topic(words, TOPICS_SHOW, SHOW_EXPECTED)? {
                    Show::Frames => Job::Frames(Frames::last(self.gateway)),
                    show => Job::Show(Table::new(show)),
                };
                Wait::Sent
            }
            Command::Help => {
                *job = Job::Help(Help::parse(words)?);
                Wait::Sent
            }
            Command::Ask(ask) => return begun(self.ask(ask, words), job, Job::Ask),
            Command::Scan => return begun(self.scan(words), job, Job::Scan),
            Command::Tune => return begun(self.tune(words), job, Job::Tune),
            Command::Capture => return self.capture(words),
            // Names begin with a letter.
            Command::Point(PointCommand::Read) if begins_with_digit => {
                return begun(self.ask(Ask::Read, words), job, Job::Ask);
            }
            Command::Point(PointCommand::Write) if begins_with_digit => {
                return begun(self.ask(Ask::Write, words), job, Job::Ask);
            }
            Command::Point(command) => return begun(self.point(command, words), job, Job::Point),
            Command::Clear => {
                self.clear(topic(words, TOPICS_CLEAR, "stats or log")?);
                Wait::End
            }
            Command::Watch if !words.peek().is_end() => match topic(words, TOPICS_WATCH, "points")? {
                Watch::Points => return begun(self.watch_points(), job, Job::Point),
            },
            Command::Watch => {
                *job = Job::Frames(Frames::to_come(self.gateway));
                Wait::Sent
            }
            Command::Save => save(words)?,
            Command::Alone(wait) => {
                words.end()?;
                if let Wait::Reboot = wait {
                    self.out.line(format_args!("starting again"));
                }
                wait
            }
        })
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

/// Lets what a command has begun be the `job`.
fn begun<'g, J>(begun: Begun<J>, job: &mut Job<'g>, make: fn(J) -> Job<'g>) -> Result<Wait, Wrong> {
    let (begun, wait) = begun?;
    if let Some(begun) = begun {
        *job = make(begun);
    }
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

const SHOW_EXPECTED: &str = "ports, servers, routes, units, clients, stats, points, devices, registers, config, network, \
     log, frames or version";

/// The last word of a line as a topic of `table`.
fn topic<T: Copy>(words: &Words, table: &[(&'static str, T)], expected: &'static str) -> Result<T, Wrong> {
    let topic = words.take().keyword(table, expected)?;
    words.end()?;
    Ok(topic)
}
