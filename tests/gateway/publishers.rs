//! Publishers in virtual time, with a broker that acknowledges or not, is slow, and goes.

mod sparkplug;

use mobgate::gateway::date::Date;
use mobgate_simulator::broker::{Broker, Published};

use crate::prelude::*;

const BROKER: &str = "10.0.1.9:1883";
const WRITTEN: &str = "{\"result\":\"written\"}";
const COUNT: &str = "mobgate/points/count";

/// A device with two points behind TCP, and a broker.
fn published(more: &str, scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device, &Broker)) {
    published_by(|_| None, more, scenario);
}

/// The same with a calendar.
fn published_by(
    calendar: fn(Instant) -> Option<Date>,
    more: &str,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device, &Broker),
) {
    let lines = format!(
        "port plc tcp client 10.0.1.1:502 timeout 300ms idle 0
port scan scanner
route scan 5 * * plc
device plc unit 5
point count plc holding 0 read 100ms
point limit plc holding 1 read 100ms write change
point fixed plc input 1 read low
publish plant mqtt broker {BROKER} {more}"
    );
    with_gateway(1, &lines, |world, rig| {
        let (device, broker) = (Device::new(5), Broker::default());
        rig.attach_tcp(world, PLC, [device.clone()]);
        set(&device, 0, 1);
        set(&device, 1, 0);
        world.spawn(broker.clone().serve(rig.network.serve(address(BROKER))));
        let (gateway, connector) = (rig.gateway, rig.network.connector());
        world.spawn(async move { gateway.publish(&connector, calendar).await });
        // The device was not there when the gateway started.
        world.run_for(40 * SECOND);
        scenario(world, rig, &device, &broker);
    });
}

/// Points of the types that boards do not have.
const LONG: &str = "
point energy plc holding 20 as u64 read 100ms
point label plc holding 30 as text 4 read 100ms write change
point warmth plc holding 40 as i16 scale 0.1 offset -40 read 100ms write change
point mode plc holding 41 bits 4-7 read 100ms write change
point seen local holding 0 of mode";

fn set(device: &Device, register: u8, value: u8) {
    device.memory().execute(&[6, 0, register, 0, value]).unwrap();
}

/// What was sent of a topic from `from` on.
fn since(broker: &Broker, topic: &str, from: Instant) -> Vec<Published> {
    broker.published().into_iter().filter(|message| message.topic == topic && message.at >= from).collect()
}

fn shown(world: &mut World<'_>, rig: &Rig<'_>) -> String {
    world.run_until(typed(rig.gateway, "show publishers"))
}

#[test]
fn a_change_is_sent_at_once_and_what_does_not_change_every_minute() {
    for (version, level) in [("5", 5), ("3.1.1", 4)] {
        published(&format!("version {version}"), |world, _, device, broker| {
            assert_eq!(broker.connections(), [level]);
            let first = &broker.published()[0];
            assert_eq!(
                (&first.topic[..], &first.text[..], first.retained),
                ("mobgate/plant/status", "online", true)
            );
            for value in 2..20 {
                let begin = Instant::now();
                set(device, 0, value);
                // One poll, and 10 ms.
                world.run_for(110 * MS);
                let sent = since(broker, COUNT, begin);
                assert_eq!(sent.len(), 1, "{value}: {sent:?}");
                assert!(
                    sent[0].text.starts_with(&format!("{{\"value\":{value},\"quality\":\"good\",\"time\":"))
                );
            }
            let begin = Instant::now();
            world.run_for(600 * SECOND);
            // Each comes with the first check after its minute.
            assert!((9..=10).contains(&since(broker, COUNT, begin).len()));
            assert!(broker.pings() > 0);
        });
    }
}

