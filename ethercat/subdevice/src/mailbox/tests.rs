//! Messages, counters and repetition.

use heapless::Vec;

use super::{MAILBOX_BYTES_MAX, Mailbox, Payload, Protocol};

const SIZE: usize = 64;

fn started() -> Mailbox {
    let mut mailbox = Mailbox::default();
    mailbox.start(SIZE as u16, false);
    mailbox
}

fn request(kind: u8, length: u16) -> [u8; SIZE] {
    let mut bytes = [0; SIZE];
    bytes[..2].copy_from_slice(&length.to_le_bytes());
    bytes[5] = kind;
    bytes
}

/// The next message as far as its length says.
fn next(mailbox: &mut Mailbox) -> Option<Vec<u8, SIZE>> {
    let mut buffer = [0; MAILBOX_BYTES_MAX];
    let message = mailbox.next(&mut buffer)?;
    Vec::from_slice(&message[..message[0] as usize + 6]).ok()
}

fn send(mailbox: &mut Mailbox, mark: u8) {
    mailbox.send(Protocol::CanOpen, Payload::from_slice(&[mark]).unwrap());
}

#[test]
fn a_request_with_the_counter_of_the_last_one_is_dropped() {
    let mut mailbox = started();
    assert!(mailbox.receive(&request(0x13, 10)).is_some());
    assert!(mailbox.receive(&request(0x13, 10)).is_none());
    assert!(mailbox.receive(&request(0x23, 10)).is_some());
    assert_eq!(next(&mut mailbox), None, "a duplicate is dropped without a word");
}

#[test]
fn counter_0_is_always_taken() {
    let mut mailbox = started();
    assert!((0..3).all(|_| mailbox.receive(&request(0x03, 10)).is_some()));
}

#[test]
fn responses_count_from_1_to_7_and_again() {
    let mut mailbox = started();
    for counter in [1, 2, 3, 4, 5, 6, 7, 1, 2] {
        send(&mut mailbox, 0);
        assert_eq!(next(&mut mailbox).unwrap()[5] >> 4, counter);
        mailbox.fetched();
    }
}

#[test]
fn malformed_headers_are_answered_by_their_error() {
    for (bytes, detail) in [
        (request(0x13, 0), 5),
        (request(0x10, 4), 5),
        (request(0x13, SIZE as u16 - 5), 8),
        (request(0x13, 0xffff), 8),
    ] {
        let mut mailbox = started();
        assert_eq!(mailbox.receive(&bytes), None);
        assert_eq!(next(&mut mailbox).unwrap(), [4, 0, 0, 0, 0, 0x10, 1, 0, detail, 0]);
    }
}

#[test]
fn the_largest_message_fits_exactly() {
    assert!(started().receive(&request(0x13, SIZE as u16 - 6)).is_some());
}

#[test]
fn a_message_takes_the_whole_mailbox_and_nothing_of_the_one_before_is_left_behind_it() {
    let mut mailbox = started();
    let mut buffer = [0xff; MAILBOX_BYTES_MAX];
    send(&mut mailbox, 7);
    let message = mailbox.next(&mut buffer).unwrap();
    assert_eq!(message.len(), SIZE);
    assert_eq!(message[..7], [1, 0, 0, 0, 0, 0x13, 7]);
    assert!(message[7..].iter().all(|&byte| byte == 0), "{message:02x?}");
}

#[test]
fn responses_keep_their_order_and_wait_for_the_mailbox() {
    let mut mailbox = started();
    send(&mut mailbox, 1);
    send(&mut mailbox, 2);
    assert!(!mailbox.has_room());
    assert_eq!(next(&mut mailbox).unwrap()[6], 1);
    assert_eq!(next(&mut mailbox), None);
    mailbox.fetched();
    assert_eq!(next(&mut mailbox).unwrap()[6], 2);
}

#[test]
fn a_repetition_brings_the_fetched_message_and_then_the_unread_one() {
    let mut mailbox = started();
    let mut buffer = [0; MAILBOX_BYTES_MAX];
    assert_eq!(mailbox.repeat(true, &mut buffer), None, "nothing was sent yet");
    send(&mut mailbox, 1);
    let first = next(&mut mailbox).unwrap();
    mailbox.fetched();
    send(&mut mailbox, 2);
    let second = next(&mut mailbox).unwrap();

    assert!(mailbox.is_repeat(false));
    for toggle in [false, true] {
        assert_eq!(
            mailbox.repeat(toggle, &mut buffer).unwrap()[..7],
            first[..],
            "however often it is asked for"
        );
    }
    assert!(!mailbox.is_repeat(true));
    mailbox.fetched();
    assert_eq!(next(&mut mailbox).unwrap(), second);
}

