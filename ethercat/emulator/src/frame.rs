//! EtherCAT frames: locates their datagrams, and builds frames (I, EtherCAT Protocol: header, datagram).

use std::ops::Range;

use crate::Command;

/// The EtherType of EtherCAT.
pub const ETHER_TYPE: u16 = 0x88A4;
/// The longest frame without its FCS.
pub const FRAME_BYTES_MAX: usize = 1514;
const ETHERNET_BYTES: usize = 14;
const VLAN_BYTES: usize = 4;
const HEADER_BYTES: usize = 10;
const COUNTER_BYTES: usize = 2;
/// The frame header's type of a frame with datagrams.
const TYPE_DATAGRAMS: u16 = 1;
/// In the length field: the frame has passed a closed port 0 once.
const CIRCULATING: u8 = 0x40;
const MORE_FOLLOWS: u16 = 0x8000;
/// Bits of a length, in the frame header and in a datagram's.
const LENGTH: u16 = 0x07FF;
/// Set by the first device in the source address: "locally administered".
const PASSED: u8 = 0x02;

/// A datagram inside a frame: command, index, address, length, interrupt field, data, working counter.
pub struct Datagram<'f>(&'f mut [u8]);

impl Datagram<'_> {
    /// The command, if its code is valid.
    pub fn command(&self) -> Option<Command> {
        Command::from_repr(self.0[0])
    }

    /// The first half of the address: position or station.
    pub fn device(&self) -> u16 {
        u16::from_le_bytes([self.0[2], self.0[3]])
    }

    /// Sets the first half of the address.
    pub fn set_device(&mut self, device: u16) {
        self.0[2..4].copy_from_slice(&device.to_le_bytes());
    }

    /// The second half of the address: the offset in the device's memory.
    pub fn offset(&self) -> u16 {
        u16::from_le_bytes([self.0[4], self.0[5]])
    }

    /// The address as a logical one.
    pub fn logical(&self) -> u32 {
        u32::from(self.offset()) << 16 | u32::from(self.device())
    }

    /// Whether the frame has already passed a closed port 0 (I, Frame Processing, "Circulating frames").
    pub fn circulating(&self) -> bool {
        self.0[7] & CIRCULATING != 0
    }

    /// Marks that the frame has passed a closed port 0.
    pub fn set_circulating(&mut self) {
        self.0[7] |= CIRCULATING;
    }

    /// ORs a device's events onto the interrupt field (I, Interrupts, "ECAT event request").
    pub fn interrupt(&mut self, events: u16) {
        let [low, high] = events.to_le_bytes();
        self.0[8] |= low;
        self.0[9] |= high;
    }

    /// The interrupt field.
    pub fn interrupts(&self) -> u16 {
        u16::from_le_bytes([self.0[8], self.0[9]])
    }

    /// The data.
    pub fn data(&self) -> &[u8] {
        &self.0[HEADER_BYTES..self.0.len() - COUNTER_BYTES]
    }

    /// The data, mutable.
    pub fn data_mut(&mut self) -> &mut [u8] {
        let end = self.0.len() - COUNTER_BYTES;
        &mut self.0[HEADER_BYTES..end]
    }

    /// The working counter.
    pub fn counter(&self) -> u16 {
        let counter = &self.0[self.0.len() - COUNTER_BYTES..];
        u16::from_le_bytes([counter[0], counter[1]])
    }

    /// Adds to the working counter.
    pub fn count(&mut self, more: u16) {
        let counter = self.counter().wrapping_add(more);
        let at = self.0.len() - COUNTER_BYTES;
        self.0[at..].copy_from_slice(&counter.to_le_bytes());
    }
}

/// The datagrams of a frame; empty if it is not EtherCAT. A length beyond the frame's end ends the list.
pub fn datagrams(frame: &mut [u8]) -> impl Iterator<Item = Datagram<'_>> {
    let body = body(frame).unwrap_or_default();
    let end = body.end.min(frame.len());
    let mut rest = frame.get_mut(body.start..end).unwrap_or_default();
    std::iter::from_fn(move || {
        let (bytes, more) = datagram(rest)?;
        let (datagram, behind) = std::mem::take(&mut rest).split_at_mut_checked(bytes)?;
        rest = if more { behind } else { &mut [] };
        Some(Datagram(datagram))
    })
}

