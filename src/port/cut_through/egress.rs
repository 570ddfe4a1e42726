//! Sends a frame while it is still arriving at another line.
//!
//! Characters leave as they arrive. Nothing that would make the frame valid leaves before it is known to be valid: an RTU frame
//! keeps its received CRC, corrected for the translated unit, and an ASCII frame gets its LRC once the CRC has been checked. A
//! corrupt frame is sent to its end with an equally wrong check; a frame that breaks off or does not fit is truncated.
//!
//! Where the board supports it, hardware or an interrupt relays the rest of an RTU frame up to the last character, as soon as its
//! length is known.

use embassy_time::{Instant, with_deadline};
use heapless::Vec;

use crate::frame::{Fill, Frame};
use crate::gateway::Gateway;
use crate::hal::{Relay, SerialLine};
use crate::modbus::ascii::{CARRIAGE_RETURN, COLON, digits};
use crate::modbus::crc::MODBUS;
use crate::modbus::delta::CrcDelta;
use crate::modbus::rtu;
use crate::port::line::{Line, LineLost};
use crate::settings::{Framing, PortId, PortKind};
use crate::stats::Event;

/// How forwarding a frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Forwarded {
    /// Valid to its end.
    Whole,
    /// Corrupt on arrival, or broken off: its receiver will reject it.
    Broken,
    /// Broken off where the bytes sent happen to have a valid CRC: its receiver may have accepted them.
    Short,
}

/// Parameters of the forwarded frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Form {
    /// The framing in which it is sent.
    pub(crate) framing: Framing,
    /// Whether to wait for overdue characters. An ASCII frame may pause for a second between characters (Serial Line 2.5.2.1);
    /// where an RTU line or other traffic cannot tolerate that, the forwarded frame is broken off.
    pub(crate) may_wait: bool,
    /// The character that ends ASCII frames.
    pub(crate) delimiter: u8,
    /// The port where the frame arrives.
    pub(crate) source: Option<PortId>,
    /// The unit id on arrival.
    pub(crate) from: u8,
    /// The unit id as sent.
    pub(crate) to: u8,
}

/// Sends what has arrived of `frame`, then the rest as it arrives. The line must have been silent.
pub(crate) async fn forward<L: SerialLine>(
    gateway: &Gateway<'_>,
    line: &mut Line<'_, L>,
    frame: &Frame<'_>,
    form: Form,
) -> Result<Forwarded, LineLost> {
    line.stats.count(Event::Cut);
    line.begin();
    let mut sent = Sent::new(form);
    let mut source = form.source;
    let is_whole = loop {
        let (filled, fill) = frame.filled();
        let characters = sent.next(frame, fill);
        if !characters.is_empty() {
            line.feed(&characters).await?;
            continue;
        }
        match fill {
            Fill::Complete => break true,
            Fill::Broken => break false,
            Fill::Filling => {
                // Everything in the frame has been sent, so the relay starts with the next character to arrive.
                if let Some(relay) = sent.relay(frame)
                    && source.take().is_some_and(|port| begin(gateway, line, port, relay))
                {
                    frame.more_than(filled).await;
                    sent.ahead = line.end_relay(&relay);
                    continue;
                }
                let patience = line.active + line.settings.t1_5();
                let until = if form.may_wait { Instant::MAX } else { patience };
                if with_deadline(until, frame.more_than(filled)).await.is_err() && frame.abandon() {
                    break false;
                }
            }
        }
    };
    line.end();
    if is_whole {
        return Ok(Forwarded::Whole);
    }
    line.stats.count(Event::Aborted);
    Ok(if sent.is_frame(frame) { Forwarded::Short } else { Forwarded::Broken })
}

/// Makes the board relay what arrives at `port`; returns whether it does.
fn begin<L: SerialLine>(gateway: &Gateway<'_>, line: &mut Line<'_, L>, port: PortId, relay: Relay) -> bool {
    gateway.settings(|settings| {
        let kind = settings.port(port).map(|port| &port.kind);
        matches!(kind, Some(PortKind::Serial(serial)) if line.relay(&serial.device, relay))
    })
}

/// Bytes of unit and PDU sent at a time.
const BYTES_MAX: usize = 16;
/// Characters sent at a time: a colon, two digits per byte, and the end.
const CHARS_MAX: usize = 1 + 2 * BYTES_MAX + 4;

type Characters = Vec<u8, CHARS_MAX>;

/// State of the frame sent so far.
struct Sent {
    form: Form,
    /// Bytes of unit and PDU sent.
    bytes: usize,
    /// Characters of the check and end sent.
    end: usize,
    /// Characters the board has relayed that the frame may not hold yet.
    ahead: usize,
    /// LRC sum of the bytes sent.
    sum: u8,
    delta: CrcDelta,
}

impl Sent {
    fn new(form: Form) -> Self {
        let delta = CrcDelta::new(form.from, form.to);
        Self { form, bytes: 0, end: 0, ahead: 0, sum: 0, delta }
    }

