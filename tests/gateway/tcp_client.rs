//! Devices behind Modbus TCP that answer nonsense, or are more than there are sockets; tests/scenarios/tcp_client.yaml has the rest.

use crate::prelude::*;

const SETTINGS: &str = "port plc tcp client 10.0.1.1:502
    port P502 tcp server 502
    route P502 * * * plc";

#[test]
fn what_cannot_be_followed_ends_the_connection_and_not_the_port() {
    with_gateway(1, SETTINGS, |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            for nonsense in [&[0, 0, 0, 0, 0, 0][..], &[0xff; 300], &[0, 0, 0, 0, 1, 0, 5]] {
                let mut stream = server.accept().await;
                let _ = stream.read(&mut [0; 260]).await;
                let _ = stream.write_all(nonsense).await;
                assert_eq!(stream.read(&mut [0; 260]).await.unwrap_or(0), 0);
            }
        });
        for _ in 0..3 {
            assert_eq!(rig.ask(world, 5, &READ).exception(), Some(0x0b));
            world.run_for(15 * SECOND);
        }
        assert_eq!(rig.counted("plc", Event::Malformed), 3);
    });
}

#[test]
fn more_devices_than_sockets_take_turns_and_a_broken_one_holds_none() {
    let port = |n| format!("port D{n} tcp client 10.0.1.{n}:502 timeout 300ms\n");
    let route = |n| format!("route P502 {n} * * D{n}\n");
    let lines: String = (1..=8).map(port).chain((1..=8).map(route)).collect();
    with_gateway(1, &format!("port P502 tcp server 502\n{lines}"), |world, rig| {
        rig.network.set_sockets(2);
        rig.network.set_unreachable(address("10.0.1.8:502"), true);
        for n in 1..=7 {
            let path = Path { latency: MS, ..Path::default() };
            rig.network.set_path(address(&format!("10.0.1.{n}:502")), path);
            rig.attach_tcp(world, &format!("10.0.1.{n}:502"), [Device::new(n)]);
        }
        // One after the other: the connection that was quiet for longest goes.
        for round in 0..3 {
            for unit in 1..=7 {
                assert_eq!(rig.ask(world, unit, &READ), value(unit), "round {round}");
            }
        }
        // The last two are connected still.
        let made = rig.network.counters().made;
        assert_eq!((rig.ask(world, 7, &READ), rig.ask(world, 6, &READ)), (value(7), value(6)));
        assert_eq!(rig.network.counters().made, made);
        // All at a time, and a dead one among them.
        let clients: Vec<_> = (1..=8)
            .map(|unit| {
                let mut client = rig.client(machine(unit), 502);
                world.spawn(async move {
                    let mut answered = 0;
                    for _ in 0..50 {
                        answered += usize::from(client.request(unit, &READ).await == value(unit));
                    }
                    answered
                })
            })
            .collect();
        let start = Instant::now();
        let answered: Vec<usize> = clients.into_iter().map(|client| world.run_until(client)).collect();
        assert_eq!(answered, [50, 50, 50, 50, 50, 50, 50, 0]);
        assert!(start.elapsed() < 20 * SECOND, "{}", start.elapsed());
        world.run_for(10 * SECOND);
        assert_eq!(rig.frames_in_use(), 0);
    });
}
