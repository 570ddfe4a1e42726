//! Conformance: files (statement 51), by raw messages.

pub(crate) mod client;

use ethercat_subdevice::foe::{FileError, FileErrorCode};

use crate::prelude::*;
use client::*;

#[test]
fn statement_51_files_of_any_length_are_written_and_read_through_mailboxes_of_34_and_128_bytes() {
    for (device, packet) in [(&FILES_34, 22), (&FILES_128, PACKET)] {
        for state in [PRE_OP, SAFE_OP, OP] {
            let mut rig = Rig::in_state(device, state);
            // Op goes on without outputs.
            rig.write(0x0420, &[0, 0]);
            // Multiples of a packet end by an empty one.
            for length in [0, 1, packet - 1, packet, packet + 1, 2 * packet, 1_000] {
                assert_eq!(write(&mut rig, "x.conf", 0, &content(length), packet), None);
                assert_eq!(rig.application().files.stored["x.conf"], content(length), "{length} bytes");
                assert_eq!(read(&mut rig, "x.conf", packet), content(length));
            }
            let application = rig.application();
            assert_eq!((application.files.finished, application.files.aborted), (14, 0));
        }
    }
}

#[test]
fn statement_51_the_name_ends_at_a_zero_and_there_are_longer_ones_than_a_mailbox() {
    let mut rig = rig(PRE_OP);
    assert_eq!(ask(&mut rig, WRITE, 0, b"a.txt\0\0\0"), ack(0));
    assert_eq!(ask(&mut rig, DATA, 1, b"hello"), ack(1));
    assert_eq!(rig.application().files.stored["a.txt"], b"hello");
    let longest = "n".repeat(PACKET);
    assert_eq!(write(&mut rig, &longest, 0, b"1", PACKET), None);
    assert_eq!(rig.application().files.stored[&longest], b"1");
    assert_eq!(code(ask(&mut rig, WRITE, 0, &[0xff, 0xfe])), 0x8001, "it is no text");
}

#[test]
fn statement_51_what_the_application_refuses_has_its_code_and_text() {
    let mut rig = rig(PRE_OP);
    let (_, code_of_missing, text) = ask(&mut rig, READ, 0, b"missing").unwrap();
    assert_eq!((code_of_missing, text), (0x8001, b"no missing".to_vec()));
    assert_eq!(code(write(&mut rig, "firmware", PASSWORD, &[1], PACKET)), 0x8008);
    assert_eq!(code(write(&mut rig, "long", 0, &content(FILE_BYTES_MAX + 1), PACKET)), 0x8003);
    assert_eq!(rig.request(INIT), (INIT, 0));
    assert_eq!(rig.request(BOOT), (BOOT, 0));
    assert_eq!(code(write(&mut rig, "x.conf", 0, &[1], PACKET)), 0x8009);
    assert_eq!(code(write(&mut rig, "firmware", PASSWORD + 1, &[1], PACKET)), 0x800a);
    assert_eq!(rig.application().files.aborted, 0, "it knows of its own refusals");
    assert!(!rig.application().files.is_open());
}

#[test]
fn statement_51_a_refusal_has_as_much_of_its_text_as_a_mailbox_carries() {
    let text = "the image is for another board, and this is a text that goes on and on until it is too long for any mailbox there is, or is it not";
    for (device, packet, carried) in [(&FILES_34, 22, 22), (&FILES_128, PACKET, 96)] {
        let mut rig = Rig::in_state(device, BOOT);
        rig.application().files.unfit = Some(FileError::new(FileErrorCode::InvalidFirmware, text));
        let response = write(&mut rig, "firmware", PASSWORD, &[1], packet).unwrap();
        assert_eq!(response, (ERR, 0x800d, text.as_bytes()[..carried].to_vec()));
    }
}

/// A rig whose file "x" is being written, with one packet acknowledged.
fn writing() -> Rig<Bench> {
    let mut rig = rig(PRE_OP);
    assert_eq!(ask(&mut rig, WRITE, 0, b"x"), ack(0));
    assert_eq!(ask(&mut rig, DATA, 1, &content(PACKET)), ack(1));
    rig
}

