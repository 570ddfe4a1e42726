//! Publishers as edge nodes of Sparkplug: births, changes, deaths and commands.

use mobgate::gateway::date::Date;
use mobgate_simulator::broker::{Broker, Published};
use mobgate_simulator::sparkplug::{Metric, Payload, Value, command};

use super::{LONG, published_by, set, shown};
use crate::prelude::*;

const NODE: &str = "format sparkplug topic Site";
const BIRTH: &str = "spBv1.0/Site/NBIRTH/plant";
const DATA: &str = "spBv1.0/Site/NDATA/plant";
const COMMAND: &str = "spBv1.0/Site/NCMD/plant";
const REBIRTH: &str = "Node Control/Rebirth";

/// Milliseconds since 1970 when the gateway started.
const START: u64 = 1_795_796_562_000;
/// Numbers of types: UInt16, Boolean.
const UINT16: u64 = 6;
const BOOLEAN: u64 = 11;

fn node(more: &str, scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device, &Broker)) {
    let calendar = |at: Instant| Some(Date(1_000 * START + at.as_micros()));
    published_by(calendar, &format!("{NODE} {more}"), scenario);
}

/// All messages from `from` on, with their payloads.
fn since(broker: &Broker, from: usize) -> Vec<(Published, Payload)> {
    let all = broker.published().into_iter().skip(from);
    all.map(|message| (message.clone(), Payload::of(&message.payload))).collect()
}

/// The only message since then, which must be of this topic.
fn only(broker: &Broker, from: usize, topic: &str) -> Payload {
    let mut messages = since(broker, from);
    assert_eq!(messages.len(), 1, "{messages:?}");
    let (message, payload) = messages.remove(0);
    assert_eq!((&message.topic[..], message.retained), (topic, false));
    payload
}

fn long(payload: &Payload, name: &str) -> u64 {
    match payload.metric(name).and_then(|metric| metric.value.clone()) {
        Some(Value::Long(value)) => value,
        other => panic!("{name}: {other:?}"),
    }
}

fn dead(broker: &Broker, nth: usize) -> u64 {
    let will = &broker.wills()[nth];
    assert_eq!(will.topic, "spBv1.0/Site/NDEATH/plant");
    let payload = Payload::of(&will.payload);
    assert_eq!((payload.names(), payload.seq), (vec!["bdSeq"], None));
    long(&payload, "bdSeq")
}

#[test]
fn a_birth_tells_all_points_and_then_each_change_comes_at_once_under_the_next_number() {
    for version in ["5", "3.1.1"] {
        node(&format!("version {version}"), |world, _, device, broker| {
            assert_eq!(broker.filters(), [COMMAND]);
            let (first, birth) = since(broker, 0).remove(0);
            assert_eq!((&first.topic[..], first.retained, birth.seq), (BIRTH, false, Some(0)));
            assert_eq!(birth.names(), ["bdSeq", REBIRTH, "count", "limit", "fixed"]);
            assert_eq!((long(&birth, "bdSeq"), dead(broker, 0)), (0, 0));
            let rebirth = birth.metric(REBIRTH).unwrap();
            assert_eq!((rebirth.datatype, &rebirth.value), (Some(BOOLEAN), &Some(Value::Boolean(false))));
            let date = |at: Instant| START + at.as_millis();
            let late = date(first.at) - birth.timestamp.unwrap();
            assert!(late <= 10, "{late} ms on its way");
            assert!(birth.metrics.iter().all(|metric| metric.timestamp.is_some()));
            assert!(birth.metrics.iter().all(|metric| metric.datatype.is_some()));
            let mut seq = since(broker, 0).last().unwrap().1.seq.unwrap();
            for value in 2..300 {
                let (begin, from) = (date(Instant::now()), broker.published().len());
                set(device, 0, value as u8);
                // One poll, and 10 ms.
                world.run_for(110 * MS);
                let data = only(broker, from, DATA);
                seq = (seq + 1) % 256;
                assert_eq!((data.seq, data.names()), (Some(seq), vec!["count"]));
                let count = data.metric("count").unwrap();
                assert_eq!(count.value, Some(Value::Int(value % 256)));
                assert_eq!((count.datatype, count.quality), (None, Some(192)));
                let read = count.timestamp.unwrap();
                assert!((begin..=data.timestamp.unwrap()).contains(&read), "{read}");
            }
            let from = broker.published().len();
            world.run_for(600 * SECOND);
            assert!(since(broker, from).is_empty() && broker.pings() > 0, "nothing changes");
        });
    }
}

