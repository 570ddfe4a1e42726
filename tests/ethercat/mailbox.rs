//! Conformance: the mailbox (statements 21 to 28).

use crate::prelude::*;

/// An upload request for 1000h, device type.
const UPLOAD: [u8; 10] = [0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0];
const COE: u8 = 3;

fn rig() -> Rig<Bench> {
    Rig::in_state(&MAILBOX_128, PRE_OP)
}

/// The mark in an error reply.
fn error(message: Option<Vec<u8>>) -> u8 {
    let message = message.expect("an error is answered");
    let head = (message[..5].to_vec(), message[5] & 0x0f, &message[6..8]);
    assert_eq!(head, (vec![4, 0, 0, 0, 0], 0, &[1, 0][..]));
    message[8]
}

/// Asks for the last message again, by status and activation in one access as SOEM does; true when it was served.
fn repeat(rig: &mut Rig<Bench>, on: bool) -> bool {
    let bits = 1 | u8::from(on) << 1;
    assert_eq!(rig.write(0x080d, &[0, bits]), 1);
    rig.read(0x080f, 1).unwrap()[0] & 2 == u8::from(on) << 1
}

#[test]
fn statement_21_what_is_written_in_init_is_not_answered_later() {
    let mut rig = Rig::new(&MAILBOX_128);
    rig.set_up_mailboxes();
    rig.send_counted(COE, 1, &UPLOAD);
    rig.pass(10);
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    rig.pass(10);
    assert_eq!(rig.receive(), None);
    assert!(rig.upload(0x1000, 0).is_ok());
}

#[test]
fn statement_22_a_repeated_counter_is_not_served_twice() {
    let mut rig = rig();
    let write = [0, 0x20, 0x2f, 0x04, 0x21, 0, 11, 0, 0, 0];
    assert_eq!(rig.send_counted(COE, 3, &write), 1);
    assert!(rig.receive().is_some());
    assert_eq!(rig.send_counted(COE, 3, &write), 1);
    assert_eq!((rig.receive(), rig.application().writes), (None, 1));
    assert_eq!(rig.send_counted(COE, 4, &write), 1);
    assert!(rig.receive().is_some());
    assert_eq!(rig.application().writes, 2);
}

#[test]
fn statement_23_counter_0_is_always_served_and_responses_count_1_to_7() {
    let mut rig = rig();
    let counters = (0..16).map(|_| {
        assert_eq!(rig.send_counted(COE, 0, &UPLOAD), 1);
        rig.receive().unwrap()[5] >> 4
    });
    assert_eq!(counters.collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7, 1, 2, 3, 4, 5, 6, 7, 1, 2]);
}

#[test]
fn statement_24_what_is_malformed_is_answered_by_its_error() {
    let mut rig = rig();
    let mut error_of = |protocol, payload: &[u8]| {
        rig.send_counted(protocol, 0, payload);
        error(rig.receive())
    };
    for protocol in [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15] {
        assert_eq!(error_of(protocol, &UPLOAD), 2, "protocol {protocol}");
    }
    assert_eq!(error_of(0, &UPLOAD), 5, "an error reply is no request");
    assert_eq!(error_of(COE, &[]), 5, "nothing in it");
    for length in 1..10 {
        assert_eq!(error_of(COE, &UPLOAD[..length]), 6, "{length} bytes are too few for an SDO");
    }
    for (payload, expected) in [(&[0, 0x80, 1, 0, 0, 0, 1][..], 6), (&[0, 0x80, 5, 0, 0, 0, 0, 0x10, 0], 6)] {
        assert_eq!(error_of(COE, payload), expected, "too few for SDO information");
    }
    for service in [0, 1, 3, 4, 5, 6, 7, 9, 15] {
        assert_eq!(error_of(COE, &[0, service << 4, 0, 0, 0, 0, 0, 0, 0, 0]), 4, "service {service}");
    }
    let mut too_long = [0; 128];
    too_long[..6].copy_from_slice(&[123, 0, 0, 0, 0, COE]);
    rig.write(0x1000, &too_long);
    assert_eq!(error(rig.receive()), 8);
}

