//! FMMUs: from a logical address to memory, whole bytes and single bits.

use ethercat_esc::Command;

use crate::{in_line, set_up};

/// Registers of an FMMU that writes.
fn window(logical: u32, bytes: u16, bits: (u8, u8), physical: u16, bit: u8) -> Vec<u8> {
    let [p0, p1] = physical.to_le_bytes();
    let [l0, l1] = bytes.to_le_bytes();
    let mut registers = logical.to_le_bytes().to_vec();
    registers.extend([l0, l1, bits.0, bits.1, p0, p1, bit, 2, 1, 0, 0, 0]);
    registers
}

#[test]
fn the_textbooks_window_moves_fourteen_bits() {
    let (_world, mut segment) = in_line(1);
    segment.poke(0, 0x0600, &window(0x0001_0011, 3, (3, 0), 0x0F01, 1));
    // Bits 3 to 7 of the first byte, the second, bit 0 of the third: to bit 1 of 0F01h and on.
    let sent = [0b1011_0000, 0b1100_1010, 0b0000_0001];
    assert_eq!(segment.send_logical(Command::Lwr, 0x0001_0011, &sent).counter, 1);
    let bits = 0b11_1001_0101_0110_u32;
    assert_eq!(segment.fetch(0, 0x0F00, 4).unwrap(), (bits << 9).to_le_bytes());
}

#[test]
fn bits_outside_of_the_window_keep_their_values() {
    let (_world, mut segment) = in_line(1);
    segment.poke(0, 0x0F00, &[0xFF; 4]);
    segment.poke(0, 0x0600, &window(0x0001_0011, 2, (3, 0), 0x0F01, 1));
    segment.send_logical(Command::Lwr, 0x0001_0011, &[0, 0]);
    assert_eq!(segment.fetch(0, 0x0F00, 4).unwrap(), [0xFF, 0b1000_0001, 0xFF, 0xFF], "six bits are cleared");
    // And what the datagram has around the window comes back as it was sent.
    let mut registers = window(0x0001_0011, 2, (3, 0), 0x0F01, 1);
    registers[11] = 1;
    segment.poke(0, 0x0600, &registers);
    let response = segment.send_logical(Command::Lrd, 0x0001_0010, &[0xFF; 4]);
    assert_eq!((response.counter, response.data), (1, vec![0xFF, 0b0000_0111, 0b1111_1110, 0xFF]));
}

#[test]
fn a_datagram_that_reaches_part_of_a_window_moves_that_part() {
    let (_world, mut segment) = in_line(1);
    segment.poke(0, 0x0600, &window(0x100, 4, (0, 7), 0x0F80, 0));
    assert_eq!(segment.send_logical(Command::Lwr, 0x102, &[1, 2, 3, 4]).counter, 1);
    assert_eq!(segment.fetch(0, 0x0F80, 4).unwrap(), [0, 0, 1, 2]);
    assert_eq!(segment.send_logical(Command::Lwr, 0x104, &[9]).counter, 0, "behind the window");
    assert_eq!(segment.send_logical(Command::Lwr, 0xFF, &[9]).counter, 0, "before it");
}

#[test]
fn an_inactive_window_and_one_of_the_other_direction_move_nothing() {
    let (_world, mut segment) = in_line(1);
    let mut registers = window(0, 1, (0, 7), 0x0F80, 0);
    segment.poke(0, 0x0600, &registers);
    assert_eq!(segment.send_logical(Command::Lrd, 0, &[0]).counter, 0, "it writes only");
    registers[12] = 0;
    segment.poke(0, 0x0600, &registers);
    assert_eq!(segment.send_logical(Command::Lwr, 0, &[0]).counter, 0, "switched off");
}

#[test]
fn a_mailboxs_status_can_be_mapped_behind_the_process_data() {
    let (_world, mut segment) = set_up();
    let chip = segment.chip(0);
    chip.borrow_mut().write(0, 0x1400, &[0; 120]);
    let status = |segment: &mut ethercat_esc::Segment| {
        let response = segment.send_logical(Command::Lrw, 0, &[0; 241]);
        assert_eq!(response.counter, 3);
        response.data[240]
    };
    assert_eq!(status(&mut segment) & 8, 0);
    chip.borrow_mut().write(0, 0x1080, &[0; 128]);
    assert_eq!(status(&mut segment) & 8, 8, "the mailbox is full");
}

#[test]
fn logical_access_goes_through_the_sync_manager() {
    let (_world, mut segment) = set_up();
    assert_eq!(segment.send_logical(Command::Lrd, 120, &[0; 120]).counter, 0, "no inputs yet");
    assert_eq!(segment.send_logical(Command::Lwr, 0, &[1; 119]).counter, 1);
    assert_eq!(segment.fetch(0, 0x0815, 1).unwrap()[0] & 1, 0, "not complete");
    assert_eq!(segment.send_logical(Command::Lwr, 119, &[1]).counter, 1);
    assert_eq!(segment.fetch(0, 0x0815, 1).unwrap()[0] & 1, 1, "complete with the last byte");
}
