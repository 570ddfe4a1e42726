//! The scanner's port: sends the requests of the data points through the router, by the rules for its name, and passes the
//! responses to the scanner.
//!
//! At most one request per device is in flight; the device's index is its transaction id. The scanner repeats and backs off on
//! its own: ports do not repeat its requests, and its attempt at a unit that is down serves as the probe.

use core::future::pending;

use embassy_futures::select::{Either4, select, select4};
use embassy_time::{Duration, Instant, Timer};

use crate::fieldbus::{EthercatState, Requests};
use crate::frame::{Cause, Envelope, Frame, Origin, ReplyTo, Stage};
use crate::gateway::{Gateway, PortState, Status};
use crate::modbus::Exception;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::scanner::{DEVICES_MAX, DeviceId, ErrorCode, Pdu, ScannerState};
use crate::settings::PortId;
use crate::stats::Event;

/// Requests still unsent after this are dropped: a value to write may be out of date.
const LIFETIME: Duration = Duration::from_secs(10);
/// Pause before trying again when no frame is free.
const STARVED: Duration = Duration::from_millis(10);

/// Transaction id of a MainDevice's own request.
const REQUEST: u16 = DEVICES_MAX as u16;

/// The port of a scanner.
struct Port<'s, 'g> {
    gateway: &'s Gateway<'g>,
    port_state: &'s PortState,
    id: PortId,
    scanner: &'s ScannerState,
    /// The EtherCAT port's MainDevice that owns these devices, and sends requests of its own.
    ethercat: Option<&'s EthercatState>,
    /// Status while running.
    status: Status,
}

/// Runs the requests of the data points, or of the MainDevice behind `ethercat`, until the port is reconfigured.
pub(crate) async fn run(
    gateway: &Gateway<'_>,
    port_state: &PortState,
    id: PortId,
    ethercat: Option<&EthercatState>,
) {
    let scanner = ethercat.map(EthercatState::scanner).or(gateway.scanner());
    let Some(scanner) = scanner else { return port_state.changed.wait().await };
    ethercat.into_iter().for_each(|ethercat| gateway.adopt(ethercat));
    let status = ethercat.map_or(Status::Open, |ethercat| ethercat.controller().into());
    let port = Port { gateway, port_state, id, scanner, status, ethercat };
    let renewed = async {
        match ethercat {
            Some(ethercat) => ethercat.renewed().await,
            None => pending().await,
        }
    };
    // Polled first: a response that arrives now may belong to a device of the previous settings.
    select(port_state.changed.wait(), select(renewed, port.run())).await;
    port.close();
}

impl Port<'_, '_> {
    /// The MainDevice's own requests.
    fn requests(&self) -> Option<&Requests> {
        self.ethercat.map(EthercatState::requests)
    }

    /// Polls the devices forever.
    async fn run(&self) -> ! {
        self.port_state.set_status(self.status);
        loop {
            let due = if self.send() {
                self.scanner.with(|scanner| scanner.due())
            } else {
                self.port_state.stats.count(Event::BackPressure);
                Instant::now() + STARVED
            };
            let responses = self.port_state.queue.receive(self.gateway.pool());
            match select4(responses, self.scanner.changed(), self.asked(), Timer::at(due)).await {
                Either4::First(frame) => self.take(&frame),
                Either4::Second(()) | Either4::Third(()) | Either4::Fourth(()) => {}
            }
        }
    }

    /// Responses that arrive from now on are useless: pending requests are repeated.
    fn close(&self) {
        self.port_state.renew();
        while self.port_state.queue.try_receive(self.gateway.pool()).is_some() {}
        self.scanner.with(|scanner| scanner.forget_open());
        self.requests().into_iter().for_each(Requests::lost);
    }

    /// Waits for a request from the MainDevice.
    async fn asked(&self) {
        match self.requests() {
            Some(requests) => requests.asked().await,
            None => pending().await,
        }
    }

    /// Sends everything that may be sent now; returns whether there were enough frames.
    fn send(&self) -> bool {
        loop {
            let now = Instant::now();
            let asked = self.requests().is_some_and(Requests::waits);
            if !asked && !self.scanner.with(|scanner| scanner.is_due(now)) {
                return true;
            }
            let Some((mut writer, frame)) = self.gateway.take_for_port(self.id) else { return false };
            let Some((transaction, unit, pdu)) = self.next(now) else { return true };
            // Fits: it is a PDU.
            let _ = writer.push(&pdu);
            writer.finish();
            let origin =
                Origin { port: self.id, reply_to: ReplyTo::Port, generation: self.port_state.generation() };
            frame.address(Envelope {
                transaction,
                paced: true,
                ..Envelope::request(origin, unit, now, now + LIFETIME)
            });
            self.port_state.stats.count(Event::Request);
            self.gateway.inbox.send(frame);
        }
    }

    /// The next request: transaction id, unit and PDU.
    fn next(&self, now: Instant) -> Option<(u16, u8, Pdu)> {
        if let Some((unit, pdu)) = self.requests().and_then(Requests::take) {
            return Some((REQUEST, unit, pdu));
        }
        let request = self.scanner.with(|scanner| scanner.next(now))?;
        Some((request.device.0.into(), request.unit, request.pdu))
    }

    /// Passes the outcome of a request to its sender.
    fn take(&self, frame: &Frame<'_>) {
        let Envelope { transaction, stage, cause, .. } = frame.envelope();
        let device = DeviceId(transaction as u8);
        let now = Instant::now();
        let silent = match cause {
            Cause::Corruption => ErrorCode::Transmission,
            Cause::Connection => ErrorCode::Connection,
            Cause::Silence | Cause::Length | Cause::Unsent => ErrorCode::Timeout,
        };
        let response = |pdu: &[u8]| {
            if let ([_, code], Cause::Unsent) = (pdu, cause)
                && transaction != REQUEST
                && Exception(*code) != Exception::GATEWAY_NO_PATH
            {
                // Already counted by the port that refused it.
                return self.scanner.with(|scanner| scanner.refused(device, now, Exception(*code)));
            }
            let outcome = match *pdu {
                _ if stage == Stage::Silence => Err(ErrorCode::Unknown),
                [function, code] if function & EXCEPTION_BIT != 0 => match Exception(code) {
                    Exception::GATEWAY_NO_PATH => Err(ErrorCode::Connection),
                    Exception::GATEWAY_NO_RESPONSE => Err(silent),
                    _ => Ok(pdu),
                },
                _ => Ok(pdu),
            };
            match outcome {
                Ok(_) => self.port_state.stats.count(Event::Response),
                Err(ErrorCode::Timeout) => self.port_state.stats.count(Event::Timeout),
                Err(ErrorCode::Transmission) => self.port_state.stats.count(Event::Corrupt),
                // Already counted by the router.
                Err(_) => {}
            }
            match self.requests() {
                Some(requests) if transaction == REQUEST => requests.ended(outcome),
                _ => self.answered(device, now, outcome),
            }
        };
        frame.pdu(response);
    }

    /// Passes the outcome of a request to the scanner, and the resulting change of the device's status to the MainDevice.
    fn answered(&self, device: DeviceId, now: Instant, outcome: Result<&[u8], ErrorCode>) {
        let (before, after) = self.scanner.with(|scanner| {
            let before = scanner.device_status(device, now);
            scanner.answered(device, now, outcome);
            (before, scanner.device_status(device, now))
        });
        if let Some(ethercat) = self.ethercat {
            ethercat.asked(device, before, after);
        } else {
            self.gateway.values_changed();
        }
    }
}
