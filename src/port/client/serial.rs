//! A client-side serial port: the gateway asks outside servers on an RS-485 or RS-232 line.
//!
//! The line is opened, and opened again with back-off when it is lost. As soon as it has been silent for the gap, the
//! dispatcher gives the request whose turn it is; its response is written into the request's frame, which goes home.

use core::pin::pin;

use embassy_futures::select::select;
use embassy_time::{Duration, Instant};

use crate::frame::{Cause, Fill, Frame, ReplyTo};
use crate::gateway::direct_request::Failure;
use crate::hal::{SerialHost, SerialLine};
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

/// A line is the only connection of its port.
const LINK: u8 = 0;

/// Keeps the line open and carries out the dispatcher's requests, for ever.
pub(crate) async fn run<H: SerialHost>(dispatcher: &Dispatcher<'_>, settings: &SerialSettings, host: &mut H) {
    let mut opening = Opening::new(dispatcher.port_state().state(), settings, dispatcher.is_alone());
    loop {
        let jitter = host.read_jitter();
        let opened = opening.opened(host.open(&settings.device, &settings.line).await, jitter);
        // Lent and not moved: what a future is given it keeps twice.
        let mut transaction = opened.map(|line| SerialTransaction::new(line, dispatcher, settings));
        if let Some(transaction) = &mut transaction {
            dispatcher.open();
            if transaction.discard(settings.client.late_window()).await.is_ok() {
                outlined(pin!(serve(dispatcher, transaction, &settings.client))).await;
            }
            opening.lost();
        }
        // The line is closed before it is opened again.
        drop(transaction);
        dispatcher.close();
        opening.pause().await;
    }
}

/// Carries requests out until the line is lost.
async fn serve<L: SerialLine>(
    dispatcher: &Dispatcher<'_>,
    transaction: &mut SerialTransaction<'_, L>,
    client: &SerialClientSettings,
) {
    loop {
        if transaction.silence().await.is_err() {
            return;
        }
        let wake = match dispatcher.next(LINK) {
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
        if transaction.idle(select(dispatcher.changed(LINK), until(wake))).await.is_err() {
            return;
        }
    }
}

/// Sends the request in `frame` to `unit`, and sees to what comes of it.
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
        // Nothing of it has been sent, and nothing is.
        dispatcher.forget(&frame);
        return Ok(());
    }
    let arriving = fill == Fill::Filling;
    if arriving {
        let origin = frame.origin().port;
        let input = dispatcher.gateway().settings(|settings| Lane::at(settings, origin));
        // What is broken off comes again when it is whole.
        let may_wait = input.is_some_and(|lane| lane.framing == Framing::Rtu);
        let forwarded = transaction.forward(dispatcher.gateway(), &frame, unit, may_wait).await?;
        if forwarded == Forwarded::Short {
            port_state.units(|units| units.sent_in_part(unit));
        }
        if forwarded != Forwarded::Whole {
            // The unit has not been asked: whoever sent this knows, and the far end rejects it.
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
        // Nobody answers, so nobody can be asked again: a collision has been counted, and that is all.
        transaction.turnaround().await;
        dispatcher.done_silently(&frame);
        return Ok(());
    }
    // What comes takes its place in the frame.
    let request = &dispatcher.request(&frame);
    let outcome = match sent {
        Ok(()) => transaction.receive(&mut IncomingResponse::new(dispatcher, &frame, unit, request)).await?,
        Err(Collision) => Err(Failure::Collision),
    };
    if proving {
        proved(dispatcher, client, &frame, unit, outcome);
        return Ok(());
    }
    answered(dispatcher, client, &frame, unit, request, outcome);
    Ok(())
}

/// What came of the request in `frame`.
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
            // Where another response had begun before, that is in the frame: who shares it has to ask again.
            if frame.filled().1 == Fill::Complete {
                return dispatcher.done(frame);
            }
        }
        Err(Failure::Corrupt(error)) => {
            port_state.corrupt(unit, error);
            frame.blame(Cause::Corruption);
        }
        // Only the echo may have been damaged: the unit may have heard the request, and answer.
        Err(Failure::Collision) => {}
        Err(Failure::Timeout) => port_state.timed_out(unit, client.down_after),
    }
    dispatcher.failed(frame, client.retries);
}

/// What came of the proof that the request in `frame` waited for.
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
