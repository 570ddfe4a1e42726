//! Counters and states for Prometheus: as text (version 0.0.4), or as OpenMetrics 1.0 for clients that accept it.
//!
//! One family follows another, each with its heading and a sample for each port or unit. Counters begin again when they are cleared.

use core::fmt::{self, Write};

use embassy_time::Instant;
use picoserve::request::Headers;

use super::json::Quoted;
use super::piece::{Piece, Source};
use crate::gateway::unit_health::{UNITS_MAX, Unit};
use crate::gateway::{PortAt, Status};
use crate::settings::{PortId, Settings};
use crate::stats::Event;

/// The media type of OpenMetrics.
const OPEN: &str = "application/openmetrics-text";

/// The metric being written.
#[derive(Clone, Copy)]
pub(super) struct Metrics {
    is_open: bool,
    /// The family, and the next of its samples; 0 before its heading.
    family: usize,
    place: usize,
}

/// Writes the lines of a sample at a place; `None` behind the last one.
type Samples = fn(&Sampled<'_, '_>, usize, &mut dyn Write) -> Option<fmt::Result>;

/// A family of samples.
struct Family {
    name: &'static str,
    help: &'static str,
    is_counter: bool,
    samples: Samples,
}

/// What samples are taken of.
struct Sampled<'s, 'g> {
    name: &'static str,
    source: Source<'s, 'g>,
    settings: &'s Settings,
}

const fn gauge(name: &'static str, help: &'static str, samples: Samples) -> Family {
    Family { name, help, is_counter: false, samples }
}

const fn counter(name: &'static str, help: &'static str, samples: Samples) -> Family {
    Family { name, help, is_counter: true, samples }
}

const FAMILIES: &[Family] = &[
    gauge("mobgate_build_info", "Version and board.", |of, place, out| {
        let (version, board) = (env!("CARGO_PKG_VERSION"), Quoted(of.source.system.name()));
        (place == 0).then(|| writeln!(out, "{}{{version=\"{version}\",board={board}}} 1", of.name))
    }),
    gauge("mobgate_uptime_seconds", "Time since the start.", |of, place, out| {
        (place == 0).then(|| writeln!(out, "{} {}", of.name, Instant::now().as_secs()))
    }),
    gauge(
        "mobgate_port_up",
        "1 while the port is open, or opens with the next request.",
        |of, place, out| {
            let is_up = |port: &PortAt<'_>| u32::from(matches!(port.status(), Status::Open | Status::Idle));
            of.port(place, |name, port| writeln!(out, "{}{{port={name}}} {}", of.name, is_up(port)))
        },
    ),
    gauge("mobgate_port_waiting_requests", "Requests that wait for their turn.", |of, place, out| {
        of.port(place, |name, port| writeln!(out, "{}{{port={name}}} {}", of.name, port.waiting()))
    }),
    counter(
        "mobgate_port_events_total",
        "Events of a port, by their names in the console's show stats.",
        |of, place, out| {
            of.port(place / Event::ALL.len(), |name, port| {
                let event = Event::ALL.get(place % Event::ALL.len()).copied().unwrap_or(Event::Request);
                let (kind, count) = (event.name(), port.stats.get(event));
                writeln!(out, "{}{{port={name},event=\"{kind}\"}} {count}", of.name)
            })
        },
    ),
    gauge(
        "mobgate_unit_up",
        "0 while the unit is down, so that its requests fail at once.",
        |of, place, out| {
            of.unit(place, |label, unit| {
                writeln!(out, "{}{{{label}}} {}", of.name, u32::from(!unit.is_down()))
            })
        },
    ),
    counter(
        "mobgate_unit_events_total",
        "Requests to a unit, its responses, and what went wrong, by their names in the console's show units.",
        |of, place, out| of.unit(place, |label, unit| unit_events(of.name, label, unit, out)),
    ),
    gauge(
        "mobgate_unit_response_median_seconds",
        "Within this time half of the last responses came.",
        |of, place, out| of.unit(place, |label, unit| response_time(of.name, label, unit, 50, out)),
    ),
    gauge(
        "mobgate_unit_response_p99_seconds",
        "Within this time 99 % of the last responses came.",
        |of, place, out| of.unit(place, |label, unit| response_time(of.name, label, unit, 99, out)),
    ),
];