#[test]
fn a_host_gets_another_birth_under_the_same_connection_and_a_new_connection_has_the_next_number() {
    node("", |world, rig, device, broker| {
        set(device, 0, 2);
        world.run_for(SECOND);
        let from = broker.published().len();
        // Whatever `commands` says.
        broker.command(COMMAND, command(&[(REBIRTH, Value::Boolean(false))]));
        world.run_for(SECOND);
        assert!(since(broker, from).is_empty());
        broker.command(COMMAND, command(&[(REBIRTH, Value::Boolean(true))]));
        world.run_for(SECOND);
        let birth = only(broker, from, BIRTH);
        assert_eq!((birth.seq, long(&birth, "bdSeq")), (Some(0), 0));
        assert_eq!(birth.metric("count").unwrap().value, Some(Value::Int(2)));
        set(device, 0, 3);
        world.run_for(SECOND);
        assert_eq!(only(broker, from + 1, DATA).seq, Some(1));
        for nth in 1..=3 {
            rig.network.set_unreachable(address(super::BROKER), true);
            broker.hang_up();
            world.run_for(SECOND);
            set(device, 0, 10 + nth);
            world.run_for(5 * SECOND);
            let from = broker.published().len();
            rig.network.set_unreachable(address(super::BROKER), false);
            world.run_for(60 * SECOND);
            // The newest values are in it.
            let birth = only(broker, from, BIRTH);
            assert_eq!((birth.seq, long(&birth, "bdSeq")), (Some(0), u64::from(nth)));
            assert_eq!(dead(broker, nth.into()), u64::from(nth));
            assert_eq!(birth.metric("count").unwrap().value, Some(Value::Int(10 + u32::from(nth))));
        }
        // Attempts that did not get through have no number, so it is one of each connection.
        assert_eq!(broker.wills().len(), 4);
    });
}

#[test]
fn other_points_lead_to_a_death_that_is_told_and_another_birth() {
    node("", |world, rig, _, broker| {
        let from = broker.published().len();
        world.run_until(typed(rig.gateway, "point more plc holding 8 count 2 as i16 read 100ms"));
        world.run_for(5 * SECOND);
        let (message, death) = since(broker, from).remove(0);
        assert_eq!((&message.topic[..], message.retained), ("spBv1.0/Site/NDEATH/plant", false));
        assert_eq!((death.names(), death.seq, long(&death, "bdSeq")), (vec!["bdSeq"], None, 0));
        let (message, birth) = since(broker, from).remove(1);
        assert_eq!((&message.topic[..], birth.seq, long(&birth, "bdSeq")), (BIRTH, Some(0), 1));
        assert_eq!(birth.names(), ["bdSeq", REBIRTH, "count", "limit", "fixed", "more/0", "more/1"]);
    });
}

#[test]
fn a_silent_device_makes_its_values_stale_under_their_own_time_and_one_never_read_is_null() {
    node("", |world, rig, device, broker| {
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        let (cut, from) = (START + Instant::now().as_millis(), broker.published().len());
        world.run_for(40 * SECOND);
        let data = since(broker, from);
        let count = data.iter().find_map(|(_, payload)| payload.metric("count")).unwrap();
        assert_eq!((count.quality, &count.value), (Some(500), &Some(Value::Int(1))));
        assert!(count.timestamp.unwrap() <= cut + 1, "{count:?}");
        world.run_until(typed(rig.gateway, "point never plc holding 9 read 100ms"));
        world.run_for(5 * SECOND);
        let data = since(broker, from);
        let (_, birth) = data.iter().rfind(|(message, _)| message.topic == BIRTH).unwrap();
        let never = birth.metric("never").unwrap();
        let Metric { is_null, quality, datatype, .. } = *never;
        assert_eq!((is_null, quality, datatype), (true, Some(0), Some(UINT16)));
        let from = broker.published().len();
        device.set_faults(Faults::new(1));
        world.run_for(60 * SECOND);
        let data = since(broker, from);
        let count = data.iter().rev().find_map(|(_, payload)| payload.metric("count")).unwrap();
        assert_eq!(count.quality, Some(192));
    });
}

