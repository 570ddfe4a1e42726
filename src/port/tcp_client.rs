//! A client-side TCP port: the gateway asks an outside server, by Modbus TCP or RTU over TCP.
//!
//! The connection is opened when the first order comes, and closed when none has come for the idle time; with `idle 0` it
//! is opened at once and kept. While it is open, [`Link`] carries the orders out.
//!
//! When the server cannot be reached, what waits and what comes is answered 0Ah at once: there is no path, so nothing has been
//! sent and nothing has happened at the device. 0Bh says the other thing: it was sent, or may have been, and no valid
//! answer came. Meanwhile the connection is tried again in the background, at growing intervals, so that no request has to
//! wait for the network's time-out but the first, and those of an asker with a back-off of his own, who makes such a try.

use core::pin::pin;

use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer, with_deadline, with_timeout};

use crate::config::{Endpoint, TcpClientSettings};
use crate::gateway::Status;
use crate::hal::{OpenError, OpenErrorKind, TcpConnect, TcpStream};
use crate::port::desk::Desk;
use crate::port::link::Link;
use crate::port::moment::apart;
use crate::port::sockets;
use crate::stats::Event;

/// First and longest pause before a server is tried again.
const RETRY_FIRST: Duration = Duration::from_millis(500);
const RETRY_LONGEST: Duration = Duration::from_secs(10);
/// Pause before another look for a socket: others than ports that make connections use some, too.
const SOCKET_PAUSE: Duration = Duration::from_millis(50);
/// Transaction ids of a connection begin so far behind those of the one before: a server that mixes them up is found out.
const ID_STRIDE: u16 = 4_099;

const CLOSED_AT_ONCE: OpenError =
    OpenError::new(OpenErrorKind::Refused, "the server closes the connection without an answer");

/// Carries out the desk's orders, for ever.
pub(crate) async fn run<C: TcpConnect>(desk: &Desk<'_>, settings: &TcpClientSettings, connector: &mut C) {
    let place = desk.place();
    let places = desk.gateway().ports();
    let mut first_id = 0;
    let mut pause = RETRY_FIRST;
    let mut well = true;
    loop {
        if well {
            desk.open();
            if settings.idle > Duration::from_ticks(0) && !desk.is_wanted() {
                place.set_status(Status::Idle);
                desk.wanted().await;
            }
        }
        let give_up = Instant::now() + settings.connect_timeout;
        well = false;
        let error = loop {
            place.socket.freed.reset();
            let error = match with_deadline(give_up, connector.connect(settings.server)).await {
                Ok(Ok(stream)) => {
                    if place.set_status(Status::Open) {
                        log_info!("connected to {}", Endpoint(settings.server));
                    }
                    place.stats.count(Event::Connected);
                    place.socket.opened();
                    desk.open();
                    // Lent and not moved: what a future is given it keeps twice.
                    let mut link = Link::new(desk, settings, stream, first_id);
                    let Err(end) = apart(pin!(link.serve())).await;
                    well = link.ended(end);
                    link.into_stream().close().await;
                    place.socket.closed(places);
                    first_id = first_id.wrapping_add(ID_STRIDE);
                    CLOSED_AT_ONCE
                }
                Ok(Err(error)) => error,
                Err(_) => OpenError::new(OpenErrorKind::TimedOut, ""),
            };
            if error.kind != OpenErrorKind::Exhausted {
                break error;
            }
            sockets::ask_for_one(places, desk.id());
            if Instant::now() >= give_up {
                break error;
            }
            let _ = with_timeout(SOCKET_PAUSE, place.socket.freed.wait()).await;
        };
        if well {
            pause = RETRY_FIRST;
            continue;
        }
        desk.close();
        if place.set_status(Status::Failed(error)) {
            log_warn!("no connection to {}: {}", Endpoint(settings.server), error);
        }
        desk.set_pausing(true);
        select(Timer::after(pause), desk.wanted()).await;
        desk.set_pausing(false);
        pause = (pause * 2).min(RETRY_LONGEST);
    }
}
