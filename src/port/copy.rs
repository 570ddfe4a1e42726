//! A frame is sent while it still arrives at another line.
//!
//! Its characters leave as they come. Its CRC is the one that came, with the unit's translation in it, until the frame has
//! proved good: protection stays end to end.

use crate::frame::{Fill, Frame};
use crate::hal::SerialLine;
use crate::modbus::crc::MODBUS;
use crate::modbus::delta::CrcDelta;
use crate::modbus::{PDU_BYTES_MAX, rtu};
use crate::port::line::{Line, LineLost};
use crate::stats::Event;

/// How the copy of a frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Copied {
    /// It was good to its end.
    Whole,
    /// It was damaged before it came here, or was broken off: whoever it is for will not take it for good.
    Broken,
    /// It was broken off where what had been sent has a good CRC: whoever it is for may have taken it for a frame.
    Short,
}

/// Sends `frame` as far as it has come and as more comes. The line has been silent.
pub(crate) async fn copy<L: SerialLine>(
    line: &mut Line<'_, L>,
    frame: &Frame<'_>,
    (from, to): (u8, u8),
) -> Result<Copied, LineLost> {
    line.stats.count(Event::Cut);
    line.begin();
    let mut delta = CrcDelta::new(from, to);
    let mut check = MODBUS.digest();
    let mut sent = 0;
    loop {
        let (filled, fill) = frame.filled();
        let mut characters = [0; rtu::FRAME_BYTES_MAX];
        match fill {
            Fill::Complete => {
                let mut pdu = [0; PDU_BYTES_MAX];
                let length = frame.copy_pdu(&mut pdu);
                let pdu = pdu.get(..length).unwrap_or(&[]);
                let whole = rtu::encode(to, pdu, &mut characters).map_err(|_| LineLost)?;
                line.feed(whole.get(sent..).unwrap_or(&[])).await?;
                return Ok(Copied::Whole);
            }
            // What was damaged goes on to its end, so that the CRC shows it; anything else stops here.
            Fill::Broken if frame.crc().1 < 2 => break,
            Fill::Filling | Fill::Broken => {
                let count = arrived(frame, to, sent, &mut delta, &mut characters);
                let characters = characters.get(..count).unwrap_or(&[]);
                check.update(characters);
                line.feed(characters).await?;
                sent += count;
            }
        }
        if fill == Fill::Broken {
            break;
        }
        frame.more_than(filled).await;
    }
    line.stats.count(Event::Aborted);
    // The CRC of a frame with its own CRC behind it is zero.
    let good = sent >= rtu::FRAME_BYTES_MIN && check.finalize() == 0;
    Ok(if good { Copied::Short } else { Copied::Broken })
}

/// Writes what is there of `frame` behind the first `sent` characters, and says how many characters those are.
fn arrived(
    frame: &Frame<'_>,
    to: u8,
    sent: usize,
    delta: &mut CrcDelta,
    out: &mut [u8; rtu::FRAME_BYTES_MAX],
) -> usize {
    let mut count = 0;
    let mut put = |character| {
        if let Some(place) = out.get_mut(count) {
            *place = character;
            count += 1;
        }
    };
    if sent == 0 {
        put(to);
    }
    let length = frame.pdu(|pdu| {
        let new = pdu.get(sent.saturating_sub(1)..).unwrap_or(&[]);
        new.iter().for_each(|&byte| put(byte));
        delta.pass(new.len());
        pdu.len()
    });
    let (crc, there) = frame.crc();
    let crc_sent = sent.saturating_sub(1 + length);
    let crc = delta.translate(crc);
    crc.get(crc_sent..there).unwrap_or(&[]).iter().for_each(|&byte| put(byte));
    count
}