/// A rig whose file "x" is being read, with its first packet sent and not acknowledged.
fn reading() -> Rig<Bench> {
    let mut rig = rig(PRE_OP);
    rig.application().files.stored.insert("x".to_owned(), content(3 * PACKET));
    let (operation, number, data) = ask(&mut rig, READ, 0, b"x").unwrap();
    assert_eq!((operation, number, data), (DATA, 1, content(PACKET)));
    rig
}

/// The transfer was given up, and nothing of the file was kept.
fn is_aborted(rig: &mut Rig<Bench>) -> bool {
    let application = rig.application();
    assert_eq!(application.files.finished, 0);
    application.files.aborted == 1 && !application.files.is_open()
}

#[test]
fn statement_51_a_wrong_packet_number_ends_the_transfer() {
    for number in [0, 1, 3, u32::MAX] {
        let mut rig = writing();
        assert_eq!(code(ask(&mut rig, DATA, number, &[1])), 0x8005, "packet {number} behind the first");
        assert!(is_aborted(&mut rig));
        assert_eq!(code(ask(&mut rig, DATA, 2, &[1])), 0x8004, "there is no transfer any more");
    }
    for number in [0, 2, u32::MAX] {
        let mut rig = reading();
        assert_eq!(code(ask(&mut rig, ACK, number, &[])), 0x8005, "acknowledgement {number} of the first");
        assert!(is_aborted(&mut rig));
        assert_eq!(code(ask(&mut rig, ACK, 1, &[])), 0x8004);
    }
}

/// Nothing of the protocol acknowledges it twice: a message that was lost is repeated by the mailbox.
#[test]
fn statement_51_a_packet_that_comes_again_behind_its_acknowledgement_ends_the_transfer() {
    let mut rig = writing();
    assert_eq!(code(ask(&mut rig, DATA, 1, &content(PACKET))), 0x8005);
    assert!(is_aborted(&mut rig));
}

/// Some MainDevices do not acknowledge the last packet.
#[test]
fn statement_51_a_request_behind_the_last_packet_is_served() {
    let mut rig = rig(PRE_OP);
    rig.application().files.stored.insert("x".to_owned(), content(3));
    for _ in 0..2 {
        assert_eq!(ask(&mut rig, READ, 0, b"x"), Some((DATA, 1, content(3))));
    }
}

#[test]
fn statement_51_what_is_not_expected_is_refused() {
    for (operation, number) in [(DATA, 1), (ACK, 0), (BUSY, 0), (0, 0), (7, 0), (0xff, 0)] {
        let mut rig = rig(PRE_OP);
        assert_eq!(
            code(ask(&mut rig, operation, number, &[])),
            0x8004,
            "operation {operation} without a request"
        );
        assert_eq!(rig.application().files.aborted, 0);
    }
    for (operation, number) in [(ACK, 1), (BUSY, 0), (7, 0)] {
        let mut rig = writing();
        assert_eq!(
            code(ask(&mut rig, operation, number, &[])),
            0x8004,
            "operation {operation} while writing"
        );
        assert!(is_aborted(&mut rig));
    }
    let mut rig = reading();
    assert_eq!(code(ask(&mut rig, DATA, 1, &[])), 0x8004, "data while reading");
    assert!(is_aborted(&mut rig));
    for length in 1..6 {
        rig.send_counted(FOE, 0, &[READ, 0, 0, 0, 0, 0][..length]);
        assert_eq!(rig.receive().unwrap()[6..], [1, 0, 6, 0], "{length} bytes are too few");
    }
}

