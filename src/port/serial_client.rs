//! A client-side serial port: the gateway asks outside servers on an RS-485 or RS-232 line.
//!
//! The line is opened, and opened again with back-off when it is lost. As soon as it has been silent for the gap, the
//! desk gives the order whose turn it is; its response is written into the order's frame, which goes home.

use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};

use crate::config::{SerialClientSettings, SerialSettings};
use crate::frame::Frame;
use crate::gateway::Status;
use crate::hal::SerialHost;
use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::port::bus::{Bus, Failure, LineLost};
use crate::port::desk::Desk;
use crate::port::queue::Next;
use crate::stats::Event;

/// First and longest pause before a line is opened again.
const REOPEN_FIRST: Duration = Duration::from_millis(250);
const REOPEN_LONGEST: Duration = Duration::from_secs(5);

/// Keeps the line open and carries out the desk's orders, for ever.
pub(crate) async fn run<H: SerialHost>(desk: &Desk<'_>, settings: &SerialSettings, host: &mut H) {
    let place = desk.place();
    let mut pause = REOPEN_FIRST;
    loop {
        let jitter = host.read_jitter();
        match host.open(&settings.device, &settings.line).await {
            Ok(line) => {
                log_info!("{} is open", settings.device.as_str());
                place.set_status(Status::Open);
                desk.open();
                let bus = Bus::new(line, settings.line, settings.client, jitter, &place.stats);
                serve(desk, bus, &settings.client).await;
                desk.close();
                log_warn!("{} is lost", settings.device.as_str());
                place.stats.count(Event::LineLost);
                place.set_status(Status::Lost);
                pause = REOPEN_FIRST;
            }
            Err(error) => {
                if place.set_status(Status::Failed(error)) {
                    log_warn!("{} cannot be opened: {}", settings.device.as_str(), error);
                }
            }
        }
        Timer::after(pause).await;
        pause = (pause * 2).min(REOPEN_LONGEST);
    }
}

/// Carries orders out until the line is lost.
async fn serve<L: Read + Write>(desk: &Desk<'_>, mut bus: Bus<'_, L>, client: &SerialClientSettings) {
    loop {
        if bus.silence().await.is_err() {
            return;
        }
        let done = match desk.next() {
            Next::Serve(frame, ticket) => carry_out(desk, &mut bus, client, frame, ticket.unit).await,
            Next::Wait(until) => bus.idle(select(desk.changed(), Timer::at(until))).await,
            Next::Empty => bus.idle(desk.changed()).await,
        };
        if done.is_err() {
            return;
        }
    }
}

async fn carry_out<'g, L: Read + Write>(
    desk: &Desk<'g>,
    bus: &mut Bus<'_, L>,
    client: &SerialClientSettings,
    frame: Frame<'g>,
    unit: u8,
) -> Result<(), LineLost> {
    let place = desk.place();
    let mut request = [0; PDU_BYTES_MAX];
    let length = frame.copy_pdu(&mut request);
    let request = request.get(..length).unwrap_or(&[]);
    if unit == 0 {
        bus.broadcast(request).await?;
        desk.done_silently(&frame);
        return Ok(());
    }
    place.units(|units| units.asked(unit));
    // A response fits into the frame: it is no longer than a PDU may be.
    let take = |response: &[u8]| {
        let _ = frame.replace(response);
    };
    match bus.exchange(unit, request, take).await? {
        Ok(took) => {
            let exception = frame.function() & EXCEPTION_BIT != 0;
            place.units(|units| units.answered(unit, took, exception));
            place.stats.count(Event::Answer);
            if exception {
                place.stats.count(Event::Exception);
            }
            desk.done(&frame);
            return Ok(());
        }
        Err(Failure::Damaged) => {
            place.stats.count(Event::Damaged);
            place.units(|units| units.damaged(unit));
        }
        Err(Failure::Timeout) => {
            place.stats.count(Event::Timeout);
            let window = client.late_window.unwrap_or(client.timeout);
            place.units(|units| units.timed_out(unit, Instant::now(), window, client.down_after));
        }
    }
    desk.failed(&frame, client.retries);
    Ok(())
}
