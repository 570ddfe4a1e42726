//! Floods of requests that are refused: they cost the gateway a bounded number of refusals, and nobody else his responses.

use std::cell::Cell;
use std::rc::Rc;

use mobgate::port::client::queue::WAITING_MAX;
use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::net::ClientStream;
use mobgate_simulator::rig::with_gateway_of;

use crate::prelude::*;

const FLOODERS: usize = 40;
/// Requests that a flooder has open at a time.
const OPEN: usize = 16;
const LENGTH: Duration = Duration::from_secs(10);
/// From a response to the next request of a flooder.
const REACTION: Duration = Duration::from_micros(100);
/// What the gateway spends on refusals at most: one turn each, and what the flooders' windows hold at the start.
const REFUSALS_MAX: u32 = 10_000 / 2 + (FLOODERS * (OPEN + 2)) as u32;

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const SETTINGS: &str = "port bus serial uart1 rtu client 115200 8N1 timeout 100ms down-after 1
    port P502 tcp server 502 clients 60
    port P503 tcp server 503 clients 60 rtu
    route P502 1-9 * * bus merge off
    route P502 20 * * bus readonly
    route P502 21 * * bus addresses 1000-2000
    route P502 22 * * discard
    route P503 1-9 * * bus";

/// A client that keeps `OPEN` requests open; counts its responses.
fn flood(world: &World<'_>, rig: &Rig<'_>, unit: u8, pdu: [u8; 5]) -> Rc<Cell<u32>> {
    let responses = Rc::<Cell<u32>>::default();
    for nth in 0..FLOODERS {
        let mut session = Session::start(rig.network.connect(machine(100), 502).unwrap(), world);
        let responses = responses.clone();
        let request = [pdu[0], pdu[1], pdu[2] + nth as u8, pdu[3], pdu[4]];
        world.spawn(async move {
            for _ in 0..OPEN {
                session.send(unit, &request).await;
            }
            loop {
                session.next().await;
                responses.set(responses.get() + 1);
                Timer::after(REACTION).await;
                session.send(unit, &request).await;
            }
        });
    }
    responses
}

/// The transactions of a polite client and of the line in the time of the flood.
fn transactions(world: &mut World<'_>, rig: &Rig<'_>) -> (u64, u32) {
    let before = rig.counted("bus", Event::Response);
    let mut polite = rig.client(machine(1), 502);
    let load = ClosedLoop::until(Instant::now() + LENGTH);
    let load = load.run(&mut polite, || (5, READ.to_vec()), |_, _, _| {});
    let load = world.run_until(load);
    assert!(load.exceptions.is_empty(), "{:?}", load.exceptions);
    (load.responses, rig.counted("bus", Event::Response) - before)
}

fn with_line<T>(test: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> T) -> T {
    let size = Size { frames: 400, connections: 130, ..Size::default() };
    with_gateway_of(size, 1, SETTINGS, |world, rig| {
        let dead = Device::new(9).with_faults(Faults::new(1).with(When::Always, Fault::Dead));
        rig.attach(world, "uart1", [Device::new(1), Device::new(5), dead]);
        test(world, rig)
    })
}

#[test]
fn a_flood_that_is_refused_gets_a_bounded_number_of_refusals_and_takes_no_response_from_others() {
    let alone = with_line(transactions);
    for (unit, pdu, exception) in [
        (99, READ, "0A"),
        (20, [6, 0, 0, 0, 1], "01"),
        (21, READ, "02"),
        (1, [3, 0, 0, 0, 0], "03"),
        (9, READ, "0B"),
    ] {
        with_line(|world, rig| {
            let responses = flood(world, rig, unit, pdu);
            world.run_for(Duration::from_secs(1));
            let (polite, line) = transactions(world, rig);
            let refused = responses.get();
            assert!(refused <= REFUSALS_MAX * 11 / 10, "{exception}: {refused} refusals");
            assert!(refused >= 1_000, "{exception}: it is a flood: {refused}");
            let (alone, _) = alone;
            assert!(20 * polite >= 19 * alone, "{exception}: {polite} of {alone}, {line} on the line");
        });
    }
}

#[test]
fn a_flood_that_fills_the_queue_keeps_the_line_as_busy_as_it_was_and_its_turns_fair() {
    let (_, alone) = with_line(transactions);
    with_line(|world, rig| {
        let responses = flood(world, rig, 1, READ);
        world.run_for(Duration::from_secs(1));
        let (polite, line) = transactions(world, rig);
        assert!(20 * line >= 19 * alone, "{line} of {alone}");
        assert!(100 * polite >= 45 * u64::from(line), "{polite} of {line}: half is the other address's");
        let busy = rig.counted("P502", Event::Busy);
        let served = responses.get() - busy;
        assert!(served > 500 && busy <= 2 * served, "{busy} refusals, {served} served");
    });
}

