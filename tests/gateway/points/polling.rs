//! Data points through the whole gateway: when requests leave, what a silent device costs, many stations behind TCP.

use crate::prelude::*;

const DEAD: &str = "port plc tcp client 10.0.1.1:502 timeout 300ms late-window 1ms idle 0 retries 5
    port P502 tcp server 502
    port scan scanner
    route scan 5 * * plc
    route P502 * * * plc
    device plc unit 5
    point a plc holding 0 read normal write auto";

fn scanner<R>(rig: &Rig<'_>, f: impl FnOnce(&mut Scanner) -> R) -> R {
    rig.gateway.scanner().unwrap().change(f)
}

fn silence() -> Faults {
    Faults::new(1).with(When::Always, Fault::Dead)
}

/// Runs until `device` has seen one request more, at most until `limit`; when that was.
fn next_request(world: &mut World<'_>, device: &Device, limit: Instant) -> Option<Instant> {
    let before = device.counters().all_requests();
    while device.counters().all_requests() == before {
        if Instant::now() >= limit {
            return None;
        }
        world.run_for(MS);
    }
    Some(Instant::now())
}

#[test]
fn attempts_reach_a_silent_device_15_17_to_30_seconds_after_the_last_one_failed_to_the_millisecond() {
    for others_ask in [false, true] {
        with_gateway(1, DEAD, |world, rig| {
            let device = Device::new(5);
            rig.attach_tcp(world, "10.0.1.1:502", [device.clone()]);
            // It was not there when the gateway started.
            world.run_for(20 * SECOND);
            let well = device.counters().all_requests();
            device.set_faults(silence());
            let mut failed = Instant::MIN;
            let status = |now| scanner(rig, |scanner| scanner.status(RowId(0), now));
            while failed == Instant::MIN {
                world.run_for(MS);
                if status(Instant::now()).any(Status::BACKING_OFF) {
                    failed = scanner(rig, |scanner| {
                        let status = scanner.device_status(DeviceId(0), Instant::now()).unwrap();
                        status.backs_off_until.unwrap() - 15 * SECOND
                    });
                }
            }
            let asked = device.counters().all_requests();
            assert_eq!(asked, well + 3, "one and two repeats, whatever the port does");
            scanner(rig, |scanner| scanner.put(RowId(0), 0, 1, &[0, 1], Instant::now())).unwrap();
            for seconds in [15, 17, 19, 21, 23, 25, 27, 29, 30, 30] {
                let due = failed + Duration::from_secs(seconds);
                if others_ask {
                    // Their probes keep the unit down, and must be over when the attempt is made.
                    let _ = rig.ask(world, 5, &[3, 0, 0, 0, 1]);
                }
                world.run_until(Timer::at(due - MS));
                let early = device.counters().all_requests();
                let at = next_request(world, &device, due + SECOND).expect("the attempt");
                // From the gateway to the device it is a millisecond.
                assert!(at <= due + 2 * MS, "{} us late", (at - due).as_micros());
                assert_eq!(device.counters().all_requests(), early + 1);
                failed = due + 300 * MS;
                world.run_for(400 * MS);
            }
        });
    }
}

#[test]
fn a_polled_point_stays_fresh_while_a_client_floods_its_line() {
    let settings = "port bus serial uart1 rtu client 19200 8E1
        port P502 tcp server 502
        port scan scanner
        route scan 1-247 * * bus
        route P502 1-247 * * bus merge off
        device meter unit 5
        point power meter holding 0 count 4 read high";
    with_gateway(1, settings, |world, rig| {
        rig.attach(world, "uart1", [Device::new(5), Device::new(6)]);
        let mut client = rig.client(machine(1), 502);
        world.spawn(async move {
            loop {
                for _ in 0..8 {
                    client.send(6, &[3, 0, 0, 0, 10]).await;
                }
                for _ in 0..8 {
                    let _ = client.receive().await;
                }
            }
        });
        world.run_for(SECOND);
        let mut oldest = Duration::from_ticks(0);
        for _ in 0..5_000 {
            world.run_for(MS);
            let age = scanner(rig, |scanner| scanner.age(RowId(0), Instant::now()));
            oldest = oldest.max(age.unwrap());
        }
        assert!(oldest < 300 * MS, "{} ms", oldest.as_millis());
    });
}

#[test]
fn what_the_ports_full_queue_refuses_is_not_taken_for_the_devices_response() {
    let settings = "port bus serial uart1 rtu client 19200 8E1
        port P502 tcp server 502 clients 75
        port scan scanner
        route scan 1-247 * * bus
        route P502 1-247 * * bus merge off
        device meter unit 5
        point power meter holding 0 count 4 read high
        point limit meter holding 10 read normal write auto";
    with_gateway(1, settings, |world, rig| {
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone(), Device::new(6)]);
        world.run_for(SECOND);
        // More of them than may wait, so that none of them crowds the others.
        for host in 1..=75 {
            let mut client = rig.client(machine(host), 502);
            world.spawn(async move {
                loop {
                    let _ = client.request(6, &[3, 0, 0, 0, 10]).await;
                    Timer::after(40 * MS).await;
                }
            });
        }
        let full = rig.counted("bus", Event::QueueFull);
        scanner(rig, |scanner| scanner.put(RowId(1), 0, 1, &[0, 1], Instant::now())).unwrap();
        let mut refused = 0;
        for nth in 0..20_u8 {
            world.run_for(2 * SECOND);
            scanner(rig, |scanner| scanner.put(RowId(1), 0, 1, &[0, nth], Instant::now())).unwrap();
            let error = scanner(rig, |scanner| scanner.status(RowId(0), Instant::now())).error();
            assert!(error.is_none_or(|error| error == ErrorCode::Connection), "{error:?}");
            refused += u32::from(error.is_some());
        }
        assert!(refused > 0 && rig.counted("bus", Event::QueueFull) > full);
        let status = scanner(rig, |scanner| scanner.device_status(DeviceId(0), Instant::now())).unwrap();
        assert_eq!((status.exceptions, status.exception, status.alive), (0, 0, Some(true)));
        assert!(u64::from(status.responses).abs_diff(device.counters().all_requests()) <= 1, "{status:?}");
        world.run_for(10 * SECOND);
        assert_eq!(device.memory().holding[10], 19, "the last write has found its way");
    });
}

