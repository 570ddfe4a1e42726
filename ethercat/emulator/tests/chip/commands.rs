//! The fifteen commands: who takes part, what comes back, what is counted.

use ethercat_esc::frame::Builder;
use ethercat_esc::{Command, Response};

use ethercat_esc::samples::{FMMUS, MANAGERS};

use crate::in_line;

/// User memory among the registers, which both sides may write.
const USER: u16 = 0x0F80;

/// Three devices whose byte at [`USER`] is 1, 2, 4; then one datagram. What it brought back, and the bytes afterwards.
fn with_three(command: Command, device: u16, offset: u16, data: &[u8]) -> (Response, [u8; 3]) {
    let (_world, mut segment) = in_line(3);
    for nth in 0..3 {
        segment.poke(nth, USER, &[1 << nth]);
    }
    let response = segment.send(command, device, offset, data);
    let after = [0, 1, 2].map(|nth| segment.fetch(nth, USER, 1).unwrap()[0]);
    (response, after)
}

fn response(data: u8, counter: u16, device: u16) -> Response {
    Response { data: vec![data], counter, interrupts: 0, device }
}

#[test]
fn nop_leaves_everything_as_it_is() {
    assert_eq!(with_three(Command::Nop, 0, USER, &[0x50]), (response(0x50, 0, 0), [1, 2, 4]));
}

#[test]
fn position_commands_reach_the_device_that_sees_zero_and_are_counted_up_by_all() {
    let second = 0xFFFF;
    assert_eq!(with_three(Command::Aprd, second, USER, &[0x50]), (response(2, 1, 2), [1, 2, 4]));
    assert_eq!(with_three(Command::Apwr, second, USER, &[0x50]), (response(0x50, 1, 2), [1, 0x50, 4]));
    assert_eq!(with_three(Command::Aprw, second, USER, &[0x50]), (response(2, 3, 2), [1, 0x50, 4]));
}

#[test]
fn station_commands_reach_the_device_of_that_address() {
    let third = 0x1003;
    assert_eq!(with_three(Command::Fprd, third, USER, &[0x50]), (response(4, 1, third), [1, 2, 4]));
    assert_eq!(with_three(Command::Fpwr, third, USER, &[0x50]), (response(0x50, 1, third), [1, 2, 0x50]));
    assert_eq!(with_three(Command::Fprw, third, USER, &[0x50]), (response(4, 3, third), [1, 2, 0x50]));
    assert_eq!(with_three(Command::Fprd, 0x1004, USER, &[0x50]), (response(0x50, 0, 0x1004), [1, 2, 4]));
}

#[test]
fn broadcasts_reach_everybody_and_or_what_they_read() {
    assert_eq!(with_three(Command::Brd, 0, USER, &[0x50]), (response(0x57, 3, 3), [1, 2, 4]));
    assert_eq!(with_three(Command::Bwr, 0, USER, &[0x50]), (response(0x50, 3, 3), [0x50; 3]));
    // A read-write datagram takes what came in from the device before: each device writes what it was sent.
    assert_eq!(with_three(Command::Brw, 0, USER, &[0x50]), (response(0x57, 9, 3), [0x50, 0x51, 0x53]));
}

#[test]
fn read_multiple_write_reads_from_one_and_writes_to_all_others() {
    assert_eq!(with_three(Command::Armw, 0, USER, &[0x50]), (response(1, 3, 3), [1; 3]));
    let second = 0x1002;
    assert_eq!(with_three(Command::Frmw, second, USER, &[0x50]), (response(2, 3, second), [0x50, 2, 2]));
}

