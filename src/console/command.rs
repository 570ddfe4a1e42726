//! The commands: one line in, its answer out.

use core::fmt;

use embassy_time::Instant;
use embedded_io_async::{Read, Write};

use super::ask::Ask;
use super::help;
use super::output::Output;
use super::show::Show;
use crate::config::{Words, Wrong};
use crate::drafting;
use crate::gateway::Gateway;
use crate::hal::{Store, System};
use crate::port::ethercat::{EthercatPlace, LineWriter};

/// What a command's first word asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Command {
    Help,
    /// A line of the settings' language.
    Settings,
    Show,
    Clear,
    /// `ping`
    Ping,
    Scan,
    Tune,
    Capture,
    Watch,
    Save,
    Load,
    Reboot,
    Exit,
    /// What is done with a data point at once.
    Point(PointCommand),
}

/// What is done with a point at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointCommand {
    Read,
    Write,
    Mark,
    Begin,
    Finish,
}

/// Every command, in the order of `help`.
pub(super) const COMMANDS: &[(&str, Command)] = &[
    ("help", Command::Help),
    ("port", Command::Settings),
    ("route", Command::Settings),
    ("device", Command::Settings),
    ("point", Command::Settings),
    ("slave", Command::Settings),
    ("edit", Command::Settings),
    ("insert", Command::Settings),
    ("move", Command::Settings),
    ("delete", Command::Settings),
    ("network", Command::Settings),
    ("show", Command::Show),
    ("read", Command::Point(PointCommand::Read)),
    ("write", Command::Point(PointCommand::Write)),
    ("mark", Command::Point(PointCommand::Mark)),
    ("begin", Command::Point(PointCommand::Begin)),
    ("finish", Command::Point(PointCommand::Finish)),
    ("clear", Command::Clear),
    ("ping", Command::Ping),
    ("scan", Command::Scan),
    ("tune", Command::Tune),
    ("capture", Command::Capture),
    ("watch", Command::Watch),
    ("save", Command::Save),
    ("load", Command::Load),
    ("reboot", Command::Reboot),
    ("exit", Command::Exit),
];

pub(super) const TOPICS_SHOW: &[(&str, Show)] = &[
    ("ports", Show::Ports),
    ("routes", Show::Routes),
    ("units", Show::Units),
    ("clients", Show::Clients),
    ("stats", Show::Stats),
    ("points", Show::Points),
    ("devices", Show::Devices),
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

/// Whether the session goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    Line,
    Exit,
}

/// What commands work on.
pub(super) struct Session<'s, 'g, IO, S, Y> {
    pub(super) gateway: &'s Gateway<'g>,
    pub(super) out: Output<IO>,
    pub(super) store: &'s mut S,
    pub(super) system: &'s Y,
    /// The number of the line for error texts, where input has lines and not a person before it.
    pub(super) line_number: Option<u32>,
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Runs `line`; what is wrong with it is said on the stream, and only the stream's own errors are returned.
    pub(super) async fn execute(&mut self, line: &str) -> Result<Next, IO::Error> {
        let words = Words::new(line);
        let verb = words.take();
        if verb.is_end() {
            return Ok(Next::Line);
        }
        match verb.keyword(COMMANDS, "a command (see help)") {
            Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            Ok(Command::Settings) => self.change(line).await?,
            Ok(Command::Show) => match topic(&words, TOPICS_SHOW, SHOW_EXPECTED) {
                Ok(show) => self.show(show).await?,
                Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            },
            Ok(Command::Ping) => self.ask(Ask::Ping, &words).await?,
            Ok(Command::Scan) => self.scan(&words).await?,
            Ok(Command::Tune) => self.tune(&words).await?,
            Ok(Command::Capture) => self.capture(&words).await?,
            // Names begin with a letter.
            Ok(Command::Point(PointCommand::Read)) if begins_with_digit(&words) => {
                self.ask(Ask::Read, &words).await?;
            }
            Ok(Command::Point(PointCommand::Write)) if begins_with_digit(&words) => {
                self.ask(Ask::Write, &words).await?;
            }
            Ok(Command::Point(command)) => self.point(command, &words).await?,
            Ok(Command::Clear) => match topic(&words, TOPICS_CLEAR, "stats or log") {
                Ok(Clear::Stats) => {
                    for place in self.gateway.places() {
                        place.stats.clear(Instant::now());
                        place.units(|units| units.clear_counters());
                    }
                }
                Ok(Clear::Log) => self.gateway.log().clear(),
                Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            },
            Ok(Command::Watch) if !words.peek().is_end() => match topic(&words, TOPICS_WATCH, "points") {
                Ok(Watch::Points) => self.watch_points().await?,
                Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            },
            Ok(Command::Help) => match help::topic(&words) {
                Ok(lines) => {
                    for line in lines {
                        self.out.line(format_args!("{line}")).await?;
                    }
                }
                Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            },
            Ok(command) => match words.end() {
                Ok(()) => return self.act(command).await,
                Err(Wrong) => self.fail(format_args!("{}", words.wrong())).await?,
            },
        }
        Ok(Next::Line)
    }