#[test]
fn a_host_writes_points_only_if_the_settings_let_it() {
    node("", |world, _, device, broker| {
        let writes = device.writes().len();
        broker.command(COMMAND, command(&[("limit", Value::Int(17))]));
        world.run_for(SECOND);
        assert_eq!(device.writes().len(), writes);
    });
    node("commands on", |world, rig, device, broker| {
        let from = broker.published().len();
        broker.command(COMMAND, command(&[("limit", Value::Int(17))]));
        world.run_for(SECOND);
        assert_eq!(device.memory().execute(&[3, 0, 1, 0, 1]).unwrap(), [3, 2, 0, 17]);
        assert_eq!(only(broker, from, DATA).metric("limit").unwrap().value, Some(Value::Int(17)));
        let writes = device.writes().len();
        for (name, value) in [
            ("limit", Value::Text("18".into())),
            ("limit", Value::Int(70_000)),
            ("limit/0", Value::Int(1)),
            ("fixed", Value::Int(1)),
            ("nobody", Value::Int(1)),
            ("a name that no point can have", Value::Int(1)),
        ] {
            broker.command(COMMAND, command(&[(name, value)]));
            world.run_for(SECOND);
        }
        broker.command(COMMAND, [0x12, 0x7f]);
        world.run_for(SECOND);
        assert_eq!(device.writes().len(), writes);
        let said = world.run_until(typed(rig.gateway, "show audit"));
        assert!(said.contains("publisher plant: write limit 17"), "{said}");
        assert!(shown(world, rig).contains(" open"));
    });
}

#[test]
fn values_of_all_types_are_told_and_written() {
    let more = "
point run plc coil 0 read 100ms write change
point level plc holding 50 count 2 as i16 read 100ms write change
point power plc holding 60 as f32 read 100ms write change";
    node(&format!("commands on{LONG}{more}"), |world, _, device, broker| {
        let birth = since(broker, 0).remove(0).1;
        for (name, datatype) in [
            ("energy", 8),
            ("label", 12),
            ("warmth", 10),
            ("mode", UINT16),
            ("seen", UINT16),
            ("run", BOOLEAN),
            ("level/0", 2),
            ("level/1", 2),
            ("power", 9),
        ] {
            assert_eq!(birth.metric(name).unwrap().datatype, Some(datatype), "{name}");
        }
        for (name, value, told) in [
            // Coil 0 of unit 5 is set at first.
            ("run", Value::Boolean(false), None),
            ("run", Value::Boolean(true), None),
            ("level/1", Value::Int(0xfff6), None),
            ("level/0", Value::Int(-11_i32 as u32), Some(Value::Int(0xfff5))),
            ("power", Value::Float(-21.5), None),
            ("power", Value::Double(0.25), Some(Value::Float(0.25))),
            ("warmth", Value::Double(21.5), None),
            ("warmth", Value::Int(-3_i32 as u32), Some(Value::Double(-3.0))),
            ("label", Value::Text("a b".into()), None),
            ("mode", Value::Int(12), None),
        ] {
            let from = broker.published().len();
            broker.command(COMMAND, command(&[(name, value.clone())]));
            world.run_for(500 * MS);
            let data = since(broker, from);
            let last = data.iter().rev().find_map(|(_, payload)| payload.metric(name));
            assert_eq!(last.and_then(|metric| metric.value.clone()), told.or(Some(value)), "{name}");
        }
        // Tenths above -40.
        assert_eq!(device.memory().execute(&[3, 0, 40, 0, 1]).unwrap(), [3, 2, 0x01, 0x72]);
        assert_eq!(device.memory().execute(&[3, 0, 50, 0, 2]).unwrap(), [3, 4, 0xff, 0xf5, 0xff, 0xf6]);
    });
}

#[test]
fn without_the_time_of_day_or_with_points_that_do_not_fit_there_is_no_birth_and_the_reason_is_shown() {
    published_by(
        |_| None,
        NODE,
        |world, rig, _, broker| {
            assert!(broker.connections().is_empty());
            let shown = shown(world, rig);
            assert!(shown.contains("the time of day is not known"), "{shown}");
        },
    );
    node("\npoint BDSEQ plc holding 9 read 10s", |world, rig, _, broker| {
        assert!(broker.connections().is_empty());
        let shown = shown(world, rig);
        assert!(shown.contains("no point may have the name bdSeq"), "{shown}");
    });
    let many = "\npoint many plc coil 0 count 1968 read 10s";
    node(many, |world, rig, _, broker| {
        assert!(broker.connections().is_empty());
        let shown = shown(world, rig);
        assert!(shown.contains("all points do not fit in one message"), "{shown}");
    });
    let fits = "\npoint many plc coil 0 count 1000 read 10s";
    node(fits, |_, _, _, broker| {
        let birth = since(broker, 0).remove(0).1;
        assert_eq!(birth.metrics.len(), 5 + 1000);
        assert_eq!(birth.metric("many/999").unwrap().datatype, Some(BOOLEAN));
    });
}
