//! Packets written by hand after the OASIS standards, and any packets.

extern crate std;

mod sparkplug;

use core::fmt::Write as _;
use std::format;
use std::string::String;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;

fn hello(version: Version) -> Packet {
    hello_as(version, false).unwrap_or_default()
}

/// For Sparkplug: a clean session, and a will that is not retained.
fn hello_as(version: Version, is_clean: bool) -> Option<Packet> {
    connect(&Connect {
        version,
        client: format_args!("m-p"),
        user: "u",
        password: "pw",
        keep_alive: 30,
        is_clean,
        will: Will {
            topic: format_args!("m/p/status"),
            write: &|out| out.write_str("offline"),
            retained: !is_clean,
        },
    })
}

/// 3.1.1, 3.1: name, level 4, flags (user, password, retained will at QoS 1), keep alive, client, will, user, password.
#[test]
fn connect_of_3_1_1() {
    let mut expected = Vec::from([0x10, 0x2f, 0, 4, b'M', b'Q', b'T', b'T', 4, 0b1110_1100, 0, 30]);
    for text in ["m-p", "m/p/status", "offline", "u", "pw"] {
        expected.extend([0, text.len() as u8]);
        expected.extend(text.bytes());
    }
    expected[1] = (expected.len() - 2) as u8;
    assert_eq!(hello(Version::V3)[..], expected[..]);
}

/// 5, 3.1: level 5, session expiry (11h) of a day, maximum packet size (27h) of 1024, no properties of the will.
#[test]
fn connect_of_5() {
    let mut expected = Vec::from([0x10, 0, 0, 4, b'M', b'Q', b'T', b'T', 5, 0b1110_1100, 0, 30, 10]);
    expected.extend([0x11, 0, 1, 0x51, 0x80, 0x27, 0, 0, 4, 0, 0, 3]);
    expected.extend(b"m-p\0");
    for text in ["m/p/status", "offline", "u", "pw"] {
        expected.extend([0, text.len() as u8]);
        expected.extend(text.bytes());
    }
    expected[1] = (expected.len() - 2) as u8;
    assert_eq!(hello(Version::V5)[..], expected[..]);
}

/// 3.1.2.4 and 5, 3.1.2.11.2: clean session (02h) and no retained will (20h), or a session expiry of 0.
#[test]
fn a_clean_session_is_forgotten_when_the_connection_ends() {
    assert_eq!(hello_as(Version::V3, true).unwrap()[9], 0b1100_1110);
    let five = hello_as(Version::V5, true).unwrap();
    assert_eq!((five[9], &five[12..18]), (0b1100_1110, &[10, 0x11, 0, 0, 0, 0][..]));
}

#[test]
fn publish_has_topic_id_and_properties_before_its_payload() {
    let message = |version, correlation| Message {
        version,
        qos: Qos::Acknowledged(0x0102),
        retained: true,
        topic: format_args!("a/b"),
        correlation,
    };
    let made = |message: &Message<'_>| publish(message, |out| out.write_str("17")).unwrap();
    assert_eq!(made(&message(Version::V3, &[])), *b"\x33\x09\0\x03a/b\x01\x0217");
    assert_eq!(made(&message(Version::V5, &[])), *b"\x33\x0a\0\x03a/b\x01\x02\x0017");
    // Correlation data (09h) with its length.
    assert_eq!(made(&message(Version::V5, b"xy")), *b"\x33\x0f\0\x03a/b\x01\x02\x05\x09\0\x02xy17");
    let plain = Message { retained: false, ..message(Version::V3, &[]) };
    assert_eq!(made(&plain)[0], 0x32);
    // At most once it has no id.
    assert_eq!(made(&Message { qos: Qos::Once, ..plain }), *b"\x30\x07\0\x03a/b17");
}