#[test]
fn statement_25_a_lost_response_is_repeated_as_it_was() {
    let mut rig = rig();
    rig.send(&UPLOAD);
    let response = rig.receive().unwrap();
    let mut on = false;
    for pause in [0, 1, 5_000] {
        rig.pass(pause);
        on = !on;
        assert!(repeat(&mut rig, on), "the request is acknowledged");
        assert_eq!(rig.receive().as_ref(), Some(&response));
        assert_eq!(rig.receive(), None);
    }
    assert!(rig.upload(0x1000, 0).is_ok(), "afterwards all goes on");
}

#[test]
fn statement_25_an_unread_response_comes_behind_the_repeated_one() {
    let mut rig = rig();
    rig.send(&UPLOAD);
    let first = rig.receive().unwrap();
    rig.send(&[0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    assert!(repeat(&mut rig, true));
    assert_eq!(rig.receive(), Some(first));
    assert_eq!(rig.receive().unwrap()[12..16], 0x1234_5678u32.to_le_bytes());
    assert_eq!(rig.receive(), None);
}

#[test]
fn statement_25_an_error_reply_is_repeated_too() {
    let mut rig = rig();
    rig.send_counted(9, 0, &UPLOAD);
    let reply = rig.receive().unwrap();
    assert!(repeat(&mut rig, true));
    assert_eq!(rig.receive(), Some(reply));
}

#[test]
fn statement_25_the_bit_found_at_the_start_asks_for_nothing() {
    let mut rig = Rig::new(&MAILBOX_128);
    rig.set_up_mailboxes();
    rig.write(0x080e, &[3]);
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    assert_eq!(rig.read(0x080f, 1).unwrap()[0], 2, "it is acknowledged at once");
    assert_eq!(rig.receive(), None);
}

#[test]
fn statement_26_requests_behind_a_full_mailbox_are_not_lost() {
    let mut rig = rig();
    let request = |sub| [0, 0x20, 0x40, 0x18, 0x10, sub, 0, 0, 0, 0];
    let mut pending = (1..=4).cycle().take(12).collect::<std::collections::VecDeque<u8>>();
    let mut sent = 0;
    let mut responses = Vec::new();
    while let Some(&sub) = pending.front() {
        if rig.send_counted(COE, sent % 7 + 1, &request(sub)) == 1 {
            sent += 1;
            pending.pop_front();
        } else {
            // Refused while everything is full: that is how the MainDevice is held off.
            responses.push(rig.receive().expect("a response is there"));
        }
    }
    assert!(sent > 3 && responses.len() < 12);
    while let Some(response) = rig.receive() {
        responses.push(response);
    }
    let subs: Vec<u8> = responses.iter().map(|response| response[11]).collect();
    assert_eq!(subs, [1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4], "in order, and all of them");
}

#[test]
fn statement_27_half_a_message_is_not_served() {
    let mut rig = rig();
    let mut message = [0; 128];
    message[..6].copy_from_slice(&[10, 0, 0, 0, 0, COE]);
    message[6..16].copy_from_slice(&UPLOAD);
    assert_eq!(rig.write(0x1000, &message[..127]), 1);
    rig.pass(10);
    assert_eq!(rig.receive(), None);
    assert_eq!(rig.write(0x107f, &[0]), 1);
    assert!(rig.receive().is_some(), "its last byte makes it whole");
}

#[test]
fn statement_28_a_response_goes_to_the_main_device_with_its_exact_length() {
    let mut rig = rig();
    rig.send(&UPLOAD);
    assert_eq!(rig.receive().unwrap()[..6], [10, 0, 0, 0, 0, 0x13]);
    rig.send(&[0, 0x20, 0x40, 0x08, 0x10, 0, 0, 0, 0, 0]);
    let name = rig.receive().unwrap();
    assert_eq!(usize::from(name[0]), name.len() - 6);
    assert_eq!(name[2..5], [0, 0, 0]);
}

#[test]
fn a_mailbox_that_is_switched_off_and_on_ends_in_init() {
    let mut rig = Rig::in_state(&MAILBOX_128, OP);
    rig.write(Channel::MailboxIn.registers() + 6, &[0]);
    assert_eq!(rig.status(), (INIT | 0x10, 0x0016));
}