#[test]
fn logical_commands_count_as_the_table_of_working_counters_says() {
    let (_world, mut segment) = in_line(1);
    segment.poke(0, 0x0800, &MANAGERS);
    segment.poke(0, 0x0600, &FMMUS);
    let inputs = [7; 120];
    let chip = segment.chip(0);
    chip.borrow_mut().write(0, 0x1400, &inputs);
    let mut expect = |command, counter, first: u8, inputs: u8| {
        let response = segment.send_logical(command, 0, &[9; 240]);
        assert_eq!(
            (response.counter, response.data[0], response.data[120]),
            (counter, first, inputs),
            "{command:?}"
        );
    };
    expect(Command::Lrd, 1, 9, 7);
    expect(Command::Lwr, 1, 9, 9);
    expect(Command::Lrw, 3, 9, 7);
}

#[test]
fn two_input_windows_of_one_device_count_once() {
    let (_world, mut segment) = in_line(1);
    let window = |logical: u8| [logical, 0, 0, 0, 1, 0, 0, 7, 0x80, 0x0F, 0, 1, 1, 0, 0, 0];
    segment.poke(0, 0x0600, &[window(0), window(1)].concat());
    assert_eq!(segment.send_logical(Command::Lrw, 0, &[0; 2]).counter, 1);
}

#[test]
fn a_protected_access_counts_nothing_and_leaves_the_data() {
    let (_world, mut segment) = in_line(1);
    assert_eq!(segment.poke(0, 0x0130, &[8]), 0, "AL status belongs to the processor");
    segment.poke(0, 0x0800, &MANAGERS);
    let response = segment.send(Command::Fprd, 0x1001, 0x1080, &[0x55; 128]);
    assert_eq!((response.counter, response.data), (0, vec![0x55; 128]), "the mailbox is empty");
    let response = segment.send(Command::Fprw, 0x1001, 0x0130, &[8, 0]);
    assert_eq!((response.counter, response.data), (1, vec![1, 0]), "only the read counts");
}

#[test]
fn the_datagrams_of_a_frame_are_processed_one_after_the_other() {
    let (_world, mut segment) = in_line(2);
    let frame = Builder::default()
        .device(Command::Bwr, 0, USER, &[3])
        .device(Command::Brd, 0, 0x0000, &[0])
        .device(Command::Fprd, 0x1002, 0x0010, &[0, 0]);
    let counters: Vec<u16> = segment.send_frame(frame).iter().map(|response| response.counter).collect();
    assert_eq!(counters, [2, 2, 1]);
}

/// A frame with one read of four bytes, changed by `change`, as it is before and behind one device; none where that gives no response.
fn passed(change: impl FnOnce(&mut Vec<u8>)) -> (Vec<u8>, Option<Vec<u8>>) {
    let (_world, mut segment) = in_line(1);
    let mut frame = Builder::default().device(Command::Brd, 0, 0, &[0; 4]).build();
    change(&mut frame);
    let before = frame.clone();
    let is_answered = segment.pass(0, &mut frame, ethercat_esc::Fate::Intact);
    (before, is_answered.then_some(frame))
}

#[test]
fn unknown_commands_pass_unchanged() {
    let (before, after) = passed(|frame| frame[16] = 15);
    assert_eq!(after.unwrap()[16..], before[16..]);
}

#[test]
fn a_frame_that_is_not_ethercat_gets_no_response() {
    assert_eq!(passed(|frame| frame[12..14].copy_from_slice(&[0x08, 0x00])).1, None);
}

#[test]
fn a_vlan_tag_does_not_hide_the_datagrams() {
    let (_, after) = passed(|frame| _ = frame.splice(12..12, [0x81, 0x00, 0x00, 0x05]));
    assert_eq!(after.unwrap()[34..36], [1, 0], "the working counter");
}

#[test]
fn a_length_that_leads_out_of_the_frame_ends_the_list() {
    let (_, after) = passed(|frame| frame[22] = 0xFF);
    assert_eq!(after.unwrap()[6], 0x12, "but it has passed");
}

#[test]
fn the_source_address_tells_that_the_frame_has_passed() {
    let (_, after) = passed(|_| {});
    assert_eq!(after.unwrap()[6..12], [0x12, 0x10, 0x10, 0x10, 0x10, 0x10]);
}
