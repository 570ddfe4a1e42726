//! Time-outs and gaps that are proposed from responses that were measured.

use mobgate::stats::response_tail::ResponseTail;
use mobgate_simulator::console::typed_slowly;

use crate::prelude::*;

const SETTINGS: &str = "
port bus serial uart1 rtu client 19200 8E1 timeout 500ms
port P502 tcp server 502
route P502 * * * bus
";

/// Draws a response time in microseconds.
type Draw = fn(&mut Random) -> f64;

/// How response times are distributed, and the time in microseconds within which 999 of 1000 are.
const MODELS: [(&str, f64, Draw); 5] = [
    ("constant", 20_000.0, |_| 20_000.0),
    ("uniform", 49_960.0, |random| 10_000.0 + random.within(0..=40_000) as f64),
    ("exponential", 5_000.0 + 6_907.8 * 8.0, |random| 5_000.0 + 8_000.0 * random.exponential()),
    ("often slow", 209_800.0, |random| {
        if random.chance(0.05) { 200_000.0 + random.within(0..=10_000) as f64 } else { 10_000.0 }
    }),
    ("seldom slow", 208_000.0, |random| {
        if random.chance(0.005) { 200_000.0 + random.within(0..=10_000) as f64 } else { 10_000.0 }
    }),
];

#[test]
fn the_tail_is_told_within_a_fifth_in_nearly_every_series_of_two_thousand() {
    for (name, p999, draw) in MODELS {
        let mut far = 0;
        for seed in 0..500 {
            let (mut random, mut tail) = (Random::new(seed), ResponseTail::new());
            (0..2_000).for_each(|_| tail.add(draw(&mut random) as u32));
            let ratio = f64::from(tail.p999().unwrap()) / p999;
            far += u32::from(!(0.8..=1.2).contains(&ratio));
        }
        // An exponential tail is two and a half standard deviations from there.
        assert!(far <= 10, "{name}: {far} of 500");
    }
}

#[test]
fn few_responses_are_enough_for_more_than_was_seen() {
    assert_eq!(ResponseTail::new().p999(), None);
    let mut tail = ResponseTail::new();
    tail.add(1_000);
    assert_eq!(tail.p999(), Some(1_000));
    let mut random = Random::new(1);
    (0..100).for_each(|_| tail.add((10_000.0 * random.exponential()) as u32));
    assert!((50_000..100_000).contains(&tail.p999().unwrap()), "{:?}", tail.p999());
}

#[test]
fn a_time_out_is_proposed_from_what_the_units_do_and_traffic_goes_on() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let slow = Device::new(5).with_turnaround(Duration::from_millis(30));
        rig.attach(world, "uart1", [slow, Device::new(6)]);
        let mut client = rig.client(machine(1), 502);
        for unit in [5, 6] {
            assert!(matches!(world.run_until(client.request(unit, &READ)), Response::Pdu(_)));
        }
        let tune = world.spawn(typed(rig.gateway, "tune bus count 200"));
        world.run_for(Duration::from_secs(2));
        assert!(matches!(world.run_until(client.request(5, &READ)), Response::Pdu(_)), "others are served");
        let shown = world.run_until(tune);
        assert!(shown.contains("unit 5: 200 responses by function 3, 0 lost; "), "{shown}");
        assert!(shown.contains("unit 6: 200 responses"), "{shown}");
        // 2.005 ms of silence, 30 ms, a character of 573 us.
        assert!(shown.ends_with("edit port bus timeout 33ms\n"), "{shown}");
        world.run_for(Duration::from_millis(10));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

#[test]
fn a_key_stops_it_and_then_it_proposes_nothing() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5), Device::new(6)]);
        let keys = [(Duration::from_ticks(0), "tune bus units 5-6\n"), (Duration::from_secs(50), "x")];
        let shown = world.run_until(typed_slowly(rig.gateway, &keys));
        assert!(
            shown.contains("unit 5: 2000 responses") && !shown.contains("unit 6: 2000 responses"),
            "{shown}"
        );
        assert!(shown.contains("stopped") && !shown.contains("edit port"), "{shown}");
    });
}
