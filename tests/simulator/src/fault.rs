//! Faults between a device and the wire: its good response goes in, what a bad day makes of it comes out.

use std::ops::RangeInclusive;

use embassy_time::{Duration, Instant};
use embedded_io_async::Write;
use mobgate::settings::Framing;

use crate::random::Random;
use crate::wire::{Flaw, LineEnd};

/// Something that happens to a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No response: the request is carried out, its response is lost.
    Dead,
    /// The request is lost: it is neither carried out nor answered.
    Unheard,
    /// The device stalls for a time between the two, then answers all that it has heard, in order.
    Hiccup(Duration, Duration),
    /// The response comes later, by a time between the two. Those behind it wait for it.
    Late(Duration, Duration),
    /// The response comes later, mostly by a little and now and then by much: an exponential distribution with this mean.
    Lingers(Duration),
    /// The CRC, or in ASCII the LRC, is wrong.
    BadCrc,
    /// One bit of one byte is turned.
    FlippedBit,
    /// One byte is missing.
    LostByte,
    /// The end is missing: at least the last byte, at most all but the first.
    Truncated,
    /// All behind so many bytes is missing.
    CutTo(usize),
    /// A character in the middle comes with another bit, and the receiver notices in this way.
    Flawed(Flaw),
    /// A good frame with another unit's id.
    WrongUnit,
    /// A good frame of another function.
    WrongFunction,
    /// A good frame with two more data bytes than asked for.
    WrongLength,
    /// A good frame in which the bytes behind the function code differ: another address echoed, another byte count.
    WrongEcho,
    /// So many random bytes right before the response.
    NoiseBefore(u8),
    /// So many random bytes right behind the response.
    NoiseAfter(u8),
    /// A silence in the middle of the response.
    GapInside(Duration),
    /// An exception instead of the response.
    Exception(u8),
    /// The response comes twice, with this silence between.
    Twice(Duration),
    /// On TCP: another transaction id.
    WrongTransaction,
    /// On TCP: the device closes the connection instead of answering.
    Close,
    /// On TCP: the device resets the connection instead of answering.
    Reset,
    /// On TCP: the device closes the connection in the middle of its response.
    Half,
}

impl Fault {
    /// What a bad line does to responses.
    pub const CORRUPTING: [Self; 4] = [Self::BadCrc, Self::FlippedBit, Self::LostByte, Self::Truncated];
    /// Good frames that are no response to the request.
    pub const MISFITS: [Self; 2] = [Self::WrongFunction, Self::WrongLength];

    /// One that makes responses late, without a bound: much or little, in the time-outs of most tests.
    pub fn draw_late(random: &mut Random) -> Self {
        let mean = Duration::from_millis(random.within(10..=500));
        let stall = Self::Hiccup(Duration::from_millis(1), 5 * mean);
        [Self::Lingers(mean), Self::Lingers(mean), stall][random.index(3)]
    }
}

/// Which requests a fault hits. Requests of a device are counted from 1 on.
#[derive(Debug, Clone, PartialEq)]
pub enum When {
    /// Every one.
    Always,
    /// Each with this probability.
    Chance(f64),
    /// Every so many-th.
    Every(u64),
    /// These.
    Requests(RangeInclusive<u64>),
    /// Those executed in this time.
    During(RangeInclusive<Instant>),
    /// Those of this function code.
    Function(u8),
}

/// A device's faults. Those that hit the same response add up, in the order in which they were given.
#[derive(Debug, Clone)]
pub struct Faults {
    rules: Vec<(When, Fault)>,
    random: Random,
    requests: u64,
    injected: u64,
}

/// What is sent as the response to a request.
pub(crate) struct Transmission {
    /// How much later than it should.
    pub(crate) late: Duration,
    /// How long the device stalls from the request on.
    pub(crate) hiccup: Option<Duration>,
    pub(crate) pieces: Vec<Piece>,
}

/// A part of a transmission.
pub(crate) struct Piece {
    /// Before it.
    pub(crate) pause: Duration,
    pub(crate) what: Sent,
}

/// What is sent, or done to the connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Sent {
    Bytes(Vec<u8>),
    /// A character in the middle of them spoiled.
    Flawed(Vec<u8>, Flaw),
    Close,
    Reset,
}

impl Sent {
    /// In characters.
    pub(crate) fn length(&self) -> usize {
        match self {
            Self::Bytes(bytes) | Self::Flawed(bytes, _) => bytes.len(),
            Self::Close | Self::Reset => 0,
        }
    }
}

impl Faults {
    /// No faults.
    pub const fn none() -> Self {
        Self::new(0)
    }

    /// No faults yet; what is left to chance comes from `seed`.
    pub const fn new(seed: u64) -> Self {
        Self { rules: Vec::new(), random: Random::new(seed), requests: 0, injected: 0 }
    }

    /// The faults, and `fault` for the requests that `when` says.
    #[must_use]
    pub fn with(mut self, when: When, fault: Fault) -> Self {
        self.rules.push((when, fault));
        self
    }

    /// How often a fault has hit.
    pub fn injected(&self) -> u64 {
        self.injected
    }

    /// The faults that hit `request`, which is the next one.
    pub(crate) fn draw(&mut self, request: &[u8]) -> Vec<Fault> {
        self.requests += 1;
        let Self { rules, random, requests, .. } = self;
        let mut hits = |when: &When| match when {
            When::Always => true,
            When::Chance(probability) => random.chance(*probability),
            When::Every(nth) => requests.is_multiple_of(*nth),
            When::Requests(range) => range.contains(requests),
            When::During(time) => time.contains(&Instant::now()),
            When::Function(function) => request.first() == Some(function),
        };
        let hits: Vec<Fault> = rules.iter().filter(|(when, _)| hits(when)).map(|&(_, fault)| fault).collect();
        self.injected += hits.len() as u64;
        hits
    }

