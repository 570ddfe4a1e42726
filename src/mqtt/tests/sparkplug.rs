//! Payloads of Sparkplug, compared with what protobuf 7.36 of Python makes of the message `Payload` of the specification (6.4.1).

use std::vec::Vec;

use proptest::prelude::*;

use super::super::sparkplug::{DataType, Metric, Quality, Value, metrics};
use super::super::{LongPacket, Message, Qos, Version, Writer, publish_into};
use super::std;

/// When the payloads are sent.
const SENT: u64 = 1_795_796_562_123;

/// A value of each type, stale ones and an unknown one; number 0.
const BIRTH: &str = "\
    08cbe1c3eea13412120a05626453657118cbe1c3eea1342004580712210a144e6f646520436f6e74726f6c2f5265626972746818cbe1c3eea134200b\
    700012260a05636f756e7418cae1c3eea13420064a100a075175616c6974791205080318c00150ffff0312280a076c6576656c2f3018cae1c3eea134\
    20024a100a075175616c6974791205080318c00150f6ff0312260a076c6576656c2f3118cae1c3eea13420024a100a075175616c6974791205080318\
    c001500c12280a05746f74616c18c9e1c3eea13420074a100a075175616c6974791205080318f40350ffffffff0f12280a05647269667418c9e1c3ee\
    a13420034a100a075175616c6974791205080318f40350feffffff0f122e0a06656e6572677918cbe1c3eea13420084a100a075175616c6974791205\
    080318c00158ffffffffffffffffff01122f0a0762616c616e636518cbe1c3eea13420044a100a075175616c6974791205080318c00158fdffffffff\
    ffffffff0112270a05706f77657218cbe1c3eea13420094a100a075175616c6974791205080318c001650000ac41122c0a067761726d746818cbe1c3\
    eea134200a4a100a075175616c6974791205080318c001699a9999999999b9bf12220a0372756e18cbe1c3eea134200b4a100a075175616c69747912\
    05080318c0017001122a0a056c6162656c18cbe1c3eea134200c4a100a075175616c6974791205080318c0017a0650756d70203712220a04676f6e65\
    18cbe1c3eea134200a38014a0f0a075175616c6974791204080318001800";

/// Only the number of the connection, 255.
const DEATH: &str = "\
    120c0a056264536571200458ff01";

/// Values of each type with and without their type, a negative number of 16 bits in two's complement, a null, one with all other fields, one
/// without a name, bytes.
const COMMAND: &str = "\
    08cbe1c3eea134121a0a144e6f646520436f6e74726f6c2f52656269727468200b700112120a056c696d697418cbe1c3eea13420065011120f0a076c\
    6576656c2f31200250fbff0312160a0762616c616e6365200458f7ffffffffffffffff01120c0a05706f776572650000a03f12110a067761726d7468\
    6900000000004044c0120d0a056c6162656c7a04c3a42062120d0a076e6f7468696e672006380112280a046d6f726510ac0228013000420518094201\
    644a100a075175616c6974791205080318c0015001120410055002120c0a05627974657382010201022201752a01ff";

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.chars().filter_map(|char| char.to_digit(16)).map(|digit| digit as u8).collect();
    digits.as_chunks().0.iter().map(|[high, low]| high << 4 | low).collect()
}

/// The payload that `write` writes.
fn written(write: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let message = Message {
        version: Version::V3,
        qos: Qos::Once,
        retained: false,
        topic: format_args!("t"),
        correlation: &[],
    };
    let mut packet = LongPacket::new();
    assert!(publish_into(&mut packet, &message, |out| {
        write(out);
        Ok(())
    }));
    let lengths = packet.iter().skip(1).take_while(|byte| **byte >= 0x80).count() + 1;
    // The first byte, the length and the topic.
    packet.iter().skip(1 + lengths + 3).copied().collect()
}

/// Name, age in milliseconds, type, quality, value.
type Row = (&'static str, u64, DataType, Option<Quality>, Option<Value<&'static str>>);

