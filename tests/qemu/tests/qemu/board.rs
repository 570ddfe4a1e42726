//! The board itself: its console, its memory, its network, its end.

use std::process::Command;
use std::time::Duration;

use mobgate_qemu::{Machine, image, wait_for};

use crate::{Bench, registers};

/// Rounds of commands whose output is not read at once.
const ROUNDS_READ_LATE: usize = 50;

#[test]
fn a_session_at_the_console_edits_completes_shows_and_says_what_is_wrong() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    let ports = console.run("show ports");
    for port in ["P1", "P2", "P3", "P502"] {
        assert!(ports.lines().any(|line| line.starts_with(port) && line.ends_with("open")), "{ports}");
    }
    assert!(console.run("show version").contains("on QEMU mps2-an386"));
    assert!(console.run("prot P9").contains("did you mean port?"));
    assert!(console.run("port P9 serial uart9 rtu client 81E").contains("expected a format"));
    // Left arrow, a letter put in, and Tab.
    console.type_keys("show vrsion\x1b[D\x1b[D\x1b[D\x1b[D\x1b[De\r");
    assert!(console.read_until("up ").contains("mobgate"));
    console.read_until("> ");
    console.type_keys("show conf\t\r");
    assert!(console.read_until("route P502 129-247 * * P3").contains("port P502 tcp server 502"));
    console.read_until("> ");
    assert_eq!(console.run("port P4 serial uart9 rtu client"), "");
    wait_for("the fault", || {
        console.run("show ports").contains("this board has uart1, uart2 and uart3").then_some(())
    });
}

#[test]
fn a_terminal_that_reads_late_gets_everything() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    let config = console.run("show config");
    // More than the emulator's socket holds: its UART stands still until the next look, and goes on while more is written.
    for _ in 0..ROUNDS_READ_LATE {
        (0..8).for_each(|_| console.type_keys("show config\r"));
        std::thread::sleep(Duration::from_millis(4)); // what has come is not read meanwhile
        for _ in 0..8 {
            console.read_until("show config\r\n");
            assert!(console.read_until("> ").starts_with(&config));
        }
    }
}

#[test]
fn saved_settings_outlive_the_board_and_unsaved_ones_do_not() {
    let mut bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run("route P502 248 * =3 P1"), "");
    assert_eq!(console.run("save").trim_end(), "saved");
    assert_eq!(console.run("delete routes"), "");
    drop(console);
    bench.restart();
    let mut client = bench.machine.client();
    assert_eq!(client.read(248, 0, 1), registers(3, 0, 1));
    assert_eq!(client.read(65, 0, 1), registers(65, 0, 1));

    // By the command, too: the same processor begins anew.
    let mut console = bench.machine.console();
    assert_eq!(console.run("delete route 4"), "");
    console.type_keys("reboot\r");
    bench.machine.logs_times("network up", 2);
    assert_eq!(bench.machine.client().read(248, 0, 1), registers(3, 0, 1));
}

#[test]
fn the_address_is_given_or_set_and_the_cable_may_come_and_go() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    let shown = console.run("show network");
    let has_address =
        shown.contains("up   10.0.2.15/24       10.0.2.2") && shown.trim_end().ends_with("dhcp");
    assert!(has_address, "{shown}");
    assert_eq!(console.run("network address 10.0.2.15/24 gateway 10.0.2.2"), "");
    assert_eq!(bench.machine.client().read(1, 0, 1), registers(1, 0, 1));
    assert!(console.run("show config").starts_with("network address 10.0.2.15/24 gateway 10.0.2.2"));

    bench.machine.monitor("set_link net off");
    wait_for("the link to go", || console.run("show network").contains("down 10.0.2.15/24").then_some(()));
    bench.machine.monitor("set_link net on");
    wait_for("the link to come", || console.run("show network").contains("up   10.0.2.15/24").then_some(()));
    assert_eq!(bench.machine.client().read(1, 0, 1), registers(1, 0, 1));

    assert_eq!(console.run("network dhcp name cabinet-7"), "");
    bench.machine.logs_times("network up", 2);
    assert_eq!(bench.machine.client().read(1, 0, 1), registers(1, 0, 1));
}

#[test]
fn a_panic_ends_the_emulator_with_a_status_that_is_not_0() {
    assert_eq!(Machine::status_without_flash().code(), Some(1));
}

/// The addresses of a function of the image.
fn function(name: &str) -> std::ops::Range<u32> {
    let output =
        Command::new("nm").arg("--print-size").arg(image::build()).output().expect("nm, of binutils");
    let symbols = String::from_utf8(output.stdout).unwrap();
    let symbol = symbols.lines().find(|line| line.ends_with(name)).expect("the function");
    let numbers = symbol.split(' ').map_while(|word| u32::from_str_radix(word, 16).ok());
    let [start, size] = numbers.take(2).collect::<Vec<_>>()[..] else { panic!("{symbol}") };
    start..start + size
}

#[test]
fn a_fault_restarts_the_board_and_its_log_says_where_it_was() {
    let bench = Bench::told(tempfile::tempdir().unwrap(), "restart fault");
    let shown = bench.machine.console().run("show log");
    let (status, rest) =
        shown.split_once("the last run ended: fault ").unwrap().1.split_once(" at 0x").unwrap();
    assert_eq!(status, "0x00008200", "a precise data bus error");
    let (address, rest) = rest.split_once(", called from").unwrap();
    let address = u32::from_str_radix(address, 16).unwrap();
    assert!(function("touch_nothing").contains(&address), "{shown}");
    assert!(rest.lines().next().unwrap().ends_with("by access to 0x90000000"), "{shown}");
    // The same processor has begun anew, and works.
    bench.wire();
    assert_eq!(bench.machine.client().read(1, 0, 1), registers(1, 0, 1));
}
