//! A client-side serial port: the gateway asks outside servers on an RS-485 or RS-232 line.
//!
//! The line is opened, and opened again with back-off when it is lost. As soon as it has been silent for the gap, the
//! desk gives the order whose turn it is; its response is written into the order's frame, which goes home.

use core::pin::pin;

use embassy_futures::select::select;
use embassy_time::{Duration, Instant};

use crate::frame::{Cause, Fill, Frame, Way};
use crate::gateway::direct_request::Failure;
use crate::hal::{SerialHost, SerialLine};
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::port::client::dispatcher::Desk;
use crate::port::client::queue::{BROADCAST, Next};
use crate::port::client::transaction::Bus;
use crate::port::cut_through::egress::Copied;
use crate::port::cut_through::response::Reply;
use crate::port::line::{Collision, LineLost, Opening};
use crate::port::timer::{apart, until};
use crate::settings::{Framing, Lane, SerialClientSettings, SerialSettings};
use crate::stats::Event;

/// A line is the only link of its port.
const LINK: u8 = 0;

/// Keeps the line open and carries out the desk's orders, for ever.
pub(crate) async fn run<H: SerialHost>(desk: &Desk<'_>, settings: &SerialSettings, host: &mut H) {
    let mut opening = Opening::new(desk.place().place(), settings, desk.is_alone());
    loop {
        let jitter = host.read_jitter();
        let opened = opening.opened(host.open(&settings.device, &settings.line).await, jitter);
        // Lent and not moved: what a future is given it keeps twice.
        let mut bus = opened.map(|line| Bus::new(line, desk, settings));
        if let Some(bus) = &mut bus {
            desk.open();
            if bus.discard(settings.client.late_window()).await.is_ok() {
                apart(pin!(serve(desk, bus, &settings.client))).await;
            }
            opening.lost();
        }
        // The line is closed before it is opened again.
        drop(bus);
        desk.close();
        opening.pause().await;
    }
}

/// Carries orders out until the line is lost.
async fn serve<L: SerialLine>(desk: &Desk<'_>, bus: &mut Bus<'_, L>, client: &SerialClientSettings) {
    loop {
        if bus.silence().await.is_err() {
            return;
        }
        let wake = match desk.next(LINK) {
            Next::Serve(frame, ticket) => {
                if apart(pin!(carry_out(desk, bus, client, frame, ticket.unit))).await.is_err() {
                    return;
                }
                continue;
            }
            Next::Wait(at) => at,
            Next::Empty => Instant::MAX,
        };
        if bus.idle(select(desk.changed(LINK), until(wake))).await.is_err() {
            return;
        }
    }
}

/// Sends the request in `frame` to `unit`, and sees to what comes of it.
async fn carry_out<'g, L: SerialLine>(
    desk: &Desk<'g>,
    bus: &mut Bus<'_, L>,
    client: &SerialClientSettings,
    frame: Frame<'g>,
    unit: u8,
) -> Result<(), LineLost> {
    let place = desk.place();
    let fill = frame.filled().1;
    if fill == Fill::Broken {
        // Nothing of it has been sent, and nothing is.
        desk.forget(&frame);
        return Ok(());
    }
    let arriving = fill == Fill::Filling;
    if arriving {
        let origin = frame.origin().port;
        let input = desk.gateway().settings(|settings| Lane::at(settings, origin));
        // What is broken off comes again when it is whole.
        let may_wait = input.is_some_and(|lane| lane.framing == Framing::Rtu);
        let copied = bus.copy(desk.gateway(), &frame, unit, may_wait).await?;
        if copied == Copied::Short {
            place.units(|units| units.sent_in_part(unit));
        }
        if copied != Copied::Whole {
            // The unit has not been asked: whoever sent this knows, and the far end rejects it.
            desk.forget(&frame);
            return Ok(());
        }
        desk.arrived(&frame);
        let crc = frame.own_crc();
        frame.pdu(|request| bus.note_copied(unit, request, crc));
    }
    let proving = desk.is_proving(&frame);
    if unit != BROADCAST && !arriving && !proving && frame.origin().way == Way::Line {
        place.stats.count(Event::Stored);
    }
    desk.sent(&frame, unit);
    let sent = if arriving { Ok(()) } else { bus.send(unit, desk, &frame).await? };
    if unit == BROADCAST {
        // Nobody answers, so nobody can be asked again: a collision has been counted, and that is all.
        bus.turnaround().await;
        desk.done_silently(&frame);
        return Ok(());
    }
    // What comes takes its place in the frame.
    let request = &desk.request(&frame);
    let outcome = match sent {
        Ok(()) => bus.receive(&mut Reply::new(desk, &frame, unit, request)).await?,
        Err(Collision) => Err(Failure::Collision),
    };
    if proving {
        proved(desk, client, &frame, unit, outcome);
        return Ok(());
    }
    answered(desk, client, &frame, unit, request, outcome);
    Ok(())
}

/// What came of the request in `frame`.
fn answered<'g>(
    desk: &Desk<'g>,
    client: &SerialClientSettings,
    frame: &Frame<'g>,
    unit: u8,
    request: &[u8],
    outcome: Result<Duration, Failure>,
) {
    if frame.origin().way == Way::Console {
        desk.gateway().asking.note(outcome);
    }
    let place = desk.place();
    match outcome {
        Ok(took) => {
            let exception = frame.function() & EXCEPTION_BIT != 0;
            place.answered(unit, took, exception);
            if !exception {
                place.units(|units| units.learn(unit, request));
            }
            // Where another answer had begun before, that is in the frame: who shares it has to ask again.
            if frame.filled().1 == Fill::Complete {
                return desk.done(frame);
            }
        }
        Err(Failure::Damaged(trouble)) => {
            place.damaged(unit, trouble);
            frame.blame(Cause::Damage);
        }
        // Only the echo may have been damaged: the unit may have heard the request, and answer.
        Err(Failure::Collision) => {}
        Err(Failure::Timeout) => place.timed_out(unit, client.down_after),
    }
    desk.failed(frame, client.retries);
}

/// What came of the proof that the request in `frame` waited for.
fn proved<'g>(
    desk: &Desk<'g>,
    client: &SerialClientSettings,
    frame: &Frame<'g>,
    unit: u8,
    outcome: Result<Duration, Failure>,
) {
    match outcome {
        Ok(_) => return desk.proved(frame, unit),
        Err(Failure::Damaged(trouble)) => {
            desk.place().damaged(unit, trouble);
            frame.blame(Cause::Damage);
        }
        Err(Failure::Timeout | Failure::Collision) => {}
    }
    desk.not_proved(frame, unit, client.down_after, client.retries);
}
