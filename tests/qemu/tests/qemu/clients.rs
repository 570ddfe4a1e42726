//! Many clients, and clients that misbehave.

use std::io::Write;
use std::thread;

use mobgate_qemu::wait_for;

use crate::{Bench, registers};

#[test]
fn sixteen_clients_are_served_at_a_time_and_one_more_takes_an_idle_ones_place() {
    let bench = Bench::new();
    let mut clients: Vec<_> = (0..16).map(|_| bench.machine.client()).collect();
    thread::scope(|scope| {
        for (at, client) in clients.iter_mut().enumerate() {
            scope.spawn(move || {
                let unit = [1, 2, 3, 65, 66, 67, 129, 130][at % 8];
                for address in 0..20 {
                    assert_eq!(client.read(unit, address, 2), registers(unit, address as u8, 2));
                }
            });
        }
    });
    let shown = bench.machine.console().run("show clients");
    assert_eq!(shown.lines().count(), 1 + 16, "{shown}");
    // The first client has been idle for longest by now.
    clients[1..].iter_mut().for_each(|client| drop(client.read(1, 0, 1)));
    let mut newcomer = bench.machine.client();
    assert_eq!(newcomer.read(66, 0, 1), registers(66, 0, 1));
    assert!(clients[0].is_closed());
}

#[test]
fn malformed_input_and_resets_cost_nobody_else_anything() {
    let bench = Bench::new();
    let mut good = bench.machine.client();
    // QEMU accepts a connection before the board does: only a response tells that its socket is taken.
    assert_eq!(good.read(1, 0, 1), registers(1, 0, 1));
    let sockets = bench.machine.figures().sockets_free();

    let mut foreign = bench.machine.client();
    // Another protocol's frame is skipped, the connection stays.
    foreign.send_raw(&[0, 1, 0, 9, 0, 2, 1, 3]);
    assert_eq!(foreign.read(1, 0, 1), registers(1, 0, 1));
    for lengths in [[0, 0], [0, 1], [0, 255], [255, 255]] {
        let mut malformed = bench.machine.client();
        malformed.send_raw(&[&[0, 1, 0, 0][..], &lengths, &[1, 3, 0, 0, 0, 1]].concat());
        assert!(malformed.is_closed(), "length {lengths:?}");
        assert_eq!(good.read(65, 0, 1), registers(65, 0, 1));
    }
    assert_eq!(foreign.ask(1, &[3, 0, 0, 0]), [0x83, 3], "a request cut short");
    assert_eq!(foreign.ask(1, &[3, 0, 0, 0, 126]), [0x83, 3], "more registers than a frame holds");
    for sent in 0..12 {
        let mut leaving = bench.machine.client();
        leaving.send_raw(&[0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 1][..sent]);
        if sent % 2 == 0 {
            leaving.reset()
        } else {
            drop(leaving)
        }
        assert_eq!(good.read(129, 0, 1), registers(129, 0, 1));
    }
    drop(foreign);
    let (mut console, mut figures) = (bench.machine.console(), bench.machine.figures());
    wait_for("all but one to leave", || (console.run("show clients").lines().count() == 2).then_some(()));
    wait_for("their sockets", || (figures.sockets_free() == sockets).then_some(()));
    assert_eq!(console.count("-", "frames-free"), console.count("-", "frames"));
    assert_eq!(console.count("P502", "malformed"), 5);
}

#[test]
fn noise_on_a_line_ends_with_the_noise() {
    let bench = Bench::unwired();
    bench.machine.wire(2, &bench.buses[1]);
    let mut client = bench.machine.client();
    let mut console = bench.machine.console();
    let mut line = bench.machine.uart(1);
    line.write_all(&[0x55; 700]).unwrap();
    assert_eq!(client.read(65, 0, 1), registers(65, 0, 1), "other lines do not hear it");
    assert_eq!(client.read(1, 0, 1), [0x83, 0x0b], "nobody is there");
    drop(line);
    bench.machine.wire(1, &bench.buses[0]);
    wait_for("the devices' responses", || (client.read(1, 0, 1) == registers(1, 0, 1)).then_some(()));
    assert!(console.count("P1", "noise") > 0);
}
