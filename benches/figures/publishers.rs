//! Publishers: how long after its read a value is at the broker, and how long a command takes to a device on a busy bus.

use mobgate_simulator::broker::Broker;

use crate::line::seconds;
use crate::prelude::*;

const BROKER: &str = "10.0.1.9:1883";
const PLC: &str = "10.0.1.1:502";
/// How often all points are read, which is a period of the bus.
const PERIOD: Duration = Duration::from_millis(100);
/// Until all devices are read and the broker has what there is.
const SETTLED: Duration = Duration::from_secs(60);
const DEVICES: u8 = 8;
const REGISTERS: u16 = 100;

pub(crate) fn figures() {
    changes();
    commands();
}

/// A gateway with devices behind the port `bus`, all of whose points change with each read, and a broker.
fn with_broker(bus: &str, devices: u8, scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Broker)) {
    let points = (1..=devices).map(|unit| {
        format!(
            "device d{unit} unit {unit}
            point reads{unit} d{unit} holding {REGISTERS} as u32 read 100ms
            point at{unit} d{unit} holding {} as u32 read 100ms\n",
            REGISTERS + 2
        )
    });
    let settings = format!(
        "port bus {bus}
        port scan scanner
        route scan 1-247 * * bus
        {}point limit d1 holding 0 read 100ms write change
        publish plant mqtt broker {BROKER} every 24h commands on",
        points.collect::<String>()
    );
    with_gateway(1, &settings, |world, rig| {
        let broker = Broker::default();
        let address = BROKER.parse().expect("an address");
        world.spawn(broker.clone().serve(rig.network.serve(address)));
        let (gateway, connector) = (rig.gateway, rig.network.connector());
        world.spawn(async move { gateway.publish(&connector, |_| None).await });
        scenario(world, rig, &broker);
    });
}

fn devices(count: u8) -> Vec<Device> {
    (1..=count).map(|unit| Device::new(unit).with_fresh(REGISTERS)).collect()
}

/// Devices count their reads and say when each was: a message is as late as it comes behind that.
fn changes() {
    with_broker(&format!("tcp client {PLC} idle 0"), DEVICES, |world, rig, broker| {
        rig.attach_tcp(world, PLC, devices(DEVICES));
        world.run_for(SETTLED);
        let begin = Instant::now();
        world.run_for(Duration::from_secs(100));
        let mut late: Vec<u64> = broker
            .published()
            .iter()
            .filter(|message| message.at >= begin && message.topic.starts_with("mobgate/points/at"))
            .map(|message| message.at.as_micros() - number(&message.text))
            .collect();
        late.sort_unstable();
        assert!(late.len() > usize::from(DEVICES) * 900, "{} values were published", late.len());
        let p99 = late.get(late.len() * 99 / 100).copied().unwrap_or(u64::MAX);
        figure("mqtt_change_to_message_p99_ms", p99 as f64 / 1e3, "ms", Target::AtMost(10.0));
    });
}

/// The value in a message.
fn number(text: &str) -> u64 {
    let digits = text.trim_start_matches("{\"value\":").split(',').next();
    digits.and_then(|digits| digits.parse().ok()).unwrap_or_else(|| panic!("no number in {text}"))
}

/// Commands at any time, while reads take more than half of the line.
fn commands() {
    with_broker("serial uart1 rtu client 19200 8E1", 3, |world, rig, broker| {
        let devices = devices(3);
        rig.attach(world, "uart1", devices.clone());
        world.run_for(SETTLED);
        let (mut random, mut worst) = (Random::new(1), Duration::from_ticks(0));
        for value in 1..=300 {
            world.run_for(Duration::from_micros(random.within(200_000..=400_000)));
            let begin = Instant::now();
            broker.command("mobgate/points/limit/set", value.to_string());
            world.run_for(Duration::from_secs(1));
            let [written] = &devices[0].take_writes()[..] else {
                panic!("command {value} was not one write")
            };
            worst = worst.max(written.at - begin);
        }
        let periods = seconds(worst) / seconds(PERIOD);
        figure("mqtt_command_bus_periods", periods, "periods", Target::AtMost(2.0));
    });
}