#[test]
fn statement_51_a_transfer_ends_with_an_error_a_second_request_or_the_state() {
    let error = |rig: &mut Rig<Bench>| {
        assert_eq!(ask(rig, ERR, 0x8000, b"given up"), None, "nobody waits for a response");
    };
    let request = |rig: &mut Rig<Bench>| {
        let (_, code_of_second, text) = ask(rig, READ, 0, b"missing").unwrap();
        let text = String::from_utf8(text).unwrap();
        assert_eq!(
            (code_of_second, &*text),
            (0x8004, "another transfer was open, and has ended now: ask again")
        );
        assert_eq!(code(ask(rig, READ, 0, b"missing")), 0x8001, "the next one is served");
    };
    let safe_op = |rig: &mut Rig<Bench>| {
        rig.set_up_process_data();
        assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
        assert_eq!(code(ask(rig, DATA, 2, &[1])), 0x8004);
    };
    let mailbox_off = |rig: &mut Rig<Bench>| {
        rig.write(Channel::MailboxIn.registers() + 6, &[0]);
        assert_eq!(rig.status(), (INIT | ERROR, 0x0016));
    };
    for begin in [writing, reading] {
        let ends: [fn(&mut Rig<Bench>); 4] = [error, request, safe_op, mailbox_off];
        for end in ends {
            let mut rig = begin();
            end(&mut rig);
            assert!(is_aborted(&mut rig));
        }
    }
}

#[test]
fn statement_51_a_transfer_is_given_up_after_ten_seconds_without_a_message() {
    for begin in [writing, reading] {
        let mut rig = begin();
        rig.pass(9_800);
        assert_eq!(rig.application().files.aborted, 0);
        rig.pass(300);
        assert!(is_aborted(&mut rig));
    }
    // Nor does a response that nobody takes keep it.
    let mut rig = rig(PRE_OP);
    send(&mut rig, WRITE, 0, b"x");
    rig.pass(10_100);
    assert!(is_aborted(&mut rig));
}

#[test]
fn statement_51_a_response_that_was_lost_is_repeated_and_a_packet_is_written_once() {
    let mut rig = rig(PRE_OP);
    send_counted(&mut rig, 1, WRITE, 0, b"x");
    assert_eq!(received(&mut rig), ack(0));
    send_counted(&mut rig, 2, DATA, 1, &content(PACKET));
    assert_eq!(received(&mut rig), ack(1));
    // By the repeat bit, and by the counter of the message that was written again.
    assert_eq!(rig.write(0x080e, &[3]), 1);
    assert_eq!(received(&mut rig), ack(1));
    send_counted(&mut rig, 2, DATA, 1, &content(PACKET));
    assert_eq!(received(&mut rig), None);
    send_counted(&mut rig, 3, DATA, 2, b"end");
    assert_eq!(received(&mut rig), ack(2));
    let whole = [&content(PACKET)[..], b"end"].concat();
    let files = &rig.application().files;
    assert_eq!((files.writes, &files.stored["x"]), (2, &whole));
}

#[test]
fn statement_51_slow_flash_makes_the_device_busy_and_the_packet_is_sent_again() {
    let mut rig = rig(PRE_OP);
    rig.application().files.delay = Duration::from_millis(350);
    send(&mut rig, WRITE, 0, b"x");
    rig.pass(150);
    assert_eq!(received(&mut rig), None, "there is nothing to send again yet");
    rig.pass(250);
    assert_eq!(received(&mut rig), ack(0));
    for (number, data) in [(1, &content(PACKET)[..]), (2, b"end")] {
        let mut busy = 0;
        let response = loop {
            send(&mut rig, DATA, number, data);
            let mut waited = 0;
            let response = loop {
                match received(&mut rig) {
                    Some(response) => break response,
                    None => rig.pass(5),
                }
                waited += 5;
                assert!(waited <= 110, "it says so after a while");
            };
            match response {
                (BUSY, ..) => busy += 1,
                response => break Some(response),
            }
            assert!(waited >= 80, "but not sooner: {waited} ms");
        };
        // The last one is stored, and then finished.
        let expected = if number == 1 { 3 } else { 6 };
        assert_eq!((busy, response), (expected, ack(number)));
    }
    let whole = [&content(PACKET)[..], b"end"].concat();
    let files = &rig.application().files;
    assert_eq!((files.writes, &files.stored["x"]), (2, &whole));
}