fn unit_events(name: &str, label: fmt::Arguments<'_>, unit: &Unit, out: &mut dyn Write) -> fmt::Result {
    let counts = [
        (Event::Request, unit.requests),
        (Event::Response, unit.responses),
        (Event::Exception, unit.exceptions),
        (Event::Timeout, unit.timeouts),
    ];
    let errors = unit.errors().map(|(error, count)| (error, count.into()));
    counts.into_iter().chain(errors).try_for_each(|(event, count): (Event, u32)| {
        writeln!(out, "{name}{{{label},event=\"{}\"}} {count}", event.name())
    })
}

/// No sample before the first response.
fn response_time(
    name: &str,
    label: fmt::Arguments<'_>,
    unit: &Unit,
    percent: u32,
    out: &mut dyn Write,
) -> fmt::Result {
    let Some(took_us) = unit.times.percentile(percent) else { return Ok(()) };
    let (seconds, micros) = (took_us / 1_000_000, took_us % 1_000_000);
    writeln!(out, "{name}{{{label}}} {seconds}.{micros:06}")
}

impl Sampled<'_, '_> {
    /// Writes the samples of port number `place`, if it is used.
    fn port(
        &self,
        place: usize,
        write: impl FnOnce(Quoted<&str>, &PortAt<'_>) -> fmt::Result,
    ) -> Option<fmt::Result> {
        let state = self.source.gateway.port_state(PortId(u8::try_from(place).ok()?))?;
        let port = self.settings.ports.get(place)?.as_ref();
        Some(port.map_or(Ok(()), |port| write(Quoted(&port.name), &state)))
    }

    /// Writes the samples of a unit, of which each port has [`UNITS_MAX`] places.
    fn unit(
        &self,
        place: usize,
        write: impl FnOnce(fmt::Arguments<'_>, &Unit) -> fmt::Result,
    ) -> Option<fmt::Result> {
        self.port(place / UNITS_MAX, |port, state| {
            let unit = state.units(|units| units.iter().nth(place % UNITS_MAX).copied());
            unit.map_or(Ok(()), |unit| write(format_args!("port={port},unit=\"{}\"", unit.id), &unit))
        })
    }
}

impl Metrics {
    /// In the format that a client with these headers accepts.
    pub(super) fn of(headers: Headers<'_>) -> Self {
        let accepts = headers.get("accept");
        let is_open = accepts.is_some_and(|types| {
            types.as_str().is_ok_and(|types| types.split(',').any(|kind| kind.trim_start().starts_with(OPEN)))
        });
        Self { is_open, family: 0, place: 0 }
    }

    pub(super) fn content_type(&self) -> &'static str {
        match self.is_open {
            true => "application/openmetrics-text; version=1.0.0; charset=utf-8",
            false => "text/plain; version=0.0.4; charset=utf-8",
        }
    }

    /// Writes the next piece; `false`: there was none.
    pub(super) fn next(&mut self, source: &Source<'_, '_>, out: &mut Piece) -> Result<bool, fmt::Error> {
        // Unused places are passed by.
        let begin = out.len();
        while out.len() == begin {
            let Some(family) = FAMILIES.get(self.family) else {
                let ends = self.is_open && self.family == FAMILIES.len();
                self.family = FAMILIES.len() + 1;
                return out.write_str(if ends { "# EOF\n" } else { "" }).map(|()| ends);
            };
            if self.place == 0 {
                self.heading(family, out)?;
            } else {
                let written = source.gateway.settings(|settings| {
                    let sampled = Sampled { name: family.name, source: *source, settings };
                    (family.samples)(&sampled, self.place - 1, &mut &mut *out)
                });
                if written.transpose()?.is_none() {
                    (self.family, self.place) = (self.family + 1, 0);
                    continue;
                }
            }
            self.place += 1;
        }
        Ok(true)
    }

    /// In OpenMetrics the name of a counter's family is that of its samples without `_total`.
    fn heading(&self, family: &Family, out: &mut Piece) -> fmt::Result {
        let name = family.name.strip_suffix("_total").filter(|_| self.is_open).unwrap_or(family.name);
        let kind = if family.is_counter { "counter" } else { "gauge" };
        write!(out, "# HELP {name} {}\n# TYPE {name} {kind}\n", family.help)
    }
}
