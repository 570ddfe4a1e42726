//! A client-side serial port: the gateway is the master of an RS-485 or RS-232 line.
//!
//! The line is opened, and reopened with back-off when it is lost. Once it has been silent for the gap, the dispatcher selects
//! the next request; its response is written into the request's frame, which returns to the router.

use core::pin::pin;

use embassy_futures::select::select;
use embassy_time::{Duration, Instant};

use crate::frame::{Cause, Fill, Frame, ReplyTo};
use crate::gateway::direct_request::Failure;
use crate::hal::{SerialHost, SerialLine};
use crate::modbus::Pdu;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::port::client::dispatcher::Dispatcher;
use crate::port::client::queue::{BROADCAST, Next};
use crate::port::client::transaction::SerialTransaction;
use crate::port::cut_through::egress::Forwarded;
use crate::port::cut_through::response::IncomingResponse;
use crate::port::line::{Collision, LineLost, Opening};
use crate::port::timer::{outlined, until};
use crate::settings::{Framing, Lane, SerialClientSettings, SerialSettings};
use crate::stats::Event;

/// A line counts as the port's only connection.
const CONNECTION: u8 = 0;

/// Keeps the line open and serves the dispatcher's requests, forever.
pub(crate) async fn run<H: SerialHost>(
    dispatcher: &Dispatcher<'_>,
    settings: &SerialSettings,
    host: &mut H,
) -> ! {
    let mut opening = Opening::new(dispatcher.port_state().state(), settings, dispatcher.is_alone());
    loop {
        let jitter = host.read_jitter();
        let opened = opening.opened(host.open(&settings.device, &settings.line).await, jitter);
        // Borrowed, not moved: a future stores a moved argument twice.
        let mut transaction = opened.map(|line| SerialTransaction::new(line, dispatcher, settings));
        if let Some(transaction) = &mut transaction {
            dispatcher.open();
            if transaction.discard(settings.client.late_window()).await.is_ok() {
                outlined(pin!(serve(dispatcher, transaction, &settings.client))).await;
            }
            opening.lost();
        }
        // Must be closed before it is reopened.
        drop(transaction);
        dispatcher.close();
        opening.pause().await;
    }
}

/// Serves requests until the line is lost.
async fn serve<L: SerialLine>(
    dispatcher: &Dispatcher<'_>,
    transaction: &mut SerialTransaction<'_, L>,
    client: &SerialClientSettings,
) {
    loop {
        if transaction.silence().await.is_err() {
            return;
        }
        let wake = match dispatcher.next(CONNECTION) {
            Next::Serve(frame, entry) => {
                if outlined(pin!(transact(dispatcher, transaction, client, frame, entry.unit))).await.is_err()
                {
                    return;
                }
                continue;
            }
            Next::Wait(at) => at,
            Next::Empty => Instant::MAX,
        };
        if transaction.idle(select(dispatcher.changed(CONNECTION), until(wake))).await.is_err() {
            return;
        }
    }
}

/// Sends the request in `frame` to `unit`, and handles its outcome.
async fn transact<'g, L: SerialLine>(
    dispatcher: &Dispatcher<'g>,
    transaction: &mut SerialTransaction<'_, L>,
    client: &SerialClientSettings,
    frame: Frame<'g>,
    unit: u8,
) -> Result<(), LineLost> {
    let port_state = dispatcher.port_state();
    let fill = frame.filled().1;
    if fill == Fill::Broken {
        // Nothing has been sent.
        dispatcher.forget(&frame);
        return Ok(());
    }
    let arriving = fill == Fill::Filling;
    if arriving {
        let origin = frame.origin().port;
        let input = dispatcher.gateway().settings(|settings| Lane::at(settings, origin));
        // If it breaks off, it is queued again once it is complete.
        let may_wait = input.is_some_and(|lane| lane.framing == Framing::Rtu);
        let forwarded = transaction.forward(dispatcher.gateway(), &frame, unit, may_wait).await?;
        if forwarded == Forwarded::Short {
            port_state.units(|units| units.sent_in_part(unit));
        }
        if forwarded != Forwarded::Whole {
            // The device ignores the truncated frame; the sender of this request knows that it broke off.
            dispatcher.forget(&frame);
            return Ok(());
        }
        dispatcher.arrived(&frame);
        let crc = frame.own_crc();
        frame.pdu(|request| transaction.note_forwarded(unit, request, crc));
    }
    let proving = dispatcher.is_proving(&frame);
    if unit != BROADCAST && !arriving && !proving && frame.origin().reply_to == ReplyTo::Line {
        port_state.stats.count(Event::Stored);
    }
    dispatcher.sent(&frame, unit);
    let sent = if arriving { Ok(()) } else { transaction.send(unit, dispatcher, &frame).await? };
    if unit == BROADCAST {
        // Broadcasts have no response, so they are not retried. A collision has been counted.
        transaction.turnaround().await;
        dispatcher.done_without_response(&frame);
        return Ok(());
    }
    // The response overwrites the request in the frame. It is copied in place: a buffer that is returned is copied as a whole.
    let mut request = Pdu::new();
    // Fits: no longer than a PDU may be.
    dispatcher.with_request(&frame, |pdu| request.extend_from_slice(pdu).unwrap_or_default());
    let outcome = match sent {
        Ok(()) => transaction.receive(&mut IncomingResponse::new(dispatcher, &frame, unit, &request)).await?,
        Err(Collision) => Err(Failure::Collision),
    };
    if proving {
        proved(dispatcher, client, &frame, unit, outcome);
        return Ok(());
    }
    answered(dispatcher, client, &frame, unit, &request, outcome);
    Ok(())
}

/// Handles the outcome of the request in `frame`.
fn answered<'g>(
    dispatcher: &Dispatcher<'g>,
    client: &SerialClientSettings,
    frame: &Frame<'g>,
    unit: u8,
    request: &[u8],
    outcome: Result<Duration, Failure>,
) {
    if frame.origin().reply_to == ReplyTo::Console {
        dispatcher.gateway().direct_request.note(outcome);
    }
    let port_state = dispatcher.port_state();
    match outcome {
        Ok(took) => {
            let exception = frame.function() & EXCEPTION_BIT != 0;
            port_state.answered(unit, took, exception);
            if !exception {
                port_state.units(|units| units.learn(unit, request));
            }
            // If another response had been started in the frame, the requests that share it must be repeated.
            if frame.filled().1 == Fill::Complete {
                return dispatcher.done(frame);
            }
        }
        Err(Failure::Corrupt(error)) => {
            port_state.corrupt(unit, error);
            frame.blame(Cause::Corruption);
        }
        // The collision may have hit only the echo: the unit may have received the request, and respond.
        Err(Failure::Collision) => {}
        Err(Failure::Timeout) => port_state.timed_out(unit, client.down_after),
    }
    dispatcher.failed(frame, client.retries);
}

/// Handles the outcome of the proof sent ahead of the request in `frame`.
fn proved<'g>(
    dispatcher: &Dispatcher<'g>,
    client: &SerialClientSettings,
    frame: &Frame<'g>,
    unit: u8,
    outcome: Result<Duration, Failure>,
) {
    match outcome {
        Ok(_) => return dispatcher.proved(frame, unit),
        Err(Failure::Corrupt(error)) => {
            dispatcher.port_state().corrupt(unit, error);
            frame.blame(Cause::Corruption);
        }
        Err(Failure::Timeout | Failure::Collision) => {}
    }
    dispatcher.not_proved(frame, unit, client.down_after, client.retries);
}