    /// What `hits` make of `unit`'s `response`. `frame` makes a frame of unit and PDU, and is told whether its transaction id is to
    /// be wrong.
    pub(crate) fn transmission(
        &mut self,
        framing: Framing,
        mut unit: u8,
        hits: &[Fault],
        mut pdu: Vec<u8>,
        frame: impl Fn(u8, &[u8], bool) -> Vec<u8>,
    ) -> Option<Transmission> {
        if hits.contains(&Fault::Dead) {
            return None;
        }
        for &fault in hits {
            forge(fault, &mut unit, &mut pdu);
        }
        let bytes = frame(unit, &pdu, hits.contains(&Fault::WrongTransaction));
        let mut pieces = vec![Piece { pause: Duration::from_ticks(0), what: Sent::Bytes(bytes) }];
        let (mut late, mut hiccup) = (Duration::from_ticks(0), None);
        for &fault in hits {
            match fault {
                Fault::Late(least, most) => late += self.between(least, most),
                Fault::Lingers(mean) => {
                    let factor = self.random.exponential();
                    late += Duration::from_ticks((mean.as_ticks() as f64 * factor) as u64);
                }
                Fault::Hiccup(least, most) => hiccup = Some(self.between(least, most)),
                _ => self.corrupt(framing, fault, &mut pieces),
            }
        }
        Some(Transmission { late, hiccup, pieces })
    }

    fn between(&mut self, least: Duration, most: Duration) -> Duration {
        Duration::from_ticks(self.random.within(least.as_ticks()..=most.as_ticks()))
    }

    /// Faults of the transmission: its bytes no longer are what was meant.
    fn corrupt(&mut self, framing: Framing, fault: Fault, pieces: &mut Vec<Piece>) {
        let Some(Piece { what, .. }) = pieces.last_mut() else { return };
        match fault {
            Fault::Close => return *what = Sent::Close,
            Fault::Reset => return *what = Sent::Reset,
            _ => {}
        }
        let Sent::Bytes(bytes) = what else { return };
        if let Fault::Flawed(flaw) = fault {
            *what = Sent::Flawed(std::mem::take(bytes), flaw);
            return;
        }
        let place = self.random.index(bytes.len());
        match fault {
            Fault::BadCrc => match (framing, &mut bytes[..]) {
                // Another digit in the LRC, which stands before the line's end.
                (Framing::Ascii, [.., digit, _, _]) => *digit = if *digit == b'0' { b'1' } else { b'0' },
                (_, [.., last]) => *last ^= 0xa5,
                (_, []) => {}
            },
            Fault::FlippedBit => bytes[place] ^= 1 << self.random.index(8),
            Fault::LostByte => drop(bytes.remove(place)),
            Fault::Truncated => bytes.truncate(place.max(1)),
            Fault::CutTo(length) => bytes.truncate(length),
            Fault::Half => {
                bytes.truncate(place.max(1));
                pieces.push(Piece { pause: Duration::from_ticks(0), what: Sent::Close });
            }
            Fault::NoiseBefore(count) => {
                let noise: Vec<u8> = (0..count).map(|_| self.random.byte()).collect();
                bytes.splice(0..0, noise);
            }
            Fault::NoiseAfter(count) => bytes.extend((0..count).map(|_| self.random.byte())),
            Fault::GapInside(pause) => {
                let bytes = bytes.split_off(bytes.len() / 2);
                pieces.push(Piece { pause, what: Sent::Bytes(bytes) });
            }
            Fault::Twice(pause) => {
                let bytes = bytes.clone();
                pieces.push(Piece { pause, what: Sent::Bytes(bytes) });
            }
            // Done by `forge` or above, or no response at all.
            Fault::Close | Fault::Reset | Fault::WrongTransaction | Fault::Flawed(_) => {}
            Fault::Dead | Fault::WrongUnit | Fault::WrongFunction | Fault::WrongLength => {}
            Fault::WrongEcho | Fault::Exception(_) | Fault::Unheard => {}
            Fault::Late(..) | Fault::Lingers(_) | Fault::Hiccup(..) => {}
        }
    }
}

/// Faults of the device: it sends something wrong in good order.
fn forge(fault: Fault, unit: &mut u8, pdu: &mut Vec<u8>) {
    match fault {
        Fault::WrongUnit => *unit = unit.wrapping_add(1),
        Fault::WrongFunction => pdu[0] ^= 0x01,
        Fault::WrongLength => {
            // Also the byte count, where there is one.
            if matches!(pdu[0], 1..=4 | 17 | 23) {
                pdu[1] += 2;
            }
            pdu.extend([0x12, 0x34]);
        }
        Fault::WrongEcho => pdu[1..].iter_mut().take(2).for_each(|byte| *byte ^= 0x01),
        Fault::Exception(code) => *pdu = vec![pdu[0] | 0x80, code],
        _ => {}
    }
}

/// Sends random bytes on `line` for ever, in bursts of `burst` with `pause` between; no pause is a stuck transmitter.
pub async fn babble(mut line: LineEnd, mut random: Random, burst: usize, pause: Duration) {
    loop {
        let noise: Vec<u8> = (0..burst.max(1)).map(|_| random.byte()).collect();
        // Nobody to tell: an unplugged device is not heard.
        let _ = line.write_all(&noise).await;
        let _ = line.flush().await;
        embassy_time::Timer::after(pause.max(Duration::from_ticks(1))).await;
    }
}
