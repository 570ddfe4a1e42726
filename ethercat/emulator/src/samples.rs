//! Samples for chip tests: segments, and settings as MainDevices write them.

use crate::eeprom::Eeprom;
use crate::{Chip, Kind, Segment};

/// Where the mailbox to the device is.
pub const OUT_BOX: u16 = 0x1000;
/// Where the mailbox from the device is.
pub const IN_BOX: u16 = 0x1080;
/// Where the outputs are.
pub const OUTPUTS: u16 = 0x1100;
/// Where the inputs are.
pub const INPUTS: u16 = 0x1400;

/// SyncManagers as SOEM writes them: mailboxes of 128 bytes, process data of 120.
pub const MANAGERS: [u8; 32] = [
    0x00, 0x10, 0x80, 0x00, 0x26, 0x00, 0x01, 0x00, // mailbox to the device
    0x80, 0x10, 0x80, 0x00, 0x22, 0x00, 0x01, 0x00, // mailbox from the device
    0x00, 0x11, 0x78, 0x00, 0x64, 0x00, 0x01, 0x00, // outputs
    0x00, 0x14, 0x78, 0x00, 0x20, 0x00, 0x01, 0x00, // inputs
];
/// FMMUs as SOEM writes them: outputs, inputs, status of the mailbox from the device.
pub const FMMUS: [u8; 48] = [
    0, 0, 0, 0, 0x78, 0, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0, //
    0x78, 0, 0, 0, 0x78, 0, 0, 7, 0x00, 0x14, 0, 1, 1, 0, 0, 0, //
    0xF0, 0, 0, 0, 0x01, 0, 0, 7, 0x0D, 0x08, 0, 1, 1, 0, 0, 0,
];

/// The start of an EEPROM with a valid checksum: SPI, no device emulation, SYNC0 as an event, this alias.
pub fn eeprom(alias: u16) -> Vec<u8> {
    let mut content = vec![0xFF; 2048];
    content[..14].copy_from_slice(&[0x80, 0x00, 0x00, 0x08, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0]);
    content[8..10].copy_from_slice(&alias.to_le_bytes());
    content[14] = Eeprom::check(&content[..14]);
    content[15] = 0;
    content
}

/// A line of `count` chips with station addresses 1001h, 1002h and so on.
pub fn line(count: u16) -> Segment {
    let mut segment = Segment::new((0..count).map(|nth| Chip::new(Kind::LAN9252, eeprom(0x0A00 + nth))));
    for nth in 0..count {
        assert_eq!(segment.poke(nth, 0x0010, &(0x1001 + nth).to_le_bytes()), 1);
    }
    segment
}

/// One chip with SyncManagers and FMMUs set up.
pub fn ready() -> Segment {
    let mut segment = line(1);
    assert_eq!(segment.poke(0, 0x0800, &MANAGERS), 1);
    assert_eq!(segment.poke(0, 0x0600, &FMMUS), 1);
    segment
}

/// The EEPROM of a device without a processor: its chip copies every requested state. Two bytes of outputs, two of inputs.
pub fn simple_device() -> Vec<u8> {
    let mut content = eeprom(0);
    content[1] = 0x01; // Device emulation.
    content[14] = Eeprom::check(&content[..14]);
    content[16..128].fill(0);
    content[16..20].copy_from_slice(&0x0E00_0000u32.to_le_bytes());
    content[20..24].copy_from_slice(&1u32.to_le_bytes());
    content[0x7C..0x80].copy_from_slice(&[0x0F, 0x00, 0x01, 0x00]);
    let mut at = 128;
    let mut category = |kind: u16, data: &[u8]| {
        let words = (data.len() as u16 / 2).to_le_bytes();
        for part in [&kind.to_le_bytes()[..], &words, data] {
            content[at..at + part.len()].copy_from_slice(part);
            at += part.len();
        }
    };
    let mut general = [0; 32];
    (general[2], general[3], general[16]) = (1, 1, 0x11);
    category(10, &[1, 6, b's', b'i', b'm', b'p', b'l', b'e']);
    category(30, &general);
    category(40, &[1, 2]);
    category(41, &[0x00, 0x10, 2, 0, 0x64, 0, 1, 3, 0x00, 0x11, 2, 0, 0x20, 0, 1, 4]);
    let pdo = |index: u16, manager: u8, entry: u16| {
        let [e0, e1] = entry.to_le_bytes();
        let [i0, i1] = index.to_le_bytes();
        [i0, i1, 1, manager, 0, 0, 0, 0, e0, e1, 1, 0, 6, 16, 0, 0]
    };
    category(50, &pdo(0x1A00, 1, 0x6000));
    category(51, &pdo(0x1600, 0, 0x7000));
    content
}