#[test]
fn statement_51_another_packet_while_the_device_is_busy_ends_the_transfer() {
    for pause in [10, 200] {
        let mut rig = writing();
        rig.application().files.delay = Duration::from_secs(1);
        send(&mut rig, DATA, 2, &content(PACKET));
        rig.pass(pause);
        let told = if pause > 100 { BUSY } else { ERR };
        assert!(received(&mut rig).is_none_or(|(operation, ..)| operation == told));
        assert_eq!(code(ask(&mut rig, DATA, 3, &content(PACKET))), 0x8005);
        assert!(is_aborted(&mut rig));
    }
}

#[test]
fn statement_51_an_empty_last_packet_is_answered_when_the_file_is_finished_and_never_by_busy() {
    let mut rig = writing();
    rig.application().files.delay = Duration::from_millis(900);
    send(&mut rig, DATA, 2, &[]);
    rig.pass(890);
    assert_eq!(received(&mut rig), None);
    rig.pass(20);
    assert_eq!(received(&mut rig), ack(2));
}

#[test]
fn statement_51_a_busy_main_device_gets_its_packet_again() {
    let mut rig = reading();
    for _ in 0..3 {
        assert_eq!(ask(&mut rig, BUSY, 1 << 16, &[]), Some((DATA, 1, content(PACKET))));
    }
    assert_eq!(ask(&mut rig, ACK, 1, &[]), Some((DATA, 2, content(2 * PACKET)[PACKET..].to_vec())));
}

#[test]
fn statement_51_objects_are_served_between_the_packets_of_a_file() {
    let mut rig = writing();
    rig.application().files.delay = Duration::from_millis(50);
    send(&mut rig, DATA, 2, b"end");
    assert!(rig.upload(0x1000, 0).is_ok(), "while a packet is stored");
    rig.pass(120);
    assert_eq!(received(&mut rig), ack(2));
}

#[test]
fn random_file_messages_never_stop_the_device() {
    each_seed(40, |seed| {
        let mut random = Random::new(seed);
        let mut rig = rig([PRE_OP, BOOT][random.index(2)]);
        let name: &[u8] = if rig.status().0 == BOOT { b"firmware" } else { b"x" };
        for _ in 0..300 {
            rig.application().files.delay = Duration::from_millis([0, 0, 0, 5, 150][random.index(5)]);
            let operation = if random.chance(0.05) { random.byte() } else { random.within(1..=6) as u8 };
            let number = match operation {
                READ | WRITE => PASSWORD,
                _ if random.chance(0.1) => random.within(0..=u64::from(u32::MAX)) as u32,
                _ => random.within(0..=4) as u32,
            };
            let length = [0, 1, PACKET, random.index(PACKET)][random.index(4)];
            let data: Vec<u8> = match operation {
                READ | WRITE if random.chance(0.9) => name.to_vec(),
                _ => (0..length).map(|_| random.byte()).collect(),
            };
            let payload = [&[operation, 0], &number.to_le_bytes()[..], &data].concat();
            let cut = if random.chance(0.1) { random.index(payload.len()) } else { payload.len() };
            rig.send_counted(FOE, random.within(0..=7) as u8, &payload[..cut]);
            rig.pass(random.within(0..=4));
            if random.chance(0.9)
                && let Some(message) = rig.receive()
            {
                let known =
                    matches!((message[5] & 0x0f, message[6]), (FOE, DATA | ACK | ERR | BUSY) | (0, 1));
                assert!(known, "seed {seed}: {message:02x?}");
            }
        }
        // A MainDevice that means it, and ends what it has begun before.
        rig.application().files.delay = Duration::from_ticks(0);
        while rig.receive().is_some() {
            rig.pass(200);
        }
        assert_eq!(ask(&mut rig, ERR, 0x8000, &[]), None);
        let name = str::from_utf8(name).unwrap();
        assert_eq!(write(&mut rig, name, PASSWORD, &content(500), PACKET), None, "seed {seed}");
        assert_eq!(rig.application().files.stored[name], content(500), "seed {seed}");
    });
}