#[test]
fn a_header_has_protocol_and_counter_in_its_last_byte_and_its_length_in_the_first_two() {
    for kind in 0..=255_u8 {
        let mut mailbox = started();
        let bytes = request(kind, 3);
        let expected = (kind & 15 != 0).then_some((kind & 15, &[0; 3][..]));
        let got = mailbox.receive(&bytes).map(|request| (request.protocol, request.payload));
        assert_eq!(got, expected, "{kind:02x}");
        // The bit above the counter is none of it.
        let again = mailbox.receive(&request(kind ^ 0x80, 3)).is_some();
        assert_eq!(again, expected.is_some() && kind & 0x70 == 0, "{kind:02x}");
    }
    let mut long = [0; 300];
    (long[1], long[5]) = (1, 0x13);
    assert_eq!(started().receive(&long).map(|request| request.payload.len()), Some(256));
    assert_eq!(started().receive(&long[..5]), None);
}

#[test]
fn a_mailbox_is_as_long_as_it_was_started_and_no_longer_than_there_is_memory() {
    for (bytes, payload) in [(0, 0), (6, 0), (7, 1), (64, 58), (128, 122), (129, 122), (1024, 122)] {
        let mut mailbox = Mailbox::default();
        mailbox.start(bytes, false);
        assert_eq!(mailbox.payload_bytes(), payload, "{bytes}");
    }
    let mut mailbox = started();
    send(&mut mailbox, 1);
    assert!(mailbox.receive(&request(0x13, 1)).is_some());
    mailbox.start(64, true);
    assert!(mailbox.is_idle() && !mailbox.is_occupied() && mailbox.has_room());
    assert!(mailbox.is_repeat(false) && !mailbox.is_repeat(true));
    assert!(mailbox.receive(&request(0x13, 1)).is_some(), "it counts anew");
    send(&mut mailbox, 2);
    assert_eq!(next(&mut mailbox).unwrap(), [1, 0, 0, 0, 0, 0x13, 2]);
}

#[test]
fn what_waits_and_what_is_in_the_mailbox_are_told_apart() {
    let mut mailbox = started();
    let state = |mailbox: &Mailbox| (mailbox.is_idle(), mailbox.is_occupied(), mailbox.has_room());
    assert_eq!(state(&mailbox), (true, false, true));
    send(&mut mailbox, 1);
    assert_eq!(state(&mailbox), (false, false, true));
    assert!(next(&mut mailbox).is_some());
    assert_eq!(state(&mailbox), (true, true, true));
    send(&mut mailbox, 2);
    send(&mut mailbox, 3);
    assert_eq!(state(&mailbox), (false, true, false));
    mailbox.fetched();
    assert_eq!(state(&mailbox), (false, false, false));
    assert!(next(&mut mailbox).is_some());
    mailbox.fetched();
    assert!(next(&mut mailbox).is_some());
    assert_eq!(state(&mailbox), (true, true, true));
    mailbox.fetched();
    mailbox.fetched();
    assert_eq!((state(&mailbox), next(&mut mailbox)), ((true, false, true), None));
}

#[test]
fn after_a_repetition_was_fetched_the_message_can_be_had_once_more() {
    let mut mailbox = started();
    let mut buffer = [0; MAILBOX_BYTES_MAX];
    send(&mut mailbox, 1);
    let first = next(&mut mailbox).unwrap();
    mailbox.fetched();
    for toggle in [true, false, true] {
        assert_eq!(mailbox.repeat(toggle, &mut buffer).unwrap()[..7], first[..]);
        mailbox.fetched();
        assert_eq!(next(&mut mailbox), None);
    }
    // The last one that was fetched is repeated, not an older one.
    send(&mut mailbox, 2);
    let second = next(&mut mailbox).unwrap();
    assert_eq!(mailbox.repeat(false, &mut buffer).unwrap()[..7], first[..]);
    mailbox.fetched();
    assert_eq!(next(&mut mailbox).unwrap(), second);
    mailbox.fetched();
    assert_eq!(mailbox.repeat(true, &mut buffer).unwrap()[..7], second[..]);
}
