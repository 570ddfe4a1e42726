//! The audit trail beside traffic: denied writes, refused and displaced clients, units that go down, and a flood of each.

use std::cell::Cell;
use std::rc::Rc;

use mobgate::gateway::audit::COUNTED_FOR;
use mobgate_simulator::rig::with_gateway_of;

use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 115200 8N1 timeout 100ms down-after 1
    port P502 tcp server 502 clients 60
    port P503 tcp server 503 clients 2
    port P504 tcp server 504 allow 10.9.0.0/16
    route P502 20 * * bus readonly
    route P502 1-9 * * bus";

/// Who and what, of all lines.
fn trail(rig: &Rig<'_>) -> Vec<String> {
    let lines = (0..).map_while(|nth| rig.gateway.audit_line(nth));
    lines.map(|line| format!("{}: {}", line.actor(), line.what())).collect()
}

fn with_rig<T>(test: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> T) -> T {
    let size = Size { frames: 400, connections: 130, ..Size::default() };
    with_gateway_of(size, 1, SETTINGS, |world, rig| {
        rig.attach(world, "uart1", [Device::new(1)]);
        test(world, rig)
    })
}

#[test]
fn what_is_refused_and_what_fails_is_told_with_its_place() {
    with_rig(|world, rig| {
        let mut client = rig.client(machine(1), 502);
        world.run_until(async {
            client.request(20, &[6, 0, 0, 0, 1]).await;
            client.request(1, &READ).await;
            // Nobody there.
            client.request(9, &READ).await;
        });
        world.run_until(typed(
            rig.gateway,
            "write 1 holding 4 5 via bus\nread 1 holding 4 via bus\nwrite 1 holding x\n",
        ));
        let _refused = rig.network.connect(machine(2), 504);
        world.run_for(SECOND);
        let _three: Vec<_> = (3..=5)
            .map(|host| {
                let stream = rig.network.connect(machine(host), 503);
                world.run_for(SECOND);
                stream
            })
            .collect();
        let at = |host| machine(host).to_string();
        assert_eq!(
            trail(rig),
            [
                format!("{}: a write to unit 20 by function 6 is denied at port P502", at(1)),
                "gateway: unit 9 is down at port bus".into(),
                "local console: write 1 holding 4 5 via bus".into(),
                format!("{}: a client is refused, its address is not allowed, at port P504", at(2)),
                format!("{}: displaces {} at port P503", at(5), at(3)),
            ]
        );
    });
}

#[test]
fn a_unit_that_comes_back_is_told() {
    with_rig(|world, rig| {
        let device = Device::new(5).with_faults(Faults::new(1).with(When::Requests(0..=1), Fault::Dead));
        rig.attach(world, "uart1", [device]);
        let mut client = rig.client(machine(1), 502);
        world.run_until(async {
            for _ in 0..5 {
                client.request(5, &READ).await;
                Timer::after(2 * SECOND).await;
            }
        });
        assert_eq!(
            trail(rig),
            ["gateway: unit 5 is down at port bus", "gateway: unit 5 responds again at port bus"]
        );
    });
}

#[test]
fn a_flood_of_denied_writes_is_counted_and_pushes_out_no_change() {
    with_rig(|world, rig| {
        let denied = Rc::<Cell<u64>>::default();
        for nth in 0..40 {
            let mut session = Session::start(rig.network.connect(machine(100 + nth), 502).unwrap(), world);
            let denied = denied.clone();
            world.spawn(async move {
                loop {
                    session.send(20, &[6, 0, 0, 0, 1]).await;
                    session.next().await;
                    denied.set(denied.get() + 1);
                }
            });
        }
        for nth in 0..100 {
            world.run_until(typed(rig.gateway, &format!("mdns on name n{nth}\n")));
            world.run_for(3 * SECOND);
        }
        world.run_for(COUNTED_FOR);
        rig.gateway.settle_audit();
        let trail = trail(rig);
        let changes = (0..100).filter(|nth| trail.contains(&format!("local console: mdns on name n{nth}")));
        assert_eq!(changes.count(), 100, "{trail:?}");
        let about: Vec<_> = trail.iter().filter(|line| line.contains("write")).collect();
        // One at once, and one a minute.
        assert!((6..=8).contains(&about.len()), "{about:?}");
        let counted: u64 = about
            .iter()
            .filter_map(|line| {
                line.split_once(": ")?.1.split_once(" more denied writes")?.0.parse::<u64>().ok()
            })
            .sum();
        assert!(denied.get() > 100_000, "it is a flood: {}", denied.get());
        let open = denied.get() - (counted + 1).min(denied.get());
        assert!(
            open < denied.get() / 5,
            "{counted} of {} are told, the others are still counted",
            denied.get()
        );
    });
}
