//! The program as an edge node of Sparkplug at mosquitto, with a host that is paho-mqtt and protobuf.

use std::io::{BufRead, BufReader, Write};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::SystemTime;

use serde_json::Value;

use crate::common::{converse, wait_for};
use crate::mosquitto::{Broker, Device, gateway};
use crate::outside::{Running, Tool, script};

/// What the host has heard.
struct Host {
    running: Running,
    heard: Arc<Mutex<Vec<Value>>>,
}

impl Host {
    fn start(port: u16) -> Self {
        let words = [script("sparkplug.py").into(), port.to_string().into(), "Site".into(), "plant".into()];
        let mut running = Tool::python().start_with_input(words);
        let heard = Arc::<Mutex<Vec<Value>>>::default();
        let (into, from) = (heard.clone(), running.0.stdout.take().unwrap());
        thread::spawn(move || {
            for line in BufReader::new(from).lines().map_while(Result::ok) {
                into.lock().unwrap().push(serde_json::from_str(&line).unwrap());
            }
        });
        let host = Self { running, heard };
        host.wait("ready", |_| true);
        host
    }

    /// Waits for a message of this type that `fits`.
    fn wait(&self, topic: &str, fits: impl Fn(&Value) -> bool) -> Value {
        wait_for(&format!("a message on {topic}"), || {
            self.heard.lock().unwrap().iter().find(|told| told["topic"] == topic && fits(told)).cloned()
        })
    }

    /// Sends a command: a metric, the field of its value and that.
    fn say(&mut self, line: &str) {
        let input = self.running.0.stdin.as_mut().unwrap();
        writeln!(input, "{line}").and_then(|()| input.flush()).unwrap();
    }
}

#[test]
fn a_host_hears_birth_changes_and_death_and_writes() {
    for version in ["5", "3.1.1"] {
        let (broker, device) = (Broker::start("allow_anonymous true\n"), Device::start());
        let mut host = Host::start(broker.port);
        device.set(4, 0xffff);
        let line = format!(
            "publish plant mqtt broker 127.0.0.1:{} version {version} topic Site format sparkplug commands on",
            broker.port
        );
        let program = gateway(&device, &line);
        let birth = host.wait("NBIRTH", |_| true);
        assert_eq!((&birth["seq"], &birth["qos"], &birth["retained"]), (&0.into(), &0.into(), &false.into()));
        let metrics = &birth["metrics"];
        for (name, kind) in [
            ("bdSeq", 4),
            ("Node Control/Rebirth", 11),
            ("count", 6),
            ("limit", 6),
            ("level/0", 2),
            ("level/1", 2),
            ("own", 9),
        ] {
            assert_eq!(metrics[name]["type"], kind, "{name}: {metrics}");
        }
        let since = SystemTime::UNIX_EPOCH.elapsed().unwrap().as_millis() as u64;
        let time = metrics["count"]["time"].as_u64().unwrap();
        assert!(since.abs_diff(time) < 10_000, "{time}");
        host.wait("NDATA", |told| told["metrics"]["count"]["quality"] == 192);
        host.say("limit int_value 1234");
        host.wait("NDATA", |told| told["metrics"]["limit"]["value"] == 1234);
        assert_eq!(device.get(3), 1234);
        host.say("own float_value -2.5");
        host.wait("NDATA", |told| told["metrics"]["own"]["value"] == -2.5);
        host.say("Node Control/Rebirth boolean_value true");
        let again = host.wait("NBIRTH", |told| told["metrics"]["limit"]["value"] == 1234);
        assert_eq!(again["metrics"]["bdSeq"]["value"], 0);
        assert_eq!(again["metrics"]["level/0"]["value"], 0xffff);
        device.fall_silent();
        stale(&mut host);
        // Other settings: the node leaves and comes again.
        converse(&mut program.session(), "point more local holding 9\nshow config\n", "point more");
        dies(&host, 0);
        let next = host.wait("NBIRTH", |told| told["metrics"]["bdSeq"]["value"] == 1);
        assert_eq!((&next["seq"], &next["metrics"]["more"]["type"]), (&0.into(), &6.into()));
        // What this life has not read is null.
        let count = &next["metrics"]["count"];
        assert!(count["null"] == true || count["quality"] == 500, "{count}");
        drop(program);
        dies(&host, 1);
        numbers_have_no_gaps(&host.heard.lock().unwrap());
    }
}

/// A device that does not respond makes its values stale, under the time at which they were read; so they are in a birth certificate.
fn stale(host: &mut Host) {
    let is_stale = |told: &Value| told["metrics"]["count"]["quality"] == 500;
    let stale = host.wait("NDATA", is_stale)["metrics"]["count"].clone();
    let last = host.wait("NDATA", |told| {
        let count = &told["metrics"]["count"];
        count["quality"] == 192 && count["value"] == stale["value"]
    });
    assert_eq!((&stale["time"], &stale["null"]), (&last["metrics"]["count"]["time"], &false.into()));
    host.say("Node Control/Rebirth boolean_value true");
    let birth = host.wait("NBIRTH", is_stale)["metrics"]["count"].clone();
    assert_eq!((&birth["time"], &birth["value"]), (&stale["time"], &stale["value"]));
}

fn dies(host: &Host, bd_seq: u64) {
    let death = host.wait("NDEATH", |told| told["metrics"]["bdSeq"]["value"] == bd_seq);
    assert_eq!((&death["seq"], &death["retained"]), (&Value::Null, &false.into()));
}

fn numbers_have_no_gaps(heard: &[Value]) {
    let mut expected = None;
    for told in heard.iter().filter(|told| told["seq"].is_number()) {
        let seq = told["seq"].as_u64().unwrap();
        let wanted = if told["topic"] == "NBIRTH" { Some(0) } else { expected };
        assert_eq!(Some(seq), wanted, "{told}");
        expected = Some((seq + 1) % 256);
    }
}
