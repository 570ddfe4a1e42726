//! How each sort of setting in a port line is parsed and printed.

use core::fmt::{self, Display};

use embassy_time::Duration;
use heapless::Vec;

// As what uses it.
#[cfg(feature = "tls")]
use super::certificates::certificate_name;
#[cfg(feature = "files")]
use super::ethercat::FILES;
use super::ethercat::ON_LOSS;
// As what uses it.
#[cfg(feature = "dial-in")]
use super::first_bytes;
use super::option::list;
use super::port_values::{device, format, interface, meaning, prefixes, reserved_for, server_address};
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::values::{listen, name, number, time};
use super::words::{Word, Words, Wrong};
use crate::settings::{Allowed, Count, Field, MODBUS_TCP_PORT, Proofs, Time};

/// How a newcomer is handled when all connections are taken.
const FULL: &[(&str, bool); 2] = &[("displace", false), ("refuse", true)];

impl Field<'_> {
    /// Parses the value from `words`, or from `word`, the keyword, if it has none.
    pub(crate) fn read(self, word: Word, words: &Words) -> Result<(), Wrong> {
        match self {
            Self::Framing(target, value) => *target = value,
            Self::Side(target, value) => *target = value,
            Self::Driver(target, value) => *target = value,
            Self::Stream(target, value) => *target = value,
            Self::Flag(target, value) => *target = value,
            Self::Baud(target, range) => *target = number(word, "a baud rate", range.clone())?,
            // As the field; also below.
            #[cfg(feature = "dial-in")]
            Self::First(target) => *target = first_bytes::read(words)?,
            Self::Format(line) => (line.data_bits, line.parity, line.stop_bits) = format(word)?,
            value => value.read_value(words.take(), words)?,
        }
        Ok(())
    }

    /// Parses the value from `word`, followed by the rest of a list in `words`.
    fn read_value(self, word: Word, words: &Words) -> Result<(), Wrong> {
        match self {
            Self::Time(target, range) => *target = time(word, range)?,
            Self::AutoTime(target, _) if word.is("auto") => *target = None,
            Self::AutoTime(target, range) => *target = Some(time(word, range)?),
            Self::Idle(target, _) if word.text == "0" => *target = Duration::from_ticks(0),
            Self::Idle(target, range) => *target = time(word, range)?,
            // The limits keep these numbers within their types.
            Self::Small(target, count) => *target = count.read(word)? as u8,
            Self::Medium(target, count) => *target = count.read(word)? as u16,
            Self::Unit(target, _) if word.is("auto") => *target = None,
            Self::Unit(target, count) => *target = Some(count.read(word)? as u8),
            Self::Id(target, _) if word.is("alias") => *target = None,
            Self::Id(target, count) => *target = Some(count.read(word)? as u16),
            Self::Device(target) => *target = device(word)?,
            Self::Listen(target) => *target = listen(word)?,
            Self::Server(target) => *target = Some(server_address(word, MODBUS_TCP_PORT)?),
            Self::Full(target) => *target = word.keyword(FULL, "displace or refuse")?,
            Self::Reserve(places, peers, count) => {
                *places = count.read(word)? as u16;
                *peers = if *places > 0 { reserved_for(words)? } else { Vec::new() };
            }
            Self::Allow(target) if word.is("*") => *target = Allowed::everybody(),
            Self::Allow(target) => target.0 = prefixes(word, words)?,
            Self::Special(target, broadcast) => *target = meaning(word, words, broadcast)?,
            Self::Interface(target) if word.is("none") => *target = None,
            Self::Interface(target) => *target = Some(interface(word)?),
            Self::Line(target) if word.is("none") => *target = None,
            Self::Line(target) => *target = Some(name(word)?),
            #[cfg(feature = "tls")]
            Self::Certificate(target) if word.is("none") => *target = None,
            #[cfg(feature = "tls")]
            Self::Certificate(target) => *target = Some(certificate_name(word)?),
            Self::OnLoss(target) => *target = word.keyword(ON_LOSS, "hold, clear or stop")?,
            #[cfg(feature = "files")]
            Self::Files(target) => *target = word.keyword(FILES, "off, read or write")?,
            Self::Proofs(target) => *target = Proofs::read(word, words)?,
            _ => {}
        }
        Ok(())
    }

    /// Whether a keyword without a value is in effect; true for all others.
    fn holds(&self) -> bool {
        match self {
            Self::Framing(target, value) => *target == value,
            Self::Side(target, value) => *target == value,
            Self::Driver(target, value) => *target == value,
            Self::Stream(target, value) => *target == value,
            Self::Flag(target, value) => *target == value,
            _ => true,
        }
    }

    /// The type of its values; `None` for a keyword that never is printed, as what it says is the default, or stands in a column.
    // Only the web interface has settings by name.
    #[cfg(feature = "web")]
    pub(crate) fn shape(&self) -> Option<Shape> {
        Some(match self {
            Self::Framing(..) | Self::Side(..) => return None,
            Self::Driver(..) | Self::Stream(..) | Self::Flag(..) if self.holds() => return None,
            Self::Driver(..) | Self::Stream(..) | Self::Flag(..) => Shape::Flag,
            #[cfg(feature = "dial-in")]
            Self::First(_) => Shape::Quoted,
            Self::Small(_, Count(_, range))
            | Self::Medium(_, Count(_, range))
            | Self::Unit(_, Count(_, range))
            | Self::Id(_, Count(_, range)) => Shape::Number(*range.start(), *range.end()),
            _ => Shape::Text,
        })
    }

    /// Writes ` KEYWORD VALUE`, unless it equals `default`.
    pub(crate) fn write(&self, default: &Self, keyword: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self == default || !self.holds() {
            return Ok(());
        }
        write!(f, " {keyword}")?;
        let value: &dyn Display = match self {
            Self::Time(time, _) | Self::Idle(time, _) => &Time(**time),
            Self::AutoTime(Some(time), _) => &Time(*time),
            Self::Small(number, _) => number,
            Self::Unit(Some(number), _) => number,
            Self::Medium(number, _) => number,
            Self::Id(Some(id), _) => id,
            Self::Special(meaning, _) => meaning,
            Self::Interface(Some(name)) | Self::Line(Some(name)) => name,
            #[cfg(feature = "tls")]
            Self::Certificate(Some(name)) => name,
            Self::OnLoss(on_loss) => on_loss,
            #[cfg(feature = "files")]
            Self::Files(rights) => rights,
            Self::Proofs(proofs) => proofs,
            Self::Full(refuses) => {
                let [(displace, _), (refuse, _)] = FULL;
                if **refuses { refuse } else { displace }
            }
            Self::Reserve(places, peers, _) => {
                write!(f, " {places}")?;
                return list(f, " for ", peers);
            }
            Self::Allow(allowed) => return list(f, " ", &allowed.0),
            #[cfg(feature = "dial-in")]
            Self::First(bytes) => &first_bytes::Printed(bytes),
            _ => return Ok(()),
        };
        write!(f, " {value}")
    }
}

impl Count {
    fn read(&self, word: Word) -> Result<u32, Wrong> {
        number(word, self.0, self.1.clone())
    }
}
