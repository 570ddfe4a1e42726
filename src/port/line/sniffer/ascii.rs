//! The sniffer for ASCII lines: frames are delimited, so neither silences nor two interpretations are needed.

use super::{Sniffed, is_request};
use crate::modbus::ascii::{AsciiError, COLON, Decoder, LINE_FEED};
use crate::stats::LastError;

/// Sniffs an ASCII line.
pub struct AsciiSniffer {
    decoder: Decoder,
    delimiter: u8,
}

impl AsciiSniffer {
    /// Frames end with a line feed.
    pub const fn new() -> Self {
        Self { decoder: Decoder::new(LINE_FEED), delimiter: LINE_FEED }
    }

    /// The character that ends frames.
    pub const fn delimiter(&self) -> u8 {
        self.delimiter
    }

    /// Changes the character that ends frames (Application Protocol 6.8.1, sub-function 3).
    pub const fn set_delimiter(&mut self, delimiter: u8) {
        *self = Self { decoder: Decoder::new(delimiter), delimiter };
    }

    /// Whether a frame has begun and not ended.
    pub fn in_frame(&self) -> bool {
        self.decoder.in_frame()
    }

    /// The bytes of the incomplete frame: unit, PDU, LRC.
    pub fn received(&self) -> &[u8] {
        if self.in_frame() { self.decoder.bytes() } else { &[] }
    }

    /// Discards the incomplete frame, as its next character is overdue.
    pub fn overdue(&mut self) -> Sniffed<'static> {
        self.decoder.clear();
        Sniffed::Garbage(LastError::Gap)
    }

    /// Consumes characters up to the end of a frame or the start of another, and returns how many.
    pub fn feed(&mut self, received: &[u8], is_ours: impl Fn(u8) -> bool) -> (Sniffed<'_>, usize) {
        let next = received.iter().skip(1).position(|&character| character == COLON);
        let received = next.and_then(|at| received.get(..=at)).unwrap_or(received);
        let end = received.iter().enumerate().find_map(|(before, &character)| {
            let judged = self.decoder.push(character)?.map(|_| ());
            Some((before + 1, judged))
        });
        let sniffed = match end {
            None => return (Sniffed::Nothing, received.len()),
            Some((_, Err(error))) => Sniffed::Garbage(cause(error)),
            Some((_, Ok(()))) => self.judge(is_ours),
        };
        (sniffed, end.map_or(received.len(), |(count, _)| count))
    }

    /// Classifies the frame that has just ended with a valid LRC.
    fn judge(&self, is_ours: impl Fn(u8) -> bool) -> Sniffed<'_> {
        let Some((&unit, [pdu @ .., _])) = self.decoder.bytes().split_first() else {
            return Sniffed::Nothing;
        };
        match (is_ours(unit), is_request(pdu)) {
            (true, true) => Sniffed::Request { unit, pdu },
            (true, false) => Sniffed::Garbage(LastError::Length),
            (false, true) => Sniffed::ForeignRequest,
            (false, false) => Sniffed::ForeignResponse,
        }
    }
}

fn cause(error: AsciiError) -> LastError {
    match error {
        AsciiError::Lrc { .. } => LastError::Checksum,
        AsciiError::Short(_) => LastError::Length,
        AsciiError::NotHex(_) | AsciiError::Odd | AsciiError::Long | AsciiError::NoLf(_) => LastError::Ascii,
    }
}