#[test]
fn what_is_not_acknowledged_is_sent_again_as_it_was_and_each_value_has_its_own_time() {
    for keeps in [true, false] {
        published("", |world, rig, device, broker| {
            broker.set_keeps_sessions(keeps);
            broker.set_mute(true);
            let begin = Instant::now();
            set(device, 0, 7);
            world.run_for(SECOND);
            let [unanswered] = &since(broker, COUNT, begin)[..] else { panic!("one message") };
            broker.hang_up();
            broker.set_mute(false);
            let begin = Instant::now();
            world.run_for(5 * SECOND);
            let [repeated] = &since(broker, COUNT, begin)[..] else { panic!("one message") };
            let same = |message: &Published| (message.text.clone(), message.id);
            assert_eq!(same(repeated), same(unanswered));
            assert_eq!(repeated.again, keeps, "only in the same session it is a repetition");
            assert!(shown(world, rig).contains(" open"));
        });
    }
}

#[test]
fn values_replaced_while_the_broker_is_away_are_counted_and_the_newest_comes_with_its_time() {
    published("", |world, rig, device, broker| {
        let address = address(BROKER);
        broker.hang_up();
        rig.network.set_unreachable(address, true);
        world.run_for(SECOND);
        let begin = Instant::now();
        for value in 10..30 {
            set(device, 0, value);
            world.run_for(200 * MS);
        }
        assert!(since(broker, COUNT, begin).is_empty());
        rig.network.set_unreachable(address, false);
        world.run_for(60 * SECOND);
        let sent = since(broker, COUNT, begin);
        assert!(sent[0].text.starts_with("{\"value\":29,"), "{sent:?}");
        let shown = shown(world, rig);
        let row = shown.lines().find(|line| line.starts_with("plant")).unwrap();
        assert_eq!(row.split_whitespace().nth(5), Some("19"), "{shown}");
    });
}

#[test]
fn a_broker_that_says_nothing_gets_a_bounded_number_of_messages_and_is_left() {
    published("", |world, _, device, broker| {
        broker.set_mute(true);
        let begin = Instant::now();
        for value in 0..200 {
            set(device, 0, value);
            world.run_for(100 * MS);
        }
        assert!(since(broker, COUNT, begin).len() <= 8);
        world.run_for(60 * SECOND);
        assert!(broker.connections().len() > 1, "a ping without a response ends the connection");
    });
}

#[test]
fn a_command_writes_within_two_polls_and_is_answered() {
    published("commands on topic a/b", |world, _, device, broker| {
        assert_eq!(broker.filters(), ["a/b/points/+/set"]);
        for (text, result) in [
            ("17", WRITTEN),
            ("x", "{\"result\":\"refused\",\"error\":\"\\\"x\\\": expected a value of the point's type\"}"),
        ] {
            let writes = device.writes().len();
            broker.command("a/b/points/limit/set", text);
            world.run_for(200 * MS);
            assert_eq!(broker.texts("a/b/points/limit/result").last().unwrap(), result);
            assert_eq!(device.writes().len() - writes, usize::from(text == "17"));
        }
        let begin = Instant::now();
        broker.command("a/b/points/fixed/set", "3");
        world.run_for(200 * MS);
        let [refused] = &since(broker, "a/b/points/fixed/result", begin)[..] else { panic!("one answer") };
        assert!(refused.text.contains("it cannot be written"), "{}", refused.text);
    });
}

#[test]
fn a_silent_device_makes_its_values_stale_under_their_own_time_and_is_an_alarm() {
    published("every 5s", |world, _, device, broker| {
        let time = |message: &Published| {
            let time = message.text.rsplit("\"time\":").next().unwrap().trim_end_matches('}');
            time.parse::<f64>().unwrap()
        };
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        let cut = Instant::now();
        world.run_for(40 * SECOND);
        let sent = since(broker, COUNT, cut + 10 * SECOND);
        assert!(!sent.is_empty());
        for message in &sent {
            assert!(message.text.contains("\"quality\":\"stale\""), "{}", message.text);
            assert!(time(message) <= cut.as_millis() as f64 / 1_000.0 + 0.001, "{}", message.text);
        }
        let alarms = broker.texts("mobgate/alarms");
        assert!(alarms.iter().any(|text| text.contains("down")), "{alarms:?}");
    });
}