    /// The commands without words of their own.
    async fn act(&mut self, command: Command) -> Result<Next, IO::Error> {
        match command {
            Command::Watch => self.watch().await?,
            Command::Save => self.save().await?,
            Command::Load => self.load().await?,
            Command::Exit => return Ok(Next::Exit),
            Command::Reboot => {
                self.out.line(format_args!("starting again")).await?;
                self.out.flush().await?;
                self.system.reboot();
            }
            Command::Help
            | Command::Settings
            | Command::Show
            | Command::Clear
            | Command::Point(_)
            | Command::Ping
            | Command::Scan
            | Command::Tune
            | Command::Capture => {}
        }
        Ok(Next::Line)
    }

    async fn change(&mut self, line: &str) -> Result<(), IO::Error> {
        let writer = || self.gateway.ethercat().map(EthercatPlace::line_writer);
        let before = writer();
        let changed = drafting::change(self.gateway, line).await;
        if let Some(writer @ LineWriter::SettingsOver(_)) = writer().filter(|_| writer() != before) {
            self.out.line(format_args!("warning: the line of the ethercat port: {writer}")).await?;
        }
        match changed {
            Ok(Some(warning)) => self.out.line(format_args!("warning: {warning}")).await,
            Ok(None) => Ok(()),
            Err(error) => self.fail(format_args!("{error}")).await,
        }
    }

    async fn save(&mut self) -> Result<(), IO::Error> {
        match drafting::save(self.gateway, self.store).await {
            Ok(()) => self.out.line(format_args!("saved")).await,
            Err(error) => self.fail(format_args!("{error}")).await,
        }
    }

    async fn load(&mut self) -> Result<(), IO::Error> {
        match drafting::load(self.gateway, self.store).await {
            Ok(0) => self.fail(format_args!("nothing is saved")).await,
            Ok(_) => self.out.line(format_args!("loaded")).await,
            Err(error) => self.fail(format_args!("{error}")).await,
        }
    }

    /// Says what is wrong.
    pub(super) async fn fail(&mut self, what: fmt::Arguments<'_>) -> Result<(), IO::Error> {
        match self.line_number {
            Some(number) => self.out.line(format_args!("error: line {number}, {what}")).await,
            None => self.out.line(format_args!("error: {what}")).await,
        }
    }
}

const SHOW_EXPECTED: &str =
    "ports, routes, units, clients, stats, points, devices, config, network, log, frames or version";

fn begins_with_digit(words: &Words) -> bool {
    words.peek().text.starts_with(|first: char| first.is_ascii_digit())
}

/// The last word of a line as a topic of `table`.
fn topic<T: Copy>(words: &Words, table: &[(&'static str, T)], expected: &'static str) -> Result<T, Wrong> {
    let topic = words.take().keyword(table, expected)?;
    words.end()?;
    Ok(topic)
}