/// 2.2.3: 127 bytes need one byte of remaining length, 128 two: 80h 01h, and 16384 three: 80h 80h 01h.
#[test]
fn the_remaining_length_has_as_few_bytes_as_possible() {
    let of = |count: usize| {
        let message = Message {
            version: Version::V3,
            qos: Qos::Acknowledged(1),
            retained: false,
            topic: format_args!("t"),
            correlation: &[],
        };
        let mut long = LongPacket::new();
        let text = "x".repeat(count);
        let fits = publish_into(&mut long, &message, |out| out.write_str(&text));
        let short = publish(&message, |out| out.write_str(&text));
        assert_eq!(short.is_some(), count + 9 <= PACKET_BYTES_MAX);
        fits.then_some(long)
    };
    assert_eq!(of(122).unwrap()[..4], [0x32, 127, 0, 1]);
    assert_eq!(of(123).unwrap()[..5], [0x32, 0x80, 0x01, 0, 1]);
    assert_eq!(of(16_378).unwrap()[..4], [0x32, 0xff, 0x7f, 0]);
    assert_eq!(of(16_379).unwrap()[..5], [0x32, 0x80, 0x80, 0x01, 0]);
    assert!(of(LONG_PACKET_BYTES_MAX - 9).is_some());
    assert_eq!(of(LONG_PACKET_BYTES_MAX - 8), None);
}

#[test]
fn subscribe_asks_for_its_qos_and_for_nothing_that_was_retained() {
    let filter = format_args!("m/+");
    assert_eq!(subscribe(Version::V3, 0xffff, filter, false).unwrap(), *b"\x82\x08\xff\xff\0\x03m/+\0");
    assert_eq!(subscribe(Version::V5, 0xffff, filter, true).unwrap(), *b"\x82\x09\xff\xff\0\0\x03m/+\x21");
}

fn one(version: Version, bytes: &[u8]) -> String {
    let mut inbox = Inbox::new();
    inbox.room()[..bytes.len()].copy_from_slice(bytes);
    inbox.arrived(bytes.len());
    format!("{:?}", inbox.next(version))
}

