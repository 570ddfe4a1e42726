//! DMA1 and DMA2 with eight streams each, and the H7's DMAMUX1 (RM0090, 10; RM0410, 8; RM0433, 15 and 17).

use crate::bank::{ALL, Bank, bits};
use crate::chip::Family;

/// Where a stream's registers begin, and how many bytes each stream has.
const FIRST: u32 = 0x10;
const STREAM_BYTES: u32 = 0x18;
/// Bits of a stream's flags in LISR and HISR.
const FLAGS_AT: [u32; 4] = [0, 6, 16, 22];
const TCIF: u32 = 1 << 5;
const HTIF: u32 = 1 << 4;

/// A peripheral's request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Request {
    /// Characters of a UART: see [`crate::chip::UARTS`].
    Received(usize),
    Transmit(usize),
    SpiReceived,
    SpiTransmit,
}

/// Requests: controller, stream and channel on the F4 and F7, number at the H7's DMAMUX.
const REQUESTS: [(Request, usize, u32, u32, u32); 12] = [
    (Request::Received(0), 0, 5, 4, 43),
    (Request::Transmit(0), 0, 6, 4, 44),
    (Request::Received(1), 1, 1, 5, 71),
    (Request::Transmit(1), 1, 6, 5, 72),
    (Request::Received(2), 0, 2, 4, 63),
    (Request::Transmit(2), 0, 4, 4, 64),
    (Request::Received(3), 0, 0, 4, 65),
    (Request::Transmit(3), 0, 7, 4, 66),
    (Request::Received(4), 0, 1, 4, 45),
    (Request::Transmit(4), 0, 3, 4, 46),
    (Request::SpiReceived, 1, 0, 3, 37),
    (Request::SpiTransmit, 1, 3, 3, 38),
];

/// One transfer of an item.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    pub(crate) peripheral: u32,
    pub(crate) memory: u32,
    pub(crate) bytes: usize,
}

/// Both controllers.
pub(crate) struct Dma {
    family: Family,
    controllers: [Bank; 2],
    /// Items of each stream's transfer as it began.
    lengths: [[u32; 8]; 2],
    mux: Bank,
}

impl Dma {
    pub(crate) fn new(family: Family) -> Self {
        let mut rows: Vec<_> = (0..0xd0).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        (0..8).for_each(|stream| rows.push((FIRST + stream * STREAM_BYTES + 0x14, 0x21, ALL)));
        let mut mux: Vec<_> = (0..=0x3c).step_by(4).map(|offset| (offset, 0, ALL)).collect();
        mux.extend([(0x80, 0, 0), (0x84, 0, ALL)]);
        Self {
            family,
            controllers: [Bank::new(&rows), Bank::new(&rows)],
            lengths: [[0; 8]; 2],
            mux: Bank::new(&mux),
        }
    }

    pub(crate) fn read(&self, controller: usize, offset: u32) -> Option<u32> {
        self.controllers[controller].read(offset)
    }

    pub(crate) fn write(&mut self, controller: usize, offset: u32, value: u32) -> Option<()> {
        let bank = &mut self.controllers[controller];
        match offset {
            0 | 4 => {}
            // Flags are cleared by ones.
            8 | 0xc => bank.set(offset - 8, bank.get(offset - 8) & !value),
            _ => {
                let before = bank.read(offset)?;
                bank.write(offset, value)?;
                let (stream, register) = ((offset - FIRST) / STREAM_BYTES, (offset - FIRST) % STREAM_BYTES);
                if register == 0 && value & !before & 1 != 0 {
                    self.lengths[controller][stream as usize] = bank.get(offset + 4);
                }
                // A stream that is stopped says that its transfer is complete.
                if register == 0 && before & !value & 1 != 0 {
                    self.flag(controller, stream, TCIF);
                }
            }
        }
        Some(())
    }

    pub(crate) fn read_mux(&self, offset: u32) -> Option<u32> {
        self.mux.read(offset)
    }

    pub(crate) fn write_mux(&mut self, offset: u32, value: u32) -> Option<()> {
        self.mux.write(offset, value)
    }

    fn flag(&mut self, controller: usize, stream: u32, flag: u32) {
        let register = stream / 4 * 4;
        let bank = &mut self.controllers[controller];
        bank.set(register, bank.get(register) | flag << FLAGS_AT[stream as usize % 4]);
    }

    /// The stream that serves `request`, if one is on.
    fn stream(&self, request: Request) -> Option<(usize, u32)> {
        let &(_, fixed, stream, channel, number) = REQUESTS.iter().find(|row| row.0 == request)?;
        let is_on = |controller: usize, stream: u32| {
            self.controllers[controller].get(FIRST + stream * STREAM_BYTES) & 1 != 0
        };
        if self.family != Family::H7 {
            let chosen = bits(self.controllers[fixed].get(FIRST + stream * STREAM_BYTES), 25, 4);
            return (is_on(fixed, stream) && chosen == channel).then_some((fixed, stream));
        }
        let channels = (0..16).filter(|channel| bits(self.mux.get(4 * channel), 0, 7) == number);
        channels.map(|channel| (channel as usize / 8, channel % 8)).find(|&(dma, stream)| is_on(dma, stream))
    }

    /// The next item that `request` asks for, which counts as transferred.
    pub(crate) fn take(&mut self, request: Request) -> Option<Item> {
        let (controller, stream) = self.stream(request)?;
        let base = FIRST + stream * STREAM_BYTES;
        let bank = &mut self.controllers[controller];
        let (control, left) = (bank.get(base), bank.get(base + 4));
        let length = self.lengths[controller][stream as usize];
        if left == 0 {
            return None;
        }
        let size = 1 << bits(control, 13, 2);
        let step = if control >> 10 & 1 != 0 { (length - left) * size } else { 0 };
        let item =
            Item { peripheral: bank.get(base + 8), memory: bank.get(base + 12) + step, bytes: size as usize };
        let left = left - 1;
        let is_circular = control >> 8 & 1 != 0;
        bank.set(base + 4, if left == 0 && is_circular { length } else { left });
        if left == 0 {
            if !is_circular {
                bank.set(base, control & !1);
            }
            self.flag(controller, stream, TCIF);
        } else if left == length / 2 {
            self.flag(controller, stream, HTIF);
        }
        Some(item)
    }

    /// Whether a stream raises its interrupt.
    pub(crate) fn interrupts(&self, controller: usize, stream: u32) -> bool {
        let bank = &self.controllers[controller];
        let flags = bank.get(stream / 4 * 4) >> FLAGS_AT[stream as usize % 4];
        // TEIE, HTIE and TCIE stand one bit below their flags.
        let enabled = bits(bank.get(FIRST + stream * STREAM_BYTES), 2, 3) << 3;
        flags & enabled != 0
    }
}
