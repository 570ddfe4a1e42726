//! The tables of `show`: a header line, then aligned rows.

use core::fmt;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use heapless::String;

use super::command::Session;
use crate::config::{LINE_BYTES_MAX, PortId, PortKind, Settings, Time, is_implied, write_line};
use crate::gateway::Status;
use crate::hal::{Store, System};
use crate::port::units::Unit;
use crate::route::{Functions, Route};
use crate::stats::{Event, LOG_ENTRIES_MAX, LogEntry, Outcome};

/// What can be shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Show {
    Ports,
    Routes,
    Units,
    Clients,
    Stats,
    Config,
    Log,
    Version,
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Prints one table. The settings are copied first: they may change while the stream takes its time.
    pub(super) async fn show(&mut self, what: Show) -> Result<(), IO::Error> {
        self.gateway.settings(|settings| self.draft.clone_from(settings));
        match what {
            Show::Ports => self.ports().await,
            Show::Routes => self.routes().await,
            Show::Units => self.units().await,
            Show::Clients => self.clients().await,
            Show::Stats => self.stats().await,
            Show::Config => self.config().await,
            Show::Log => self.log().await,
            Show::Version => self.version().await,
        }
    }

    async fn ports(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!("{:15} {:12} {:24} {:12} STATUS", "PORT", "ROLE", "WHERE", "LINE"))
            .await?;
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let Some(port) = port else { continue };
            let status = StatusText(place.status());
            match &port.kind {
                PortKind::Serial(serial) => {
                    let role = text::<12>(format_args!("{} {}", serial.framing, serial.side));
                    let line = serial.line.speed();
                    let device = &serial.device;
                    self.out
                        .line(format_args!("{:15} {role:12} {device:24} {line:12} {status}", port.name))
                        .await?;
                }
                PortKind::TcpServer(server) => {
                    let listen = text::<56>(format_args!("{}", server.listen));
                    let (name, role) = (&port.name, "tcp server");
                    self.out.line(format_args!("{name:15} {role:12} {listen:24} {:12} {status}", "")).await?;
                }
            }
        }
        Ok(())
    }

    async fn routes(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!(
                "{:>3} {:15} {:7} {:18} {:4} {:15} {:8} {:7} FUNCTIONS",
                "NO", "SOURCE", "UNITS", "IP", "TAG", "DESTINATION", "PRIORITY", "KIND"
            ))
            .await?;
        for (at, route) in self.draft.routes.iter().enumerate() {
            self.out.line(format_args!("{:>3} {}", at + 1, Row { settings: &self.draft, route })).await?;
        }
        Ok(())
    }

    async fn units(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!(
                "{:15} {:>4} {:5} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
                "PORT", "UNIT", "STATE", "REQUESTS", "ANSWERS", "EXCEPTIONS", "TIMEOUTS", "DAMAGED", "LAST"
            ))
            .await?;
        let now = Instant::now();
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let Some(port) = port else { continue };
            let mut nth = 0;
            while let Some(unit) = place.units(|units| units.iter().nth(nth).copied()) {
                nth += 1;
                let Unit { id, requests, answers, exceptions, timeouts, damaged, .. } = unit;
                let took = text::<16>(format_args!("{}", Time(Duration::from_micros(unit.took_us.into()))));
                let took = if answers == 0 { "-" } else { &took };
                let state = state(&unit, now);
                self.out
                    .line(format_args!(
                        "{:15} {id:>4} {state:5} {requests:>10} {answers:>10} {exceptions:>10} {timeouts:>10} \
                         {damaged:>10} {took:>10}",
                        port.name
                    ))
                    .await?;
            }
        }
        Ok(())
    }

    async fn clients(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!(
                "{:15} {:21} {:>9} {:>9} {:>4} {:>10} PLACE",
                "PORT", "PEER", "SINCE", "QUIET", "OPEN", "REQUESTS"
            ))
            .await?;
        let now = Instant::now();
        for seat in self.gateway.seats() {
            let state = seat.state();
            let (Some(port), Some(peer)) = (state.port, state.peer) else { continue };
            let port = self.draft.name(port);
            let peer = text::<60>(format_args!("{peer}"));
            let (since, quiet) = (age(state.since, now), age(state.last_request, now));
            let (open, requests) = (state.open_requests, state.requests);
            let place = if state.marked { "reserved" } else { "ordinary" };
            self.out
                .line(format_args!(
                    "{port:15} {peer:21} {since:>9} {quiet:>9} {open:>4} {requests:>10} {place}"
                ))
                .await?;
        }
        Ok(())
    }

    async fn stats(&mut self) -> Result<(), IO::Error> {
        self.out.line(format_args!("{:15} {:13} {:>10}", "PORT", "EVENT", "COUNT")).await?;
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let Some(port) = port else { continue };
            for event in Event::ALL {
                let count = place.stats.get(event);
                // Most events never happen at most ports.
                if count != 0 || matches!(event, Event::Request | Event::Answer) {
                    self.out.line(format_args!("{:15} {:13} {count:>10}", port.name, event.name())).await?;
                }
            }
        }
        let pool = self.gateway.pool();
        self.out.line(format_args!("{:15} {:13} {:>10}", "-", "frames-free", pool.free())).await?;
        self.out.line(format_args!("{:15} {:13} {:>10}", "-", "frames", pool.capacity())).await
    }

    async fn config(&mut self) -> Result<(), IO::Error> {
        let mut n = 0;
        let mut line = String::<LINE_BYTES_MAX>::new();
        // Lines of settings fit, see LINE_BYTES_MAX.
        while let Some(Ok(())) = write_line(&self.draft, n, &mut line) {
            self.out.line(format_args!("{line}")).await?;
            line.clear();
            n += 1;
        }
        Ok(())
    }

    async fn log(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!(
                "{:>9} {:15} {:>4} {:15} {:>6} {:>8} {:>10} OUTCOME",
                "AGE", "SOURCE", "UNIT", "DESTINATION", "TARGET", "FUNCTION", "TOOK"
            ))
            .await?;
        let now = Instant::now();
        for back in (0..LOG_ENTRIES_MAX).rev() {
            let Some(entry) = self.gateway.log().newest(back) else { continue };
            let age = age(entry.at, now);
            self.out.line(format_args!("{age:>9} {}", LogRow { settings: &self.draft, entry })).await?;
        }
        Ok(())
    }

    async fn version(&mut self) -> Result<(), IO::Error> {
        let (version, board) = (env!("CARGO_PKG_VERSION"), self.system.name());
        let up = age(Instant::from_ticks(0), Instant::now());
        self.out.line(format_args!("mobgate {version} on {board}, up {up}")).await
    }
}