#[test]
fn what_gets_no_response_is_read_no_faster_than_refusals_are_given() {
    with_line(|world, rig| {
        let discarded = [[0, 1, 0, 0, 0, 6, 22, 3, 0, 0, 0, 1]; 20].concat();
        let not_modbus = [[0, 1, 0, 9, 0, 2, 1, 3]; 30].concat();
        for (port, bytes) in [(502, discarded), (502, not_modbus), (503, vec![0xff; 240])] {
            for _ in 0..FLOODERS {
                let mut session = Session::deaf(rig.network.connect(machine(100), port).unwrap());
                let bytes = bytes.clone();
                world.spawn(async move {
                    while session.send_bytes(&bytes).await {
                        Timer::after(REACTION).await;
                    }
                });
            }
        }
        let (polite, _) = transactions(world, rig);
        assert!(polite > 1_000, "{polite}");
        let counted = [("P502", Event::Malformed), ("P502", Event::Discarded), ("P503", Event::Noise)];
        let skipped: u32 = counted.into_iter().map(|(port, event)| rig.counted(port, event)).sum();
        assert!(skipped <= 3 * REFUSALS_MAX, "{skipped}");
    });
}

#[test]
fn connections_that_bring_nothing_are_taken_one_in_a_turn() {
    with_line(|world, rig| {
        for _ in 0..4 {
            let network = rig.network.clone();
            world.spawn(async move {
                loop {
                    drop(network.connect(machine(100), 502));
                    Timer::after(10 * REACTION).await;
                }
            });
        }
        world.run_for(LENGTH);
        let came = rig.counted("P502", Event::Connected);
        assert!(came > 1_000, "it is a flood: {came}");
        assert!(came <= REFUSALS_MAX, "{came}");
    });
}

#[test]
fn who_is_served_in_between_is_not_slowed_by_refusals() {
    with_line(|world, rig| {
        let mut polite = rig.client(machine(1), 502);
        let asked = Instant::now();
        let mut refused = 0;
        for turn in 0..300 {
            // Two of three have no rule.
            let unit = if turn % 3 == 0 { 5 } else { 99 };
            refused += u32::from(world.run_until(polite.request(unit, &READ)).exception().is_some());
        }
        let mixed = asked.elapsed();
        let asked = Instant::now();
        (0..100).for_each(|_| drop(world.run_until(polite.request(5, &READ))));
        let alone = asked.elapsed();
        assert!(refused == 200 && mixed <= alone + Duration::from_millis(1), "{refused}: {mixed}, {alone}");
    });
}

/// A full queue is looked through for orders whose requesters have gone, at most every 10 ms.
#[test]
fn orders_of_clients_that_have_left_keep_a_full_queue_from_nobody_for_long() {
    const SETTINGS: &str = "port bus serial uart1 rtu client 9600 8E1 timeout 1m late-window 1ms
        port P502 tcp server 502 clients 70
        route P502 1-9 * * bus merge off";
    let wait = |world: &mut World<'_>, ms| world.run_for(Duration::from_millis(ms));
    for (again_ms, is_busy) in [(9, true), (10, false)] {
        let size = Size { connections: 140, frames: 300, ..Size::default() };
        with_gateway_of(size, 1, SETTINGS, |world, rig| {
            let waiting = || usize::from(rig.gateway.port_states().next().unwrap().waiting());
            let connect =
                |world: &World<'_>| Session::start(rig.network.connect(machine(1), 502).unwrap(), world);
            let (mut first, mut polite) = (connect(world), connect(world));
            let leaving = [(); 2].map(|()| [(); 8].map(|()| connect(world)));
            wait(world, 100);
            // Nothing responds, so the line is busy all the time.
            world.run_until(first.send(5, &READ));
            wait(world, 20);
            // Nobody has more orders than the others.
            let fill = |world: &mut World<'_>, sessions: [Session; 8]| {
                let mut room = WAITING_MAX - waiting();
                for mut session in sessions {
                    for _ in 0..room.min(8) {
                        world.run_until(session.send(5, &READ));
                        room -= 1;
                    }
                    let stream = session.into_stream();
                    world.spawn(async move {
                        Timer::after(Duration::from_millis(1)).await;
                        stream.into_iter().for_each(ClientStream::reset);
                    });
                }
                wait(world, 1);
                assert_eq!(waiting(), WAITING_MAX);
                wait(world, 4);
            };
            let [before, behind] = leaving;
            for _ in 0..7 {
                world.run_until(polite.send(5, &READ));
            }
            wait(world, 1);
            fill(world, before);
            world.run_until(polite.send(5, &READ));
            wait(world, 1);
            assert_eq!((waiting(), polite.try_next()), (8, None));
            fill(world, behind);
            wait(world, again_ms - 6);
            world.run_until(polite.send(5, &READ));
            wait(world, 3);
            let refused = polite.try_next().map(|arrival| arrival.reply.unwrap().pdu);
            assert_eq!(refused, is_busy.then(|| vec![0x83, 6]), "{again_ms} ms");
        });
    }
}
