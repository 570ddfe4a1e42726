//! A connection from its beginning to its end: log-in, then the console.

use core::convert::Infallible;
use core::future::pending;
use core::net::IpAddr;

use embassy_futures::select::{Either, Either5, select, select5};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::console::{self, Ended, Mode};
use mobgate::gateway::Gateway;
use mobgate::hal::{Store, System, Update};
use mobgate::settings::PortId;
use salty::Keypair;

use crate::channel::{Channel, DATA_BYTES_MAX, Kind};
use crate::link::{Link, Secrets};
use crate::log_in::Judge;
use crate::terminal::Terminal;
use crate::{Error, SEED_BYTES};

/// A client that has not logged in, or has not begun its session, after this time is disconnected.
const LOG_IN_MAX: Duration = Duration::from_secs(60);
/// A session without a packet, and without anything to show, for this long is ended.
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);
/// Time for a client to close the channel after the exit status, and for the disconnect message.
const CLOSE_MAX: Duration = Duration::from_secs(2);

/// The peer, and the configured port it connected to.
#[derive(Debug, Clone, Copy)]
pub struct Visit {
    /// The client's address.
    pub peer: IpAddr,
    /// The port.
    pub port: PortId,
}

/// What a board provides for a session.
pub struct Board<'b, St, U, Y> {
    /// What the host key is made of.
    pub seed: &'b [u8; SEED_BYTES],
    /// The board's information, random numbers and passwords.
    pub system: &'b Y,
    /// Whether passwords are offered to clients. A board whose [`System`] checks none, for want of memory for Argon2, offers keys only.
    pub passwords: bool,
    /// Storage of the settings, for this session alone.
    pub store: St,
    /// New firmware, likewise.
    pub update: U,
}

/// Serves a connection until its end; calls `logged_in` once somebody has logged in. Dropping the future is the connection's end.
///
/// # Errors
/// The connection has ended without a session, or before the session had.
pub async fn serve<S: Read + Write, St: Store, U: Update, Y: System>(
    gateway: &Gateway<'_>,
    stream: S,
    visit: Visit,
    board: Board<'_, St, U, Y>,
    logged_in: &dyn Fn(),
) -> Result<(), Error> {
    let Board { seed, system, passwords, mut store, mut update } = board;
    let host_key = Keypair::from(seed);
    let random = |bytes: &mut [u8]| system.random(bytes);
    let mut link = Link::new(stream, Secrets { host_key: &host_key, random: &random });
    let (terminal, mut channel) = (Terminal::new(), Channel::new(U::EXISTS));
    let judge = Judge { gateway, system, peer: visit.peer, passwords };
    let begun = with_timeout(LOG_IN_MAX, async {
        link.begin().await?;
        let user = link.log_in(&judge).await?;
        logged_in();
        loop {
            link.handle(&mut channel, &terminal).await?;
            match channel.kind() {
                Some(kind) => return Ok((user, kind)),
                None if channel.is_closed() => return Err(Error::Closed),
                None => link.fill().await?,
            }
        }
    });
    let ended = match begun.await.unwrap_or(Err(Error::TOO_LATE)) {
        Ok((user, kind)) => {
            let mode =
                Mode::User { name: &user, peer: visit.peer, port: visit.port, edits: kind == Kind::Keys };
            let done = Signal::<NoopRawMutex, u32>::new();
            let console = async {
                let ended =
                    console::run(gateway, &mut &terminal, &mut store, &mut update, system, mode).await;
                done.signal(status(ended, kind));
                // The rest of the output is still to be sent.
                pending::<Infallible>().await
            };
            match select(console, link.pass(&mut channel, &terminal, &done)).await {
                Either::First(never) => match never {},
                Either::Second(ended) => ended,
            }
        }
        Err(error) => Err(error),
    };
    if let Err(Error::Refused(reason)) = ended {
        // It may be gone.
        let _ = with_timeout(CLOSE_MAX, link.disconnect(reason)).await;
    }
    ended
}

/// The exit status: 0, or 1 if a line was refused. At a terminal the user has seen the result of each.
fn status(ended: Result<Ended, Infallible>, kind: Kind) -> u32 {
    let Ok(ended) = ended;
    let is_good = match ended {
        Ended::Left { refused } => !refused || kind == Kind::Keys,
        Ended::Stopped | Ended::Foreign(_) => false,
    };
    u32::from(!is_good)
}

impl<S: Read + Write> Link<'_, S> {
    /// Passes bytes between the client and the console until either ends.
    async fn pass(
        &mut self,
        channel: &mut Channel,
        terminal: &Terminal,
        done: &Signal<NoopRawMutex, u32>,
    ) -> Result<(), Error> {
        let (mut piece, mut status) = ([0; DATA_BYTES_MAX], None);
        let mut idle = Instant::now() + IDLE_MAX;
        loop {
            self.handle(channel, terminal).await?;
            if channel.is_closed() {
                return Ok(());
            }
            self.open_window(channel, terminal).await?;
            if let Some(status) = status.filter(|_| terminal.has_shown_all()) {
                self.finish(channel, status).await?;
                break;
            }
            let room = piece.get_mut(..channel.room()).unwrap_or_default();
            let shown = async { if room.is_empty() { pending().await } else { terminal.shown(room).await } };
            let read = terminal.was_read();
            match select5(self.fill(), shown, done.wait(), read, Timer::at(idle)).await {
                Either5::First(filled) => filled?,
                Either5::Second(count) => self.show(channel, piece.get(..count).unwrap_or_default()).await?,
                Either5::Third(ended) => status = Some(ended),
                Either5::Fourth(()) => continue,
                Either5::Fifth(()) => return Err(Error::TOO_LATE),
            }
            idle = Instant::now() + IDLE_MAX;
        }
        // The client closes the channel, too, and then the connection.
        let closed = async {
            while !channel.is_closed() {
                self.fill().await?;
                self.handle(channel, terminal).await?;
            }
            Ok(())
        };
        with_timeout(CLOSE_MAX, closed).await.unwrap_or(Ok(()))
    }
}