#[test]
fn what_a_broker_sends_is_understood() {
    let accepted = |text: &str| assert!(text.contains("has_session: true"), "{text}");
    accepted(&one(Version::V3, &[0x20, 2, 1, 0]));
    // Receive maximum (21h) 5, maximum QoS (24h) 0, no retained messages (25h), packets (27h) up to 256, keep alive (13h) 10.
    let five = [0x20, 18, 1, 0, 15, 0x21, 0, 5, 0x24, 0, 0x25, 0, 0x27, 0, 0, 1, 0, 0x13, 0, 10];
    let text = one(Version::V5, &five);
    accepted(&text);
    for part in [
        "receive_max: 5,",
        "takes_qos_1: false",
        "retains: false",
        "packet_max: 256,",
        "keep_alive: Some(10)",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    for (version, bytes, expected) in [
        (Version::V3, &[0x20, 2, 0, 5][..], "Connected(Err(5))"),
        (Version::V5, &[0x20, 3, 0, 0x87, 0], "Connected(Err(135))"),
        (Version::V3, &[0x40, 2, 1, 2], "Acknowledged { id: 258, reason: 0 }"),
        (Version::V5, &[0x40, 3, 1, 2, 0x97], "Acknowledged { id: 258, reason: 151 }"),
        (Version::V5, &[0x40, 4, 1, 2, 0x10, 0], "Acknowledged { id: 258, reason: 16 }"),
        (Version::V3, &[0x90, 3, 0xff, 0xff, 0x80], "Subscribed { reason: 128 }"),
        (Version::V5, &[0x90, 4, 0xff, 0xff, 0, 0], "Subscribed { reason: 0 }"),
        (Version::V3, &[0xd0, 0], "Pong"),
        (Version::V5, &[0xe0, 1, 0x8b], "Disconnected { reason: 139 }"),
        (Version::V5, &[0xe0, 0], "Disconnected { reason: 0 }"),
        (Version::V3, b"\x32\x07\0\x01t\x01\x0217", "id: Some(258)"),
        (Version::V3, b"\x30\x05\0\x01t17", "id: None"),
        // Not for a client, a message that comes exactly once, no end of a length, an unknown property, cut.
        (Version::V3, &[0x10, 0], "Malformed"),
        (Version::V3, b"\x34\x07\0\x01t\0\x0117", "Malformed"),
        (Version::V3, &[0x30, 0xff, 0xff, 0xff, 0xff, 1], "Malformed"),
        (Version::V5, &[0x20, 5, 0, 0, 2, 0x7f, 0], "Malformed"),
        (Version::V3, &[0x40, 1, 1], "Malformed"),
    ] {
        let text = one(version, bytes);
        assert!(text.contains(expected), "{bytes:02x?}: {text}");
    }
}

#[test]
fn a_command_tells_where_its_response_goes() {
    // Response topic (08h) and correlation data (09h), between them a user property (26h).
    let bytes = b"\x30\x1a\0\x03a/b\x12\x08\0\x03r/t\x26\0\x01k\0\x01v\x09\0\x01c17";
    let mut bytes = Vec::from(*bytes);
    bytes[7] = (3 + 3) + (1 + 3 + 3) + (1 + 2 + 1);
    bytes[1] = (bytes.len() - 2) as u8;
    let text = one(Version::V5, &bytes);
    for part in ["topic: \"a/b\"", "payload: [49, 55]", "retained: false", "topic: \"r/t\"", "[99]"] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    let mut long = Vec::from(*b"\x31\0\0\x03a/b\x00\x09\0\x42");
    long.extend([7; 66]);
    long[7] = 1 + 2 + 66;
    long[1] = (long.len() - 2) as u8;
    let text = one(Version::V5, &long);
    assert!(text.contains("retained: true") && text.contains("reply: None"), "{text}");
}

#[test]
fn a_packet_that_is_too_long_is_passed_over() {
    let mut bytes = Vec::from([0x30, 0xd0, 0x0f, 0, 1, b't']);
    bytes.extend([b'x'; 2000 - 3]);
    bytes.extend([0xd0, 0, 0x40, 2, 0, 7]);
    let mut inbox = Inbox::new();
    let mut seen = Vec::new();
    for piece in bytes.chunks(100) {
        inbox.room()[..piece.len()].copy_from_slice(piece);
        inbox.arrived(piece.len());
        while let Some(received) = inbox.next(Version::V3).unwrap() {
            seen.push(format!("{received:?}"));
        }
    }
    assert_eq!(seen, ["Pong", "Acknowledged { id: 7, reason: 0 }"]);
}

proptest! {
    /// What one side writes the other reads, however it is cut, with packets of others between.
    #[test]
    fn messages_come_through_in_any_pieces(
        five in any::<bool>(),
        messages in prop::collection::vec(("[a-z/]{1,40}", "[ -~é]{0,200}"), 1..20),
        cuts in prop::collection::vec(1..300_usize, 1..40),
    ) {
        let version = if five { Version::V5 } else { Version::V3 };
        let mut bytes = Vec::new();
        for (topic, payload) in &messages {
            let message =
                Message { version, qos: Qos::Acknowledged(1), retained: true, topic: format_args!("{topic}"), correlation: b"c" };
            let packet = publish(&message, |out| out.write_str(payload)).unwrap();
            // As a broker passes it on: at most once, so without the id.
            let count = 2 + topic.len() + 2 + if five { 5 } else { 0 } + payload.len();
            let mut rest = Vec::from(&packet[packet.len() - count..]);
            rest.drain(2 + topic.len()..4 + topic.len());
            bytes.push(0x31);
            let length = rest.len();
            if length < 128 {
                bytes.push(length as u8);
            } else {
                bytes.extend([length as u8 | 0x80, (length >> 7) as u8]);
            }
            bytes.extend(rest);
            bytes.extend(PING.map(|byte| if byte == PING[0] { 0xd0 } else { byte }));
        }
        let (mut inbox, mut seen, mut at, mut pongs) = (Inbox::new(), Vec::new(), 0, 0);
        for cut in cuts.iter().cycle() {
            let room = inbox.room();
            let count = (*cut).min(bytes.len() - at).min(room.len());
            room[..count].copy_from_slice(&bytes[at..at + count]);
            inbox.arrived(count);
            at += count;
            while let Some(received) = inbox.next(version).unwrap() {
                match received {
                    Received::Message { topic, payload, .. } => {
                        seen.push((String::from(topic), String::from_utf8(Vec::from(payload)).unwrap()));
                    }
                    other => {
                        prop_assert_eq!(other, Received::Pong);
                        pongs += 1;
                    }
                }
            }
            if at == bytes.len() {
                break;
            }
        }
        prop_assert_eq!(&seen, &messages);
        prop_assert_eq!(pongs, messages.len());
    }

    #[test]
    fn any_bytes_end_in_no_panic(five in any::<bool>(), bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
        let version = if five { Version::V5 } else { Version::V3 };
        let mut inbox = Inbox::new();
        for piece in bytes.chunks(97) {
            let room = inbox.room();
            prop_assert!(!room.is_empty());
            let count = piece.len().min(room.len());
            room[..count].copy_from_slice(&piece[..count]);
            inbox.arrived(count);
            loop {
                match inbox.next(version) {
                    Ok(Some(_)) => {}
                    Ok(None) => break,
                    Err(Malformed) => return Ok(()),
                }
            }
        }
    }
}
