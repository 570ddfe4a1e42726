//! What the board has, what it cannot run, and what it reports.

use super::*;

#[test]
fn what_the_board_cannot_run_is_refused() {
    let gateway = &new_gateway();
    let printed = pipe(gateway, "port P502 tcp server 502 clients 40\nshow config\n");
    assert!(printed.starts_with("error: line 1, the TCP servers need 41 connections"), "{printed}");
    assert_eq!(printed.lines().count(), 1);
}

#[test]
fn an_address_of_its_own_is_refused_where_the_system_has_the_network() {
    let gateway = &new_gateway();
    let refused = pipe(gateway, "network address 10.0.0.5/24\nshow network\nshow config\n");
    assert_eq!(
        refused,
        "error: line 1, network lines are for boards with a network of their own; here the operating system manages it\n\
         the operating system has the network\n"
    );
}

#[test]
fn a_board_with_a_network_of_its_own_follows_the_settings_and_shows_its_address() {
    let slots = [const { Slot::new() }; 2];
    let gateway = FramePool::new(&slots, 0);
    let ports = Ports::<0>::new();
    let gateway = Gateway::new(&gateway, &ports, &[]).with_own_network();
    assert_eq!(pipe(&gateway, "network address 10.0.0.5/24 gateway 10.0.0.1\n"), "");
    let address = StaticAddress {
        address: [10, 0, 0, 5].into(),
        prefix: 24,
        gateway: Some([10, 0, 0, 1].into()),
        dns: None,
    };
    assert_eq!(block_on(gateway.new_network()), OwnNetwork::Static(address));

    let show =
        |network| pipe_on(&gateway, &Bench { network: Some(network), ..Bench::default() }, b"show network");
    let hardware = [2, 0, 0, 0xab, 0, 1];
    assert_eq!(
        show(NetworkState { link: true, address: Some(address), hardware }),
        "LINK ADDRESS            GATEWAY         ETHERNET          SETTING\n\
         up   10.0.0.5/24        10.0.0.1        02:00:00:ab:00:01 address 10.0.0.5/24 gateway 10.0.0.1\n"
    );
    pipe(&gateway, "network dhcp");
    assert!(
        show(NetworkState { link: false, address: None, hardware })
            .ends_with("down -                  -               02:00:00:ab:00:01 dhcp\n")
    );
}

#[test]
fn the_serial_lines_are_shown_with_the_ports_that_have_them() {
    // Two names of one line.
    let gateway = new_gateway().with_same_device(|one, other| one.trim_end_matches('b') == other);
    let board = Bench { lines: &["uart1", "uart2"], ..Bench::default() };
    let printed = pipe_on(&gateway, &board, b"port meters serial uart2b rtu client\nshow lines\n");
    assert_eq!(printed, "LINE            PORT\nuart1           -\nuart2           meters\n");
    assert_eq!(pipe_on(&gateway, &Bench::default(), b"show lines\n"), "LINE            PORT\n");
}

#[test]
fn what_the_board_has_to_report_stands_above_the_transactions() {
    let gateway = &new_gateway();
    let board = Bench { events: &["reset by the watchdog", "before: it stood still"], ..Bench::default() };
    let printed = pipe_on(gateway, &board, b"show log");
    assert!(printed.starts_with("reset by the watchdog\nbefore: it stood still\n      AGE"), "{printed}");
}

#[test]
fn reboot_asks_the_board() {
    let gateway = &new_gateway();
    let system = Bench::default();
    assert_eq!(pipe_on(gateway, &system, b"reboot\n"), "starting again\n");
    assert_eq!(system.reboots.get(), 1);
}

#[test]
fn nobody_is_connected_to_a_gateway_that_nobody_runs() {
    let gateway = &new_gateway();
    assert_eq!(
        pipe(gateway, "port P502 tcp server 502\nshow clients\n"),
        "PORT            PEER                      SINCE     QUIET OPEN   REQUESTS PLACE\n"
    );
    let version = pipe(gateway, "show version");
    assert!(version.starts_with("mobgate 0.") && version.contains(" on bench, up "), "{version}");
}
