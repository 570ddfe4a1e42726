//! The Ethernet's MAC and its DMA, of the older generation (RM0090, 33; RM0410, 42) and of the H7's (RM0433, 58).
//!
//! Both keep packets in rings of descriptors of four words. What differs is where registers and bits are: see [`Layout`].

use std::collections::VecDeque;

use crate::bank::{ALL, Bank, bits};
use crate::bus::Memory;
use crate::phy::Phy;
use crate::time::{MICROSECOND, SECOND, Time};

/// The owner's bit of a descriptor: the DMA.
const OWN: u32 = 1 << 31;
/// Bytes on the wire beside a frame: preamble, checksum, gap.
const OVERHEAD: u64 = 8 + 4 + 12;

/// Offsets of registers.
struct Layout {
    management: (u32, u32),
    reset: u32,
    lists: (u32, u32),
    status: u32,
    enabled: u32,
    /// Where the summary of normal interrupts is.
    summary: u32,
    address: (u32, u32),
}

const OLD: Layout = Layout {
    management: (0x10, 0x14),
    reset: 0x1000,
    lists: (0x1010, 0x100c),
    status: 0x1014,
    enabled: 0x101c,
    summary: 1 << 16,
    address: (0x40, 0x44),
};
const NEW: Layout = Layout {
    management: (0x200, 0x204),
    reset: 0x1000,
    lists: (0x1114, 0x111c),
    status: 0x1160,
    enabled: 0x1134,
    summary: 1 << 15,
    address: (0x300, 0x304),
};

/// Flags of both: a frame was sent, received.
const SENT: u32 = 1;
const RECEIVED: u32 = 1 << 6;

/// The MAC.
pub(crate) struct Ethernet {
    is_new: bool,
    layout: &'static Layout,
    registers: Bank,
    pub(crate) phy: Phy,
    /// The next descriptors for sending and receiving.
    next: (u32, u32),
    managed_at: Option<Time>,
    sending: Option<(Time, Vec<u8>)>,
    incoming: VecDeque<(Time, Vec<u8>)>,
    /// Frames that were sent, for the station at the other end of the cable.
    pub(crate) sent: Vec<Vec<u8>>,
    /// Frames for which there was no descriptor.
    pub(crate) dropped: usize,
}

impl Ethernet {
    pub(crate) fn new(is_new: bool, phy: Phy) -> Self {
        let offsets: &[u32] = if is_new {
            &[
                0, 0x8, 0x70, 0x200, 0x204, 0x300, 0x304, 0x70c, 0x710, 0xd00, 0xd30, 0x1000, 0x1004, 0x1100,
                0x1104, 0x1108, 0x1114, 0x111c, 0x1120, 0x1128, 0x112c, 0x1130, 0x1134, 0x1160,
            ]
        } else {
            &[
                0, 4, 8, 0xc, 0x10, 0x14, 0x18, 0x40, 0x44, 0x1000, 0x1004, 0x1008, 0x100c, 0x1010, 0x1014,
                0x1018, 0x101c,
            ]
        };
        let rows: Vec<_> = offsets.iter().map(|&offset| (offset, 0, ALL)).collect();
        Self {
            is_new,
            layout: if is_new { &NEW } else { &OLD },
            registers: Bank::new(&rows),
            phy,
            next: (0, 0),
            managed_at: None,
            sending: None,
            incoming: VecDeque::new(),
            sent: Vec::new(),
            dropped: 0,
        }
    }

    fn sends(&self) -> bool {
        if self.is_new {
            self.registers.get(0x1104) & 1 != 0
        } else {
            self.registers.get(0x1018) >> 13 & 1 != 0
        }
    }

    fn receives(&self) -> bool {
        if self.is_new {
            self.registers.get(0x1108) & 1 != 0
        } else {
            self.registers.get(0x1018) >> 1 & 1 != 0
        }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        let value = self.registers.read(offset)?;
        // The state of the older one's receiver: waits for a packet.
        let waits = !self.is_new && offset == self.layout.status && self.receives();
        Some(value | if waits { 3 << 17 } else { 0 })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Time) -> Option<()> {
        if offset == self.layout.status {
            // Flags are cleared by ones.
            self.registers.set(offset, self.registers.get(offset) & !value);
            return Some(());
        }
        self.registers.write(offset, value)?;
        let (command, _) = self.layout.management;
        if offset == command && value & 1 != 0 {
            // 64 bits at 2.5 MHz.
            self.managed_at = (!self.phy.hangs).then_some(now + 26 * MICROSECOND);
        } else if offset == self.layout.reset && value & 1 != 0 && self.phy.is_there {
            // It ends with the PHY's clock only.
            self.registers.set(offset, value & !1);
        } else if offset == self.layout.lists.0 {
            self.next.0 = value;
        } else if offset == self.layout.lists.1 {
            self.next.1 = value;
        } else if !self.is_new && offset == 0x1018 {
            // The queue is flushed at once.
            self.registers.set(offset, value & !(1 << 20));
        } else if self.is_new && offset == 0xd00 {
            self.registers.set(offset, value & !1);
        }
        Some(())
    }

    /// Does what the program asked of the PHY.
    fn manage(&mut self) {
        let (command, data) = self.layout.management;
        let value = self.registers.get(command);
        let (address, register, writes) = if self.is_new {
            (bits(value, 21, 5), bits(value, 16, 5), bits(value, 2, 2) == 1)
        } else {
            (bits(value, 11, 5), bits(value, 6, 5), value & 2 != 0)
        };
        if writes {
            self.phy.write(address, register, self.registers.get(data) as u16);
        } else {
            self.registers.set(data, u32::from(self.phy.read(address, register)));
        }
        self.registers.set(command, value & !1);
    }