/// Text that is padded as a whole when it is printed.
fn text<const N: usize>(content: fmt::Arguments<'_>) -> String<N> {
    let mut text = String::new();
    // A column that is too narrow for its content would show nothing at all; the sizes are those of the contents.
    let _ = fmt::Write::write_fmt(&mut text, content);
    text
}

/// The time since `then` in whole seconds.
fn age(then: Instant, now: Instant) -> String<24> {
    text(format_args!("{}s", now.saturating_duration_since(then).as_secs()))
}

fn state(unit: &Unit, now: Instant) -> &'static str {
    match unit {
        Unit { down: true, .. } => "down",
        Unit { held_until, .. } if *held_until > now => "held",
        _ => "up",
    }
}

struct StatusText(Status);

impl fmt::Display for StatusText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Status::Off => f.write_str("off"),
            Status::Open => f.write_str("open"),
            Status::Lost => f.write_str("lost, is opened again"),
            Status::Failed(error) => write!(f, "{error}"),
        }
    }
}

struct Row<'s> {
    settings: &'s Settings,
    route: &'s Route,
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, route } = self;
        let peer = match route.peer {
            Some(peer) => text::<44>(format_args!("{peer}")),
            None => text(format_args!("*")),
        };
        let kind = if is_implied(settings, route) { "implied" } else { "rule" };
        let (source, destination) = (settings.name(route.source), settings.destination(route.destination));
        write!(f, "{source:15} {:7} {peer:18} {:4} {destination:15} ", route.units, route.tag)?;
        write!(f, "{:8} {kind:7} ", route.priority)?;
        match route.functions {
            Functions::ALL => f.write_str("all"),
            Functions::READ_ONLY => f.write_str("readonly"),
            functions => write!(f, "{functions}"),
        }
    }
}

struct LogRow<'s> {
    settings: &'s Settings,
    entry: LogEntry,
}

impl fmt::Display for LogRow<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, entry } = self;
        let LogEntry { unit, target, function, .. } = entry;
        let name = |id: PortId| settings.name(id);
        let took = text::<16>(format_args!("{}", Time(Duration::from_micros(entry.took_us.into()))));
        let (source, destination) = (name(entry.source), entry.destination.map_or("-", name));
        write!(f, "{source:15} {unit:>4} {destination:15} {target:>6} {function:>8} {took:>10} ")?;
        match entry.outcome {
            Outcome::Answer => f.write_str("answer"),
            Outcome::Exception(exception) => write!(f, "{exception}"),
            Outcome::Silence => f.write_str("no answer due"),
            Outcome::AskerGone => f.write_str("asker gone"),
        }
    }
}

const _: () = assert!(crate::config::NAME_BYTES_MAX == 15, "the width of port columns");
