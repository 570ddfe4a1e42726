//! What the tests of the simulated chip share: segments to start with, and settings as MainDevices write them.

use mobgate_simulator::esc::eeprom::Eeprom;
use mobgate_simulator::esc::{Chip, Kind, Segment};

/// Where the tests have the mailboxes and the process data.
pub(crate) const OUT_BOX: u16 = 0x1000;
pub(crate) const IN_BOX: u16 = 0x1080;
pub(crate) const OUTPUTS: u16 = 0x1100;
pub(crate) const INPUTS: u16 = 0x1400;

/// SyncManagers as SOEM writes them: mailboxes of 128 bytes, process data of 120.
pub(crate) const MANAGERS: [u8; 32] = [
    0x00, 0x10, 0x80, 0x00, 0x26, 0x00, 0x01, 0x00, // mailbox to the device
    0x80, 0x10, 0x80, 0x00, 0x22, 0x00, 0x01, 0x00, // mailbox from the device
    0x00, 0x11, 0x78, 0x00, 0x64, 0x00, 0x01, 0x00, // outputs
    0x00, 0x14, 0x78, 0x00, 0x20, 0x00, 0x01, 0x00, // inputs
];
/// FMMUs as SOEM writes them: outputs, inputs, status of the mailbox from the device.
pub(crate) const FMMUS: [u8; 48] = [
    0, 0, 0, 0, 0x78, 0, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0, //
    0x78, 0, 0, 0, 0x78, 0, 0, 7, 0x00, 0x14, 0, 1, 1, 0, 0, 0, //
    0xF0, 0, 0, 0, 0x01, 0, 0, 7, 0x0D, 0x08, 0, 1, 1, 0, 0, 0,
];

/// The beginning of an EEPROM with a good check byte: SPI, nothing emulated, SYNC0 as an event, this alias.
pub(crate) fn eeprom(alias: u16) -> Vec<u8> {
    let mut content = vec![0xFF; 2048];
    content[..14].copy_from_slice(&[0x80, 0x00, 0x00, 0x08, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0]);
    content[8..10].copy_from_slice(&alias.to_le_bytes());
    content[14] = Eeprom::check(&content[..14]);
    content[15] = 0;
    content
}

/// A line of `count` chips with station addresses 1001h, 1002h and so on.
pub(crate) fn line(count: u16) -> Segment {
    let mut segment = Segment::new((0..count).map(|nth| Chip::new(Kind::LAN9252, eeprom(0x0A00 + nth))));
    for nth in 0..count {
        assert_eq!(segment.poke(nth, 0x0010, &(0x1001 + nth).to_le_bytes()), 1);
    }
    segment
}

/// One chip with SyncManagers and FMMUs set up.
pub(crate) fn ready() -> Segment {
    let mut segment = line(1);
    assert_eq!(segment.poke(0, 0x0800, &MANAGERS), 1);
    assert_eq!(segment.poke(0, 0x0600, &FMMUS), 1);
    segment
}
