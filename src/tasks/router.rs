//! The routing task: the only reader of the global queue, and the only writer of every port's queue.
//!
//! The routing table determines the destination of a request, whose queue it enters with the unit id that applies there; responses
//! return to their requester. Every frame that a port sent returns to it, with or without a response, so a port tracks its open
//! requests by counting. All transactions end in [`Gateway::note`], the only function that logs them.

use core::net::IpAddr;

use embassy_time::Instant;

use crate::frame::{Cause, Channel, Envelope, Fill, Frame, Origin, ReplyTo, Stage};
use crate::gateway::audit::Topic;
use crate::gateway::{Gateway, PortState};
use crate::modbus::Exception;
use crate::modbus::pdu::{self, EXCEPTION_BIT};
use crate::port::local;
use crate::routing;
use crate::routing::{Client, Decision};
use crate::settings::{AUDIT, PortId};
use crate::stats::{Event, LogEntry, Outcome};

impl Gateway<'_> {
    /// The routing task, which never ends.
    pub async fn route(&self) -> ! {
        loop {
            let frame = self.inbox.receive(self.pool()).await;
            let (stage, origin) = frame.read(|envelope| (envelope.stage, envelope.origin));
            match stage {
                Stage::Request => self.forward(frame, origin),
                Stage::Responding => self.deliver(frame, origin, self.is_gone(origin)),
                Stage::Response | Stage::Silence => {
                    let outcome = self.note(&frame);
                    self.deliver(frame, origin, outcome == Outcome::RequesterGone);
                }
            }
        }
    }

    /// Forwards a request by the routing table.
    fn forward(&self, frame: Frame<'_>, origin: Origin) {
        if origin.reply_to == ReplyTo::Console {
            return self.forward_asked(frame);
        }
        let port = origin.port;
        let (unit, peer) = frame.read(|envelope| (envelope.unit, envelope.peer));
        let decision = frame.pdu(|request| {
            let client = Client { peer, role: &|| self.client_role(origin) };
            let decide = |settings: &_| routing::decide(settings, port, unit, client, request);
            Some(self.settings(decide))
        });
        let decision = decision.unwrap_or(Decision::Refuse(Exception::ILLEGAL_VALUE));
        let count = |event| self.count_at(port, event);
        match decision {
            Decision::Forward { port, unit: target, priority, sharing, addresses } => {
                match self.ports().get(port.index()) {
                    Some(port_state) => {
                        frame.amend(|envelope| {
                            (envelope.destination, envelope.target) = (Some(port), target);
                            (envelope.priority, envelope.sharing) = (priority, sharing);
                            envelope.addresses = addresses;
                        });
                        port_state.queue.send(frame);
                    }
                    None => {
                        frame.blame(Cause::Unsent);
                        self.refuse(frame, Exception::GATEWAY_NO_PATH);
                    }
                }
            }
            Decision::AllLines => self.broadcast(frame),
            Decision::Local => local::respond(self, frame),
            Decision::Discard => {
                count(Event::Discarded);
                self.unanswered(frame);
            }
            Decision::Refuse(exception) => self.deny(frame, exception, unit, peer),
            Decision::Ignore { broadcast } => {
                count(Event::Ignored);
                self.audit_denied(&frame, Exception::ILLEGAL_FUNCTION, unit, peer);
                if broadcast { self.finish_broadcast(frame) } else { self.confirm(frame) }
            }
            Decision::NoRule => {
                count(Event::NoPath);
                match origin.reply_to {
                    ReplyTo::Connection(_) | ReplyTo::Port | ReplyTo::Console => {
                        frame.blame(Cause::Unsent);
                        self.refuse(frame, Exception::GATEWAY_NO_PATH);
                    }
                    // On a shared bus the unit may belong to another device.
                    ReplyTo::Line | ReplyTo::Nobody => self.unanswered(frame),
                }
            }
        }
    }

    /// Refuses a request of `peer` to `unit` by the rules.
    fn deny(&self, frame: Frame<'_>, exception: Exception, unit: u8, peer: Option<IpAddr>) {
        let no_path = exception == Exception::GATEWAY_NO_PATH;
        self.count_at(frame.origin().port, if no_path { Event::NoPath } else { Event::Refused });
        self.audit_denied(&frame, exception, unit, peer);
        frame.blame(Cause::Unsent);
        self.refuse(frame, exception);
    }

    /// Writes about a write that a rule forbids.
    fn audit_denied(&self, frame: &Frame<'_>, exception: Exception, unit: u8, peer: Option<IpAddr>) {
        if !AUDIT || exception == Exception::GATEWAY_NO_PATH || frame.pdu(pdu::is_read) {
            return;
        }
        let (port, function) = (frame.origin().port, frame.function());
        let what = format_args!("a write to unit {unit} by function {function} is denied");
        self.audit_refusal(Topic::DeniedWrite, Some(port), peer, what);
    }

    /// Sends copies of a broadcast to all lines that the rules of its port lead to. The copies have no requester; the original
    /// returns at once.
    fn broadcast(&self, frame: Frame<'_>) {
        let envelope = frame.envelope();
        let origin = envelope.origin;
        let request = frame.content();
        let client = Client { peer: envelope.peer, role: &|| self.client_role(origin) };
        let mut lines = 0;
        for (index, port_state) in self.ports().iter().enumerate() {
            let port = PortId(index as u8);
            let rank = |settings: &_| routing::leads_to(settings, origin.port, client, &request, port);
            let Some(priority) = self.settings(rank) else { continue };
            // Copies use shared frames only: a flood of broadcasts must not exhaust the reserved ones.
            let origin = Origin { reply_to: ReplyTo::Nobody, ..origin };
            let to_port = Envelope { origin, target: 0, destination: Some(port), priority, ..envelope };
            let Some(copy) = self.pool().fill(usize::MAX, &request, to_port) else {
                self.count_at(origin.port, Event::QueueFull);
                continue;
            };
            port_state.queue.send(copy);
            lines += 1;
        }
        if lines == 0 {
            let of_wrong_role =
                self.settings(|settings| routing::is_of_wrong_role(settings, origin.port, client));
            if of_wrong_role {
                return self.deny(frame, Exception::ILLEGAL_FUNCTION, envelope.unit, envelope.peer);
            }
            self.count_at(origin.port, Event::NoPath);
            return self.refuse(frame, Exception::GATEWAY_NO_PATH);
        }
        self.finish_broadcast(frame);
    }

    /// Returns a broadcast: without a response, unless its port confirms writes of TCP clients.
    pub(crate) fn finish_broadcast(&self, frame: Frame<'_>) {
        let origin = frame.origin();
        let confirm =
            self.settings(|settings| settings.port(origin.port).is_some_and(|port| port.units.confirm));
        if confirm && matches!(origin.reply_to, ReplyTo::Connection(_)) {
            self.confirm(frame);
        } else {
            self.unanswered(frame);
        }
    }

    /// Confirms a write as a device would; other requests get no response.
    fn confirm(&self, frame: Frame<'_>) {
        // Still arriving: its sender sends it again once it is complete.
        if frame.abandon() {
            return;
        }
        match pdu::confirmation(&frame.content()) {
            Some(response) => {
                // Fits: it is a part of the request.
                let _ = frame.replace(response);
                self.answered(frame);
            }
            None => self.unanswered(frame),
        }
    }

    /// Logs a finished transaction, and returns its outcome.
    pub(crate) fn note(&self, frame: &Frame<'_>) -> Outcome {
        let (function, exception) = frame.pdu(|pdu| match *pdu {
            [function, code] if function & EXCEPTION_BIT != 0 => (function, Some(Exception(code))),
            [function, ..] => (function, None),
            [] => (0, None),
        });
        let (is_complete, now) = (frame.filled().1 == Fill::Complete, Instant::now());
        let entry = frame.read(|envelope| LogEntry {
            at: now,
            source: envelope.origin.port,
            destination: envelope.destination,
            unit: envelope.unit,
            target: envelope.target,
            function: function & !EXCEPTION_BIT,
            outcome: match (exception, envelope.stage) {
                _ if self.is_gone(envelope.origin) => Outcome::RequesterGone,
                (_, Stage::Silence) => Outcome::Silence,
                // The response broke off while it was being forwarded.
                _ if !is_complete => Outcome::Silence,
                (Some(exception), _) => Outcome::Exception(exception),
                _ => Outcome::Response,
            },
            took_us: u32::try_from(now.saturating_duration_since(envelope.received).as_micros())
                .unwrap_or(u32::MAX),
        });
        let outcome = entry.outcome;
        self.log().push(entry);
        outcome
    }

    /// Returns a frame to its requester, unless that is gone.
    fn deliver(&self, frame: Frame<'_>, origin: Origin, is_gone: bool) {
        match self.reply_channel(origin) {
            _ if is_gone => self.count_at(origin.port, Event::RequesterGone),
            Some(channel) => channel.send(frame),
            None => {}
        }
    }

    /// The channel on which the requester receives responses.
    fn reply_channel(&self, origin: Origin) -> Option<&Channel> {
        match origin.reply_to {
            ReplyTo::Connection(connection) => {
                self.connections().get(usize::from(connection)).map(|connection| &connection.responses)
            }
            ReplyTo::Line | ReplyTo::Port => {
                self.ports().get(origin.port.index()).map(|port_state| &port_state.queue)
            }
            ReplyTo::Console => Some(&self.direct_request.responses),
            ReplyTo::Nobody => None,
        }
    }

    fn count_at(&self, port: PortId, event: Event) {
        let port_state: Option<&PortState> = self.ports().get(port.index());
        if let Some(port_state) = port_state {
            port_state.stats.count(event);
        }
    }

    /// Sends a console's request to the port that it specified.
    pub(crate) fn forward_asked(&self, frame: Frame<'_>) {
        let port = frame.read(|envelope| envelope.destination);
        match port.and_then(|port| self.ports().get(port.index())) {
            Some(port_state) => port_state.queue.send(frame),
            None => self.refuse(frame, Exception::GATEWAY_NO_PATH),
        }
    }
}