    /// What the board can relay of a frame whose length is known: all but its last character.
    fn relay(&self, frame: &Frame<'_>) -> Option<Relay> {
        let length = frame.expected().filter(|_| self.form.framing == Framing::Rtu)?;
        let left = (length + rtu::OVERHEAD_BYTES).checked_sub(self.bytes + self.end)?;
        let mut delta = self.delta.clone();
        delta.pass((1 + length).checked_sub(self.bytes)?);
        // Not worthwhile for a part of the CRC alone.
        (left > 2).then(|| Relay::new(left as u32, delta.translate([0; 2])[0]))
    }

    /// Accounts for the characters the board has relayed, as far as `frame` holds them.
    fn catch_up(&mut self, frame: &Frame<'_>) {
        let there = 1 + frame.pdu(<[u8]>::len);
        let count = there.saturating_sub(self.bytes).min(self.ahead);
        self.bytes += count;
        self.delta.pass(count);
        // At most the first half of the CRC: a relay never sends the second.
        let end = frame.crc().1.min(self.ahead - count);
        self.end += end;
        self.ahead -= count + end;
    }

    /// The next characters of `frame` that can be sent, given its `fill` state.
    fn next(&mut self, frame: &Frame<'_>, fill: Fill) -> Characters {
        let mut characters = Vec::new();
        self.catch_up(frame);
        // A corrupt frame is sent to its end, so that its check reveals it; anything else stops here.
        if fill == Fill::Broken && frame.crc().1 < 2 {
            return characters;
        }
        if self.bytes == 0 {
            if self.form.framing == Framing::Ascii {
                put(&mut characters, &[COLON]);
            }
            self.pass(&[self.form.to], &mut characters);
        }
        let mut new: Vec<u8, { BYTES_MAX - 1 }> = Vec::new();
        let is_all = frame.pdu(|pdu| {
            let rest = pdu.get(self.bytes - 1..).unwrap_or(&[]);
            let part = rest.get(..new.capacity()).unwrap_or(rest);
            let _ = new.extend_from_slice(part);
            part.len() == rest.len()
        });
        self.delta.pass(new.len());
        self.pass(&new, &mut characters);
        if is_all {
            self.close(frame, fill, &mut characters);
        }
        characters
    }

    /// Appends bytes of unit and PDU.
    fn pass(&mut self, bytes: &[u8], characters: &mut Characters) {
        match self.form.framing {
            Framing::Rtu => put(characters, bytes),
            Framing::Ascii => bytes.iter().for_each(|&byte| {
                put(characters, &digits(byte));
                self.sum = self.sum.wrapping_add(byte);
            }),
        }
        self.bytes += bytes.len();
    }

    /// The CRC of the bytes sent, which are still in `frame`.
    fn crc(&self, frame: &Frame<'_>) -> crc::Digest<'static, u16> {
        let mut crc = MODBUS.digest();
        crc.update(&[self.form.to]);
        frame.pdu(|pdu| crc.update(pdu.get(..self.bytes.saturating_sub(1)).unwrap_or(pdu)));
        crc
    }

    /// Appends what may follow unit and PDU.
    fn close(&mut self, frame: &Frame<'_>, fill: Fill, characters: &mut Characters) {
        let (received, there) = frame.crc();
        if there == 0 && fill == Fill::Filling {
            return;
        }
        let computed = || self.crc(frame).finalize().to_le_bytes();
        let crc = match fill {
            // Validated by an LRC, so the CRC is computed here.
            Fill::Complete if there < received.len() => computed(),
            _ => self.delta.translate(received),
        };
        let is_good = || computed() == crc;
        let is_over = fill == Fill::Complete || fill == Fill::Broken && !is_good();
        match self.form.framing {
            Framing::Rtu => {
                let count = if is_over { crc.len() } else { there.min(crc.len() - 1) };
                self.append(crc.get(..count).unwrap_or(&[]), characters);
            }
            Framing::Ascii => {
                let lrc = self.sum.wrapping_neg();
                // Deliberately wrong for a corrupt frame.
                let [high, low] = digits(if is_good() { lrc } else { !lrc });
                let end = [high, low, CARRIAGE_RETURN, self.form.delimiter];
                let count = match there {
                    _ if is_over => end.len(),
                    2 if fill == Fill::Filling => 2,
                    _ => 0,
                };
                self.append(end.get(..count).unwrap_or(&[]), characters);
            }
        }
    }

    /// Appends the part of the frame's `end` that has not been sent.
    fn append(&mut self, end: &[u8], characters: &mut Characters) {
        put(characters, end.get(self.end..).unwrap_or(&[]));
        self.end = self.end.max(end.len());
    }

    /// Whether the receiver may accept what has been sent of `frame` as a frame: the CRC over an RTU frame with its CRC is 0.
    /// Unknown, and thus assumed, if the board has relayed characters that the frame does not contain.
    fn is_frame(&self, frame: &Frame<'_>) -> bool {
        if self.ahead > 0 {
            return true;
        }
        let mut check = self.crc(frame);
        check.update(self.delta.translate(frame.crc().0).get(..self.end).unwrap_or(&[]));
        self.form.framing == Framing::Rtu && check.finalize() == 0
    }
}

/// Callers never exceed the capacity.
fn put(characters: &mut Characters, new: &[u8]) {
    let _ = characters.extend_from_slice(new);
}

#[cfg(test)]
mod tests;