#[test]
fn a_gateway_without_memory_for_points_refuses_them_and_changes_nothing() {
    use mobgate::frame::FramePool;
    use mobgate::gateway::{ApplyError, Gateway, Ports};
    let (slots, places) = ([], Ports::<0>::new());
    let pool = FramePool::new(&slots, 0);
    let gateway = Gateway::new(&pool, &places, &[]);
    assert_eq!(gateway.apply(&settings_of("point a local holding 0")), Err(ApplyError::NoPoints));
    assert!(gateway.settings(|settings| settings.points.is_empty()));
}

#[test]
fn with_one_frame_for_itself_a_scanner_asks_one_device_after_the_other_and_leaves_none_out() {
    use mobgate::settings::PORTS_MAX;
    use mobgate_simulator::rig::{Size, with_gateway_of};
    let mut settings = "port bus serial uart1 rtu client 19200 8E1 timeout 1s
        port scan scanner
        route scan 1-247 * * bus\n"
        .to_owned();
    for n in 1..=8 {
        settings += &format!("device d{n} unit {n}\npoint p{n} d{n} holding 0 read 250ms\n");
    }
    // No frame is shared: each port has its own, and that is all.
    let size = Size { frames: PORTS_MAX, connections: 0, ..Size::default() };
    with_gateway_of(size, 1, &settings, |world, rig| {
        rig.attach(world, "uart1", (1..=8).map(Device::new).collect::<Vec<_>>());
        world.run_for(10 * SECOND);
        assert!(rig.counted("scan", Event::BackPressure) > 0);
        for n in 0..8 {
            let status = scanner(rig, |scanner| scanner.device_status(DeviceId(n), Instant::now())).unwrap();
            assert!(status.failures == 0 && (39..=41).contains(&status.responses), "{n}: {status:?}");
        }
    });
}

#[test]
fn an_attempt_at_a_server_that_was_not_there_connects_anew_at_that_moment() {
    let settings = "port plc tcp client 10.0.1.1:502
        port P502 tcp server 502
        port scan scanner
        route scan 5 * * plc
        route P502 5 * * plc
        device plc unit 5
        point a plc holding 0 read high";
    // The port's own attempts come when they come: some are under way when the scanner asks.
    for seed in 1..=20 {
        with_gateway(seed, settings, |world, rig| {
            world.run_for(14 * SECOND);
            let made = rig.network.counters().made;
            rig.attach_tcp(world, "10.0.1.1:502", [Device::new(5)]);
            let status =
                || scanner(rig, |scanner| scanner.device_status(DeviceId(0), Instant::now())).unwrap();
            assert_eq!((status().failures, made), (3, 0));
            // Others are told at once that there is no way.
            let mut client = rig.client(machine(1), 502);
            assert_eq!(world.run_until(client.request(5, &[3, 0, 0, 0, 1])).exception(), Some(10));
            // The scan after 15 s.
            world.run_for(1_300 * MS);
            assert_eq!((status().alive, status().failures), (Some(true), 3), "seed {seed}");
        });
    }
}

#[test]
fn a_response_to_what_a_deleted_device_was_asked_is_not_taken_for_its_successors() {
    let settings = "port bus serial uart1 rtu client 19200 8E1 timeout 5s
        port scan scanner
        route scan 1-9 * * bus
        device old unit 5
        point p old holding 0 read 10s";
    with_gateway(1, settings, |world, rig| {
        let devices = [5, 6].map(Device::new);
        rig.attach(world, "uart1", devices.clone());
        for device in &devices {
            device.set_faults(Faults::new(1).with(When::Always, Fault::Late(SECOND, SECOND)));
        }
        world.run_for(300 * MS);
        let settings = "delete point p
            delete device old
            delete route 1
            delete port scan
            port scan scanner
            route scan 1-9 * * bus
            device new unit 6
            point p new holding 0 read 10s";
        settings.lines().for_each(|line| rig.console(line).unwrap());
        let status = || scanner(rig, |scanner| scanner.device_status(DeviceId(0), Instant::now())).unwrap();
        world.run_for(900 * MS);
        assert_eq!(devices.each_ref().map(|device| device.counters().all_requests()), [1, 1]);
        assert_eq!(status().responses, 0, "the old one has answered");
        world.run_for(SECOND);
        assert_eq!(status().responses, 1);
    });
}
