//! A frame is sent while it still arrives at another line.
//!
//! Its characters leave as they come. Until it has proved good nothing leaves that would make it so: an RTU copy has the CRC
//! that came, with the unit's translation in it, and an ASCII copy gets its LRC behind the verdict of the CRC. What was
//! damaged goes on to its end, under a check that is as wrong; what breaks off or does not fit is broken off.
//!
//! Where the board can, it sends the rest of an RTU frame by itself as soon as its end is known, up to the last character.

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

/// How the copy of a frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Forwarded {
    /// It was good to its end.
    Whole,
    /// It was damaged before it came here, or was broken off: whoever it is for will not take it for good.
    Broken,
    /// It was broken off where what had been sent has a good CRC: whoever it is for may have taken it for a frame.
    Short,
}

/// How the copy looks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Form {
    /// The framing in which it is sent.
    pub(crate) framing: Framing,
    /// Whether it may wait for characters that are overdue. An ASCII frame may pause for a second between any two (Serial Line
    /// 2.5.2.1): its copy is broken off where it must not do so, or would keep others from the line.
    pub(crate) may_wait: bool,
    /// The character that ends an ASCII frame.
    pub(crate) delimiter: u8,
    /// The port to which the frame comes.
    pub(crate) source: Option<PortId>,
    /// The unit under which it comes.
    pub(crate) from: u8,
    /// The unit under which it is sent.
    pub(crate) to: u8,
}

/// Sends `frame` as far as it has come and as more comes. The line has been silent.
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
    loop {
        let (filled, fill) = frame.filled();
        let characters = sent.next(frame, fill);
        if !characters.is_empty() {
            line.feed(&characters).await?;
            continue;
        }
        match fill {
            Fill::Complete => return Ok(Forwarded::Whole),
            Fill::Broken => break,
            Fill::Filling => {
                // All that the frame has is sent: what comes next is the first thing that it has not been given yet.
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
                    break;
                }
            }
        }
    }
    line.stats.count(Event::Aborted);
    Ok(if sent.is_frame(frame) { Forwarded::Short } else { Forwarded::Broken })
}

/// Lets the board send what comes at `port`. Says whether it does.
fn begin<L: SerialLine>(gateway: &Gateway<'_>, line: &mut Line<'_, L>, port: PortId, relay: Relay) -> bool {
    gateway.settings(|settings| {
        let kind = settings.port(port).map(|port| &port.kind);
        matches!(kind, Some(PortKind::Serial(serial)) if line.relay(&serial.device, relay))
    })
}

/// Bytes of unit and PDU that are sent at once.
const BYTES_MAX: usize = 16;
/// Characters that are sent at once: a colon, the digits of these bytes, and the end.
const CHARS_MAX: usize = 1 + 2 * BYTES_MAX + 4;

type Characters = Vec<u8, CHARS_MAX>;

/// What has been sent.
struct Sent {
    form: Form,
    /// Bytes of unit and PDU.
    bytes: usize,
    /// Characters behind these.
    end: usize,
    /// Characters behind these that the board has sent by itself: the frame has them, or will have.
    ahead: usize,
    /// Of the bytes sent.
    sum: u8,
    delta: CrcDelta,
}

impl Sent {
    fn new(form: Form) -> Self {
        let delta = CrcDelta::new(form.from, form.to);
        Self { form, bytes: 0, end: 0, ahead: 0, sum: 0, delta }
    }

    /// What the board can do by itself of a frame whose end is known, but for its last character.
    fn relay(&self, frame: &Frame<'_>) -> Option<Relay> {
        let length = frame.expected().filter(|_| self.form.framing == Framing::Rtu)?;
        let left = (length + rtu::OVERHEAD_BYTES).checked_sub(self.bytes + self.end)?;
        let mut delta = self.delta.clone();
        delta.pass((1 + length).checked_sub(self.bytes)?);
        // It is worth it for more than a part of the CRC.
        (left > 2).then(|| Relay::new(left as u32, delta.translate([0; 2])[0]))
    }

    /// Takes note of what the board has sent, as far as `frame` shows that.
    fn catch_up(&mut self, frame: &Frame<'_>) {
        let there = 1 + frame.pdu(<[u8]>::len);
        let count = there.saturating_sub(self.bytes).min(self.ahead);
        self.bytes += count;
        self.delta.pass(count);
        // The first half of the CRC: no board begins behind that, or sends the second.
        let end = frame.crc().1.min(self.ahead - count);
        self.end += end;
        self.ahead -= count + end;
    }

    /// The next characters that can be sent of `frame`, which is as far as `fill` says.
    fn next(&mut self, frame: &Frame<'_>, fill: Fill) -> Characters {
        let mut characters = Vec::new();
        self.catch_up(frame);
        // What was damaged goes on to its end, so that the check shows it; anything else stops here.
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

    /// The CRC of the bytes sent, which `frame` still has.
    fn crc(&self, frame: &Frame<'_>) -> crc::Digest<'static, u16> {
        let mut crc = MODBUS.digest();
        crc.update(&[self.form.to]);
        frame.pdu(|pdu| crc.update(pdu.get(..self.bytes.saturating_sub(1)).unwrap_or(pdu)));
        crc
    }

    /// Appends what may be sent behind all bytes of unit and PDU.
    fn close(&mut self, frame: &Frame<'_>, fill: Fill, characters: &mut Characters) {
        let (received, there) = frame.crc();
        if there == 0 && fill == Fill::Filling {
            return;
        }
        let computed = || self.crc(frame).finalize().to_le_bytes();
        let crc = match fill {
            // It proved good by another check.
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
                // Certainly a wrong one for what was damaged.
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

    /// Appends what is new of the frame's `end`.
    fn append(&mut self, end: &[u8], characters: &mut Characters) {
        put(characters, end.get(self.end..).unwrap_or(&[]));
        self.end = self.end.max(end.len());
    }

    /// Whether what has been sent of `frame` may be taken for one: an RTU frame with its own CRC behind it has the CRC 0. Of
    /// what the board has sent and the frame was not given, nobody knows.
    fn is_frame(&self, frame: &Frame<'_>) -> bool {
        if self.ahead > 0 {
            return true;
        }
        let mut check = self.crc(frame);
        check.update(self.delta.translate(frame.crc().0).get(..self.end).unwrap_or(&[]));
        self.form.framing == Framing::Rtu && check.finalize() == 0
    }
}

/// There is room for as many characters as are put at a time.
fn put(characters: &mut Characters, new: &[u8]) {
    let _ = characters.extend_from_slice(new);
}

#[cfg(test)]
mod tests;
