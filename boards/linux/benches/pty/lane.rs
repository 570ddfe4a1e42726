//! Lanes that run side by side: each has its own device and its own way to it, and the same load comes to all in turn.

use std::process::Stdio;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use serial2::SerialPort;
use strum::IntoEnumIterator;

use crate::common::{Program, free_port};
use crate::contestants::{Behind, Contestant, Wired};
use crate::line::{Device, Line, Pace};
use crate::load::{Client, Habit, Load, ask_directly, ask_together};
use crate::tcp_device;
use crate::usage::Usage;

/// Not measured, at the beginning of each round.
const WARM_UP: Duration = Duration::from_millis(50);

/// A way to a device, and what has come of its rounds.
pub(crate) struct Lane {
    pub(crate) name: &'static str,
    way: ReplyTo,
    /// Where the device is at a line.
    line: Option<Line>,
    pub(crate) rounds: Vec<Round>,
}

enum ReplyTo {
    Direct(Pace),
    Through(Box<Program>, Vec<Client>),
}

/// What one round brought.
#[derive(Clone)]
pub(crate) struct Round {
    pub(crate) took: Duration,
    /// Of each client.
    pub(crate) loads: Vec<Load>,
    pub(crate) usage: Usage,
    /// Requests at the device, and those of them that came too early.
    pub(crate) requests: u64,
    pub(crate) early: u64,
}

impl Lane {
    /// A client at the line itself.
    pub(crate) fn direct(device: Device) -> Self {
        Self {
            name: "direct",
            way: ReplyTo::Direct(device.pace),
            line: Some(Line::with(device)),
            rounds: Vec::new(),
        }
    }

    /// Through `contestant` to `device` at a line.
    pub(crate) fn to_line(contestant: Contestant, device: Device, timeout_ms: u32) -> Result<Self, String> {
        let line = Line::with(device);
        let behind = Behind::Line(Wired { device: &line.device(), pace: device.pace, timeout_ms });
        let program = start(contestant, behind)?;
        Self::through(contestant, program, Some(line))
    }

    /// Through `contestant` to a server on this machine.
    pub(crate) fn to_tcp(contestant: Contestant) -> Result<Self, String> {
        let program = start(contestant, Behind::Tcp(tcp_device::start()))?;
        Self::through(contestant, program, None)
    }

    fn through(contestant: Contestant, program: Program, line: Option<Line>) -> Result<Self, String> {
        let name = contestant.name();
        let mut lane =
            Self { name, way: ReplyTo::Through(Box::new(program), Vec::new()), line, rounds: Vec::new() };
        // The line may be opened a moment after the listener.
        let start = Instant::now();
        while lane.run(&[Habit::of(0)], WARM_UP).loads.iter().all(|load| load.times.is_empty()) {
            if start.elapsed() > Duration::from_secs(8) {
                return Err("it answers nothing".to_owned());
            }
        }
        Ok(lane)
    }

    /// Another round: `habits` for `length`.
    pub(crate) fn round(&mut self, habits: &[Habit], length: Duration) {
        self.run(habits, WARM_UP);
        let round = self.run(habits, length);
        self.rounds.push(round);
    }

    fn run(&mut self, habits: &[Habit], length: Duration) -> Round {
        let heard = |line: &Option<Line>| {
            let heard = line.as_ref().map(|line| &line.heard);
            heard.map_or((0, 0), |heard| (heard.requests.load(Relaxed), heard.early.load(Relaxed)))
        };
        let (requests, early) = heard(&self.line);
        let usage = self.usage();
        let start = Instant::now();
        let until = start + length;
        let loads = match (&mut self.way, &mut self.line) {
            (ReplyTo::Direct(pace), Some(line)) => vec![directly(&mut line.near, *pace, habits, until)],
            (ReplyTo::Direct(_), None) => Vec::new(),
            (ReplyTo::Through(program, clients), _) => {
                let missing = habits.len().saturating_sub(clients.len());
                clients.extend((0..missing).filter_map(|_| Client::connect(program.port).ok()));
                ask_together(clients, habits, until)
            }
        };
        let last = loads.iter().filter_map(|load| load.last).max().unwrap_or(until);
        let (requests_after, early_after) = heard(&self.line);
        Round {
            took: last - start,
            loads,
            usage: self.usage() - usage,
            requests: requests_after - requests,
            early: early_after - early,
        }
    }

    fn usage(&self) -> Usage {
        match &self.way {
            ReplyTo::Direct(_) => Usage::default(),
            ReplyTo::Through(program, _) => Usage::of(program.id()),
        }
    }
}

/// One client is all that fits at the line itself.
fn directly(line: &mut SerialPort, pace: Pace, habits: &[Habit], until: Instant) -> Load {
    ask_directly(line, pace, habits.first().copied().unwrap_or(Habit::of(0)), until)
}

fn start(contestant: Contestant, behind: Behind<'_>) -> Result<Program, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let port = free_port();
    let mut command = contestant.command(behind, folder.path(), port)?;
    Program::try_start(command.stderr(Stdio::piped()), folder, port)
}

/// The lanes of all contestants that take part; `open` opens one. Who is there but fails is printed with the reason.
pub(crate) fn contestants(
    behind: Behind<'_>,
    open: impl Fn(Contestant) -> Result<Lane, String>,
) -> Vec<Lane> {
    let able = Contestant::iter().filter(|contestant| contestant.takes(behind));
    able.filter_map(|contestant| match open(contestant) {
        Ok(lane) => Some(lane),
        Err(why) => {
            println!("{}: does not take part: {}", contestant.name(), why.trim_end());
            None
        }
    })
    .collect()
}

/// Clears what the lanes have, and lets each have a round in turn, `rounds` times.
pub(crate) fn contest(lanes: &mut [Lane], habits: &[Habit], rounds: usize, length: Duration) {
    lanes.iter_mut().for_each(|lane| lane.rounds.clear());
    for _ in 0..rounds {
        lanes.iter_mut().for_each(|lane| lane.round(habits, length));
    }
}

impl Round {
    /// What all clients have together.
    pub(crate) fn load(&self) -> Load {
        let mut all = Load::default();
        self.loads.iter().cloned().for_each(|load| all += load);
        all
    }

    /// Good responses.
    pub(crate) fn good(&self) -> usize {
        self.loads.iter().map(|load| load.times.len()).sum()
    }

    /// Good responses per second.
    pub(crate) fn rate(&self) -> f64 {
        self.good() as f64 / self.took.as_secs_f64()
    }
}