#[test]
fn home_assistant_finds_each_value_and_what_it_is() {
    published("format homeassistant commands on", |_, _, _, broker| {
        for (component, point) in [("sensor", "fixed"), ("number", "limit")] {
            let topic = format!("homeassistant/{component}/mobgate/{point}/config");
            let texts = broker.texts(&topic);
            let config: serde_json::Value = serde_json::from_str(&texts[0]).unwrap();
            assert_eq!(config["state_topic"], format!("mobgate/points/{point}"));
            assert_eq!(config["value_template"], "{{ value_json.value }}");
            assert_eq!(config["availability_mode"], "all");
            assert_eq!(config["availability"][0]["topic"], "mobgate/plant/status");
            assert_eq!(config["device"]["identifiers"][0], "mobgate");
            assert_eq!(config.get("command_topic").is_some(), component == "number");
        }
    });
}

#[test]
fn long_values_text_and_scales_are_published_and_written_as_people_see_them() {
    published(&format!("commands on{LONG}"), |world, _, device, broker| {
        for (at, register) in [0x7f, 0x23, 0x45, 0x67].into_iter().enumerate() {
            set(device, 20 + at as u8, register);
        }
        world.run_for(200 * MS);
        let last = |point: &str| broker.texts(&format!("mobgate/points/{point}")).last().unwrap().clone();
        // Readers of JSON would round it.
        assert!(last("energy").starts_with("{\"value\":\"35747472370630759\""), "{}", last("energy"));
        for (point, text, json) in [
            ("warmth", "21.5", "21.5"),
            ("label", "a \"b\"", "\"a \\\\x22b\\\\x22\""),
            ("label", "", "\"\""),
            ("mode", "12\n", "12"),
        ] {
            broker.command(&format!("mobgate/points/{point}/set"), text);
            world.run_for(500 * MS);
            assert_eq!(broker.texts(&format!("mobgate/points/{point}/result")).last().unwrap(), WRITTEN);
            assert!(last(point).starts_with(&format!("{{\"value\":{json},")), "{}", last(point));
        }
        assert_eq!(device.memory().execute(&[3, 0, 40, 0, 1]).unwrap(), [3, 2, 0x02, 0x67]);
        for (point, text, error) in [
            ("warmth", "3300", "-3316.8 to 3236.7"),
            ("mode", "16", "0 to 15"),
            ("label", "123456789", "a text that fits"),
            ("label", "a\nb", "without control characters"),
            ("limit 1", "2", "no point of this name"),
        ] {
            broker.command(&format!("mobgate/points/{point}/set"), text);
            world.run_for(200 * MS);
            let result = broker.texts(&format!("mobgate/points/{point}/result")).last().unwrap().clone();
            assert!(result.contains("refused") && result.contains(error), "{result}");
        }
    });
}

#[test]
fn home_assistant_gets_the_limits_of_scales_bits_and_text() {
    published(&format!("format homeassistant commands on{LONG}"), |_, _, _, broker| {
        for (component, point, limits) in [
            ("sensor", "fixed", &[][..]),
            ("number", "energy", &[("min", "0"), ("max", "18446744073709551615"), ("step", "1")]),
            ("text", "label", &[("max", "8")]),
            ("number", "warmth", &[("min", "-3316.8"), ("max", "3236.7"), ("step", "0.1")]),
            ("number", "mode", &[("min", "0"), ("max", "15"), ("step", "1")]),
            ("number", "seen", &[("min", "0"), ("max", "15"), ("step", "1")]),
        ] {
            let texts = broker.texts(&format!("homeassistant/{component}/mobgate/{point}/config"));
            let config: serde_json::Value = serde_json::from_str(&texts[0]).unwrap();
            for key in ["min", "max", "step"] {
                let wanted = limits.iter().find(|(limit, _)| *limit == key).map(|(_, value)| *value);
                assert_eq!(config.get(key).map(ToString::to_string).as_deref(), wanted, "{point} {key}");
            }
        }
    });
}
