//! The tables of `show`: a header line, then aligned rows.

use embassy_time::Instant;
use embedded_io_async::{Read, Write};
use heapless::String;

use super::command::Session;
use super::rows::{LogRow, Row, StatusText, Troubles, age, describe, state, text, took};
use crate::config::{LINE_BYTES_MAX, PortId, PortKind, Side, write_line};
use crate::hal::{NetworkState, Store, System};
use crate::port::ethercat::{EthercatPlace, LineWriter};
use crate::port::units::Unit;
use crate::stats::{Event, LOG_ENTRIES_MAX, LastError};

/// What can be shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Show {
    Ports,
    Routes,
    Units,
    Clients,
    Stats,
    Points,
    Devices,
    Config,
    Network,
    Log,
    Frames,
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
            Show::Points => self.points().await,
            Show::Devices => self.devices().await,
            Show::Config => self.config().await,
            Show::Network => self.network().await,
            Show::Log => self.log().await,
            Show::Frames => self.frames(&mut 0).await,
            Show::Version => self.version().await,
        }
    }

    async fn ports(&mut self) -> Result<(), IO::Error> {
        // Device names are 6 to 96 characters long.
        let ports = || self.draft.ports.iter().flatten();
        let width = ports().map(|port| describe(&port.kind).1.len()).fold("WHERE".len(), usize::max);
        self.out
            .line(format_args!("{:15} {:12} {:width$} {:12} STATUS", "PORT", "ROLE", "WHERE", "LINE"))
            .await?;
        for (at, (port, place)) in self.draft.ports.iter().zip(self.gateway.ports()).enumerate() {
            let Some(port) = port else { continue };
            let (role, place_name, line) = describe(&port.kind);
            let status = StatusText(place.status());
            // Who had the last word about the line of the EtherCAT port.
            let writer = self.gateway.ethercat().map(EthercatPlace::line_writer);
            let writer = writer.filter(|writer| {
                *writer != LineWriter::Settings && self.draft.ethercat_line() == Some(PortId(at as u8))
            });
            let writer = writer.map_or(String::new(), |writer| text::<48>(format_args!(", {writer}")));
            self.out
                .line(format_args!(
                    "{:15} {role:12} {place_name:width$} {line:12} {status}{writer}",
                    port.name
                ))
                .await?;
        }
        Ok(())
    }

    async fn routes(&mut self) -> Result<(), IO::Error> {
        self.out
            .line(format_args!(
                "{:>3} {:15} {:7} {:18} {:4} {:15} {:7} POLICY",
                "NO", "SOURCE", "UNITS", "IP", "TAG", "DESTINATION", "KIND"
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
                "{:15} {:>4} {:5} {:>10} {:>10} {:>10} {:>10} {:>9} {:>9} {:>9} TROUBLES",
                "PORT",
                "UNIT",
                "STATE",
                "REQUESTS",
                "ANSWERS",
                "EXCEPTIONS",
                "TIMEOUTS",
                "LAST",
                "P50",
                "P99"
            ))
            .await?;
        let now = Instant::now();
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let Some(port) = port else { continue };
            let mut nth = 0;
            while let Some(unit) = place.units(|units| units.iter().nth(nth).copied()) {
                nth += 1;
                let Unit { id, requests, answers, exceptions, timeouts, .. } = unit;
                let last = took((answers > 0).then_some(unit.took_us));
                let (half, most) = (took(unit.times.percentile(50)), took(unit.times.percentile(99)));
                let (state, troubles) = (state(&unit, now), Troubles(&unit));
                self.out
                    .line(format_args!(
                        "{:15} {id:>4} {state:5} {requests:>10} {answers:>10} {exceptions:>10} {timeouts:>10} \
                         {last:>9} {half:>9} {most:>9} {troubles}",
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
        let now = Instant::now();
        self.out
            .line(format_args!("{:15} {:13} {:>10} {:>10}", "PORT", "EVENT", "COUNT", "PER-MINUTE"))
            .await?;
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let Some(port) = port else { continue };
            for event in Event::ALL {
                let count = place.stats.get(event);
                // Most events never happen at most ports.
                if count != 0 || matches!(event, Event::Request | Event::Answer) {
                    let (event, rate) = (event.name(), place.stats.per_minute(event, now));
                    self.out.line(format_args!("{:15} {event:13} {count:>10} {rate:>10}", port.name)).await?;
                }
            }
        }
        for (port, place) in self.draft.ports.iter().zip(self.gateway.ports()) {
            let (Some(port), error) = (port, place.stats.last_error()) else { continue };
            let listens = port.kind.side() == Side::Server && !port.kind.asks_by_itself();
            if (listens || matches!(port.kind, PortKind::Serial(_))) && error != LastError::None {
                let (code, name) = (error as u8, error.name());
                self.out.line(format_args!("{:15} {:13} {code:>10} {name}", port.name, "last-error")).await?;
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

    async fn network(&mut self) -> Result<(), IO::Error> {
        let Some(NetworkState { link, address, hardware }) = self.system.network() else {
            return self.out.line(format_args!("the operating system has the network")).await;
        };
        self.out
            .line(format_args!("{:4} {:18} {:15} {:17} SETTING", "LINK", "ADDRESS", "GATEWAY", "ETHERNET"))
            .await?;
        let link = if link { "up" } else { "down" };
        let shown = address.map_or(text(format_args!("-")), |own| text::<18>(format_args!("{own}")));
        let gateway = address.and_then(|own| own.gateway);
        let gateway =
            gateway.map_or(text(format_args!("-")), |gateway| text::<15>(format_args!("{gateway}")));
        let [a, b, c, d, e, f] = hardware;
        let hardware = text::<17>(format_args!("{a:02x}:{b:02x}:{c:02x}:{d:02x}:{e:02x}:{f:02x}"));
        let setting = &self.draft.network;
        self.out.line(format_args!("{link:4} {shown:18} {gateway:15} {hardware} {setting}")).await
    }

    async fn log(&mut self) -> Result<(), IO::Error> {
        let mut event = String::<LINE_BYTES_MAX>::new();
        // A longer event is cut off.
        for n in 0.. {
            if self.system.write_event(n, &mut event).is_none() {
                break;
            }
            self.out.line(format_args!("{event}")).await?;
            event.clear();
        }
        if let Some(fault) = self.gateway.ethercat().and_then(|place| place.controller().fault()) {
            self.out.line(format_args!("EtherCAT: {fault}")).await?;
        }
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
        let running = format_args!("mobgate {version} on {board}, up {up}");
        match self.gateway.ethercat() {
            Some(place) => self.out.line(format_args!("{running}, {}", place.controller())).await,
            None => self.out.line(running).await,
        }
    }
}