/// Whether a frame is complete: it has at least one datagram, and no length exceeds it. A chip checks only the type and processes
/// incomplete frames as far as they go; where the FCS is not visible, they are better dropped.
pub fn is_whole(frame: &[u8]) -> bool {
    let Some(mut rest) = body(frame).and_then(|body| frame.get(body)) else { return false };
    loop {
        let Some((bytes, more)) = datagram(rest) else { return false };
        match (rest.get(bytes..), more) {
            (None, _) => return false,
            (Some(_), false) => return true,
            (Some(behind), true) => rest = behind,
        }
    }
}

/// The claimed length of the first datagram in `rest`, and whether it claims that another follows.
fn datagram(rest: &[u8]) -> Option<(usize, bool)> {
    let length = u16::from_le_bytes([*rest.get(6)?, *rest.get(7)?]);
    let bytes = HEADER_BYTES + usize::from(length & LENGTH) + COUNTER_BYTES;
    Some((bytes, length & MORE_FOLLOWS != 0))
}

/// Whether an ESC processes `frame`.
pub fn is_ethercat(frame: &[u8]) -> bool {
    body(frame).is_some()
}

/// Marks the source address, as the first device does.
pub fn mark_passed(frame: &mut [u8]) {
    if let Some(byte) = frame.get_mut(6) {
        *byte |= PASSED;
    }
}

/// The range of the datagrams, between the frame header and the padding.
fn body(frame: &[u8]) -> Option<Range<usize>> {
    let field = |at: usize| frame.get(at..at + 2).map(|two| [two[0], two[1]]);
    let tagged = field(12)? == [0x81, 0x00];
    let start = ETHERNET_BYTES + if tagged { VLAN_BYTES } else { 0 };
    if u16::from_be_bytes(field(start - 2)?) != ETHER_TYPE {
        return None;
    }
    let header = u16::from_le_bytes(field(start)?);
    if header >> 12 != TYPE_DATAGRAMS {
        return None;
    }
    let first = start + 2;
    Some(first..first + usize::from(header & LENGTH))
}

/// Builds a frame for tests, datagram by datagram.
#[derive(Debug, Clone, Default)]
pub struct Builder {
    datagrams: Vec<Vec<u8>>,
}

impl Builder {
    /// Adds a datagram for an address in two halves.
    #[must_use]
    pub fn device(self, command: Command, device: u16, offset: u16, data: &[u8]) -> Self {
        self.logical(command, u32::from(offset) << 16 | u32::from(device), data)
    }

    /// Adds a datagram with a logical address.
    #[must_use]
    pub fn logical(mut self, command: Command, address: u32, data: &[u8]) -> Self {
        let mut bytes = vec![command as u8, self.datagrams.len() as u8];
        bytes.extend(address.to_le_bytes());
        bytes.extend((data.len() as u16).to_le_bytes());
        bytes.extend([0, 0]);
        bytes.extend(data);
        bytes.extend([0, 0]);
        self.datagrams.push(bytes);
        self
    }

    /// The frame, padded to Ethernet's minimum.
    pub fn build(mut self) -> Vec<u8> {
        let last = self.datagrams.len().saturating_sub(1);
        for datagram in &mut self.datagrams[..last] {
            datagram[7] |= (MORE_FOLLOWS >> 8) as u8;
        }
        let length: usize = self.datagrams.iter().map(Vec::len).sum();
        let mut frame = vec![0xFF; 6];
        frame.extend([0x10; 6]);
        frame.extend(ETHER_TYPE.to_be_bytes());
        frame.extend((length as u16 | TYPE_DATAGRAMS << 12).to_le_bytes());
        self.datagrams.iter().for_each(|datagram| frame.extend(datagram));
        frame.resize(frame.len().max(60), 0);
        frame
    }
}