    fn time(&self, bytes: usize) -> Time {
        let control = self.registers.get(0);
        let megabits = if control >> 14 & 1 != 0 { 100 } else { 10 };
        (bytes.max(60) as u64 + OVERHEAD) * 8 * SECOND / (megabits * 1_000_000)
    }

    /// A frame is on its way out.
    pub(crate) fn is_sending(&self) -> bool {
        self.sending.is_some()
    }

    /// The station at the other end sends a frame.
    pub(crate) fn arrive(&mut self, frame: Vec<u8>, now: Time) {
        if !self.phy.is_there || !self.phy.has_cable {
            return;
        }
        let from = self.incoming.back().map_or(now, |&(at, _)| at.max(now));
        self.incoming.push_back((from + self.time(frame.len()), frame));
    }

    pub(crate) fn next_event(&self) -> Option<Time> {
        let sent = self.sending.as_ref().map(|&(at, _)| at);
        let received = self.incoming.front().map(|&(at, _)| at);
        [self.managed_at, sent, received].into_iter().flatten().min()
    }

    pub(crate) fn advance(&mut self, now: Time, memory: &mut impl Memory) {
        if self.managed_at.take_if(|at| *at <= now).is_some() {
            self.manage();
        }
        if let Some((_, frame)) = self.sending.take_if(|(at, _)| *at <= now) {
            if self.phy.has_cable {
                self.sent.push(frame);
            }
            self.flag(SENT);
        }
        if self.sending.is_none() && self.sends() {
            let frame = self.fetch(memory);
            self.sending = frame.map(|frame| (now + self.time(frame.len()), frame));
        }
        while let Some((_, frame)) = self.incoming.pop_front_if(|(at, _)| *at <= now) {
            if self.receives() && self.registers.get(0) & self.receiver() != 0 && self.is_for_us(&frame) {
                self.deliver(&frame, memory);
            }
        }
    }

    /// The bit that turns the receiver on.
    fn receiver(&self) -> u32 {
        if self.is_new { 1 } else { 1 << 2 }
    }

    fn flag(&mut self, flag: u32) {
        let status = self.registers.get(self.layout.status);
        self.registers.set(self.layout.status, status | flag | self.layout.summary);
    }

    /// The address filter: our own, and those of groups.
    fn is_for_us(&self, frame: &[u8]) -> bool {
        let (high, low) = self.layout.address;
        let own = [self.registers.get(low).to_le_bytes(), self.registers.get(high).to_le_bytes()].concat();
        frame.first().is_some_and(|first| first & 1 != 0) || frame.get(..6) == own.get(..6)
    }

    /// The next frame to send, if a descriptor is ours.
    fn fetch(&mut self, memory: &mut impl Memory) -> Option<Vec<u8>> {
        let at = self.next.0;
        let [word0, word1, word2, word3] = load(memory, at);
        let (owner, buffer, length) =
            if self.is_new { (word3, word0, word2 & 0x3fff) } else { (word0, word2, word1 & 0xfff) };
        if owner & OWN == 0 {
            return None;
        }
        let mut frame = vec![0; length as usize];
        memory.load(buffer, &mut frame);
        if self.is_new {
            memory.store(at + 12, &(word3 & !OWN).to_le_bytes());
            self.next.0 = following(at, self.registers.get(0x1114), self.registers.get(0x112c));
        } else {
            memory.store(at, &(word0 & !OWN).to_le_bytes());
            let ends = word0 >> 21 & 1 != 0;
            self.next.0 = if ends { self.registers.get(0x1010) } else { word3 };
        }
        Some(frame)
    }

    /// Stores a frame where the next descriptor says, if it is ours.
    fn deliver(&mut self, frame: &[u8], memory: &mut impl Memory) {
        let at = self.next.1;
        let [word0, word1, word2, word3] = load(memory, at);
        let (owner, buffer) = if self.is_new { (word3, word0) } else { (word0, word2) };
        if owner & OWN == 0 {
            self.dropped += 1;
            return;
        }
        memory.store(buffer, frame);
        let length = frame.len() as u32;
        if self.is_new {
            // First, last, length.
            memory.store(at + 12, &(3 << 28 | length).to_le_bytes());
            self.next.1 = following(at, self.registers.get(0x111c), self.registers.get(0x1130));
        } else {
            memory.store(at, &(3 << 8 | length << 16).to_le_bytes());
            let ends = word1 >> 15 & 1 != 0;
            self.next.1 = if ends { self.registers.get(0x100c) } else { word3 };
        }
        self.flag(RECEIVED);
    }

    pub(crate) fn interrupts(&self) -> bool {
        let (status, enabled) =
            (self.registers.get(self.layout.status), self.registers.get(self.layout.enabled));
        enabled & self.layout.summary != 0 && status & enabled & (SENT | RECEIVED) != 0
    }
}

/// The descriptor behind the one at `at`, of a ring that begins at `first` and has `last + 1`.
fn following(at: u32, first: u32, last: u32) -> u32 {
    if at - first >= 16 * last { first } else { at + 16 }
}

fn load(memory: &impl Memory, at: u32) -> [u32; 4] {
    std::array::from_fn(|nth| {
        let mut bytes = [0; 4];
        memory.load(at + 4 * nth as u32, &mut bytes);
        u32::from_le_bytes(bytes)
    })
}