#[test]
fn a_birth_certificate_is_as_another_encoder_writes_it() {
    let rows: [Row; 14] = [
        ("bdSeq", 0, DataType::Int64, None, Some(Value::Long(7))),
        ("Node Control/Rebirth", 0, DataType::Boolean, None, Some(Value::Boolean(false))),
        ("count", 1, DataType::UInt16, Some(Quality::Good), Some(Value::Int(65_535))),
        ("level/0", 1, DataType::Int16, Some(Quality::Good), Some(Value::Int(65_526))),
        ("level/1", 1, DataType::Int16, Some(Quality::Good), Some(Value::Int(12))),
        ("total", 2, DataType::UInt32, Some(Quality::Stale), Some(Value::Int(u32::MAX))),
        ("drift", 2, DataType::Int32, Some(Quality::Stale), Some(Value::Int(-2_i32 as u32))),
        ("energy", 0, DataType::UInt64, Some(Quality::Good), Some(Value::Long(u64::MAX))),
        ("balance", 0, DataType::Int64, Some(Quality::Good), Some(Value::Long(-3_i64 as u64))),
        ("power", 0, DataType::Float, Some(Quality::Good), Some(Value::Float(21.5))),
        ("warmth", 0, DataType::Double, Some(Quality::Good), Some(Value::Double(-0.1))),
        ("run", 0, DataType::Boolean, Some(Quality::Good), Some(Value::Boolean(true))),
        ("label", 0, DataType::String, Some(Quality::Good), Some(Value::String("Pump 7"))),
        ("gone", 0, DataType::Double, Some(Quality::Bad), None),
    ];
    let made = written(|out| {
        out.timestamp(SENT);
        for (name, age, kind, quality, value) in &rows {
            let value = value.as_ref().map(|value| match value {
                Value::String(text) => Value::String(text as &dyn std::fmt::Display),
                Value::Int(value) => Value::Int(*value),
                Value::Long(value) => Value::Long(*value),
                Value::Float(value) => Value::Float(*value),
                Value::Double(value) => Value::Double(*value),
                Value::Boolean(value) => Value::Boolean(*value),
            });
            let (timestamp, kind, quality) = (Some(SENT - age), Some(*kind), *quality);
            out.metric(&Metric { name, timestamp, kind, quality, value });
        }
        out.seq(0);
    });
    assert_eq!(made, bytes(BIRTH));
}

#[test]
fn a_death_certificate_is_as_another_encoder_writes_it() {
    let made = written(|out| {
        let (kind, value) = (Some(DataType::Int64), Some(Value::Long(255)));
        out.metric(&Metric { name: &"bdSeq", timestamp: None, kind, quality: None, value });
    });
    assert_eq!(made, bytes(DEATH));
}

#[test]
fn a_command_of_another_encoder_is_understood() {
    let mut seen = Vec::new();
    let command = bytes(COMMAND);
    metrics(&command, &mut |name, value| seen.push((name, value))).unwrap();
    assert_eq!(
        seen,
        [
            ("Node Control/Rebirth", Value::Boolean(true)),
            ("limit", Value::Int(17)),
            ("level/1", Value::Int(65_531)),
            ("balance", Value::Long(-9_i64 as u64)),
            ("power", Value::Float(1.25)),
            ("warmth", Value::Double(-40.5)),
            ("label", Value::String("ä b")),
            ("more", Value::Int(1)),
        ]
    );
    // Cut anywhere, it is another payload or none, never a panic.
    for end in 0..command.len() {
        let _ = metrics(&command[..end], &mut |_, _| {});
    }
}

#[test]
fn what_is_no_payload_is_refused() {
    for wrong in [
        // No end of a number, a length beyond the end, groups, a name that is no text, a name that is cut.
        &[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01][..],
        &[0x12, 0x05, 0x0a],
        &[0x0b, 0x0c],
        &[0x12, 0x03, 0x0a, 0x01, 0xff],
        &[0x12, 0x02, 0x0a, 0x01],
    ] {
        assert!(metrics(wrong, &mut |_, _| {}).is_err(), "{wrong:02x?}");
    }
}

#[test]
fn what_does_not_fit_leaves_nothing_behind() {
    let text = "x".repeat(1_000);
    let metric = || {
        let value = Some(Value::String(&text as &dyn std::fmt::Display));
        Metric { name: &"label", timestamp: Some(SENT), kind: None, quality: None, value }
    };
    let mut count = 0;
    let full = written(|out| {
        while out.attempt(3, |out| out.metric(&metric())) {
            count += 1;
        }
        out.seq(255);
    });
    let whole = written(|out| {
        (0..count).for_each(|_| out.metric(&metric()));
        out.seq(255);
    });
    assert!(count > 1 && full == whole);
}

proptest! {
    #[test]
    fn any_bytes_of_a_command_end_in_no_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = metrics(&bytes, &mut |_, _| {});
    }

    /// What is written is read as it was, whatever the lengths are.
    #[test]
    fn values_are_read_as_they_were_written(
        rows in prop::collection::vec(("[ -~é]{0,300}", any::<u32>(), any::<u64>(), any::<f64>(), any::<bool>()), 0..20),
    ) {
        let mut expected = Vec::new();
        let made = written(|out| {
            for (text, int, long, double, boolean) in &rows {
                let mut one = |value: Value<&'static str>| {
                    let same = match value {
                        Value::Int(value) => Value::Int(value),
                        Value::Long(value) => Value::Long(value),
                        Value::Double(value) => Value::Double(value),
                        Value::Boolean(value) => Value::Boolean(value),
                        Value::Float(_) | Value::String(_) => return,
                    };
                    let (timestamp, kind) = (Some(*long), Some(DataType::Int16));
                    out.metric(&Metric { name: text, timestamp, kind, quality: Some(Quality::Stale), value: Some(same) });
                    expected.push((text.as_str(), value));
                };
                one(Value::Int(*int));
                one(Value::Long(*long));
                one(Value::Double(*double));
                one(Value::Boolean(*boolean));
            }
        });
        let mut seen = Vec::new();
        metrics(&made, &mut |name, value| seen.push((name, value))).unwrap();
        prop_assert_eq!(seen, expected);
    }
}
