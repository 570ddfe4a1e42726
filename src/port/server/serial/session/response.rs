//! Sends responses: whole, or while they are still arriving from the other line.

use super::{Answered, Session, Sniffer};
use crate::frame::{Envelope, Fill, Frame};
use crate::hal::SerialLine;
use crate::modbus::ascii::LINE_FEED;
use crate::modbus::{pdu, rtu};
use crate::port::cut_through::egress::{Form, Forwarded, forward};
use crate::port::line::LineLost;
use crate::port::line::framing::FRAME_CHARS_MAX;
use crate::settings::{Framing, Lane};
use crate::stats::Event;

impl<'g, L: SerialLine> Session<'_, 'g, L> {
    /// Sends `response`, whole or while it arrives.
    pub(super) async fn respond(&mut self, response: Frame<'g>) -> Result<(), LineLost> {
        let envelope = response.envelope();
        let fill = response.filled().1;
        if fill == Fill::Broken {
            // Nothing has been sent yet. Only the master can repeat the request.
            return Ok(());
        }
        let arriving = fill == Fill::Filling;
        if arriving {
            let form = self.form(&envelope);
            if forward(self.server.gateway, &mut self.line, &response, form).await? != Forwarded::Whole {
                return Ok(());
            }
        }
        let crc = response.own_crc().filter(|_| arriving);
        if !arriving {
            self.send(&envelope, &response).await?;
        }
        response.pdu(|pdu| {
            if arriving {
                let end = (crc, self.delimiter());
                let framing = self.server.settings.framing;
                self.tap.forwarded(self.line.active, Event::Response, framing, (envelope.unit, pdu), end);
            }
            self.answered(&envelope, pdu, crc.unwrap_or_else(|| rtu::check(envelope.unit, pdu)));
        });
        Ok(())
    }

    /// Sends a complete response.
    async fn send(&mut self, envelope: &Envelope, response: &Frame<'g>) -> Result<(), LineLost> {
        let mut frame = [0; FRAME_CHARS_MAX];
        let (framing, delimiter) = (self.server.settings.framing, self.delimiter());
        let encode =
            |pdu: &[u8]| framing.encode(envelope.unit, pdu, delimiter, &mut frame).map(<[u8]>::len).ok();
        let Some(length) = response.pdu(encode) else { return Ok(()) };
        let frame = frame.get(..length).unwrap_or(&[]);
        // After a collision the master has received no valid response, and repeats its request.
        let _ = self.line.send(frame).await?;
        self.tap.sent(self.line.active, Event::Response, frame);
        if envelope.destination.is_some() {
            self.server.port_state.stats.count(Event::Stored);
        }
        Ok(())
    }

    /// The character that ends ASCII frames.
    fn delimiter(&self) -> u8 {
        match &self.sniffer {
            Sniffer::Ascii(sniffer) => sniffer.delimiter(),
            Sniffer::Rtu(_) => LINE_FEED,
        }
    }

    /// How to send a response that is still arriving.
    fn form(&self, envelope: &Envelope) -> Form {
        let framing = self.server.settings.framing;
        let lane = self.server.gateway.settings(|settings| Lane::at(settings, envelope.destination?));
        // No other request waits for this line, and a started response cannot be sent again.
        let may_wait = framing == Framing::Ascii || lane.is_some_and(|lane| lane.framing == Framing::Rtu);
        Form {
            framing,
            may_wait,
            delimiter: self.delimiter(),
            source: envelope.destination,
            from: envelope.target,
            to: envelope.unit,
        }
    }

    /// Records the response sent, by its CRC.
    fn answered(&mut self, envelope: &Envelope, pdu: &[u8], crc: u16) {
        // A frame that begins after the response cannot have ended by then.
        let shortest = self.line.settings.chars(rtu::FRAME_BYTES_MIN);
        let until = self.line.active + shortest + self.line.jitter;
        self.answered = Some(Answered { unit: envelope.unit, crc, until });
        self.server.port_state.stats.answered(pdu, envelope.cause);
        // The own unit has changed the delimiter; this response still had the old one.
        if let (Sniffer::Ascii(sniffer), [pdu::function::DIAGNOSTICS, 0, 3, delimiter, 0], None) =
            (&mut self.sniffer, pdu, envelope.destination)
        {
            sniffer.set_delimiter(*delimiter);
        }
    }
}
