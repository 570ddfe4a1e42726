//! Publishes data points to MQTT brokers, and writes them by messages: a future that a board runs.
//!
//! A value is sent when it changes, at least once (QoS 1), and stays until the broker has acknowledged it: over a reconnect too, when it
//! is sent again as it was. What waits to be sent is no list but a mark at each point: the newest value goes, with the time at which it
//! was read, and values that it has replaced are counted. So a broker that is slow or gone costs no memory.

mod answer;
mod changes;
mod command;
mod discovery;
mod link;
mod mark;
mod metrics;
mod node_command;
mod payload;
mod session;
mod source;
mod sparkplug;

use core::cell::Cell;
use core::convert::Infallible;
use core::future::pending;

use embassy_futures::join::join_array;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer, with_timeout};

use self::session::Session;
use self::source::{Calendar, Source};
use crate::gateway::date::Date;
use crate::gateway::publishers::state::Report;
use crate::gateway::{Gateway, Status};
use crate::hal::{OpenError, OpenErrorKind, TcpConnect, TcpStream as _};
use crate::mqtt::Inbox;
use crate::settings::PUBLISHERS_MAX;

/// Time limit of a connection, with TLS and the broker's consent.
const CONNECT_MAX: Duration = Duration::from_secs(10);
/// First and longest pause before another attempt.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
const PAUSE_MAX: Duration = Duration::from_secs(30);

impl Gateway<'_> {
    /// Publishes to the brokers in the settings, connecting by `connector`; never returns. `calendar` tells the
    /// date of a time, where the time of day is known otherwise than from an NTP server.
    pub async fn publish(&self, connector: &impl TcpConnect, calendar: fn(Instant) -> Option<Date>) {
        let publish = |nth| publish_to(self, nth, connector, calendar);
        let _: [Infallible; PUBLISHERS_MAX] = join_array(core::array::from_fn(publish)).await;
    }
}

/// Publishes to the broker of line number `nth`, whatever that is at any time.
async fn publish_to(
    gateway: &Gateway<'_>,
    nth: usize,
    connector: &impl TcpConnect,
    calendar: Calendar,
) -> Infallible {
    let Some(state) = gateway.publisher(nth) else { return pending().await };
    // The first one is 0.
    let bd_seq = Cell::new(u8::MAX);
    loop {
        // The settings that are read now have it.
        state.changed.reset();
        if let Some(publisher) = gateway.settings(|settings| settings.publishers.get(nth).cloned()) {
            let mut session = Session::new(gateway.last_audit());
            let source = Source { gateway, publisher: &publisher, nth, state, calendar, bd_seq: &bd_seq };
            select(source.run(connector, &mut session), state.changed.wait()).await;
        } else {
            state.changed.wait().await;
        }
        state.report(|report| *report = Report::NONE);
    }
}

impl Source<'_, '_> {
    /// Connects again and again, until the settings change while there is a connection.
    async fn run(&self, connector: &impl TcpConnect, session: &mut Session) {
        let mut pause = PAUSE_FIRST;
        loop {
            let before = self.state.report(|_| {}).sent;
            let Err(error) = self.with_broker(connector, session).await else { return };
            let failed = Status::Failed(error);
            let report = self.state.report(|_| {});
            if report.status != failed {
                log_warn!("publisher {}: {}", self.publisher.name, error);
            }
            self.state.report(|report| (report.status, report.since) = (failed, Instant::now()));
            pause = if report.sent != before { PAUSE_FIRST } else { (pause * 2).min(PAUSE_MAX) };
            select(Timer::after(pause), self.watch(session)).await;
        }
    }

    /// Connects, and publishes until the settings change or the connection ends.
    async fn with_broker(&self, connector: &impl TcpConnect, session: &mut Session) -> Result<(), OpenError> {
        if self.is_sparkplug() {
            self.fits()?;
        }
        let mut inbox = Inbox::new();
        let connecting = with_timeout(CONNECT_MAX, self.connect(connector, &mut inbox));
        let (mut stream, accepted) = match select(connecting, self.watch(session)).await {
            Either::First(connected) => {
                connected.map_err(|_| OpenError::new(OpenErrorKind::TimedOut, ""))??
            }
            Either::Second(never) => match never {},
        };
        self.serve(&mut stream, &mut inbox, &accepted, session).await?;
        stream.close().await;
        Ok(())
    }

    /// Notes changes while there is no connection, so that what is lost is counted.
    async fn watch(&self, session: &mut Session) -> Infallible {
        loop {
            self.mark_changed(session);
            self.state.values.wait().await;
        }
    }
}
