//! What sessions say of settings that are not saved, and of saved ones that the board cannot have.

use std::string::ToString;

use super::{Memory, Mode, new_gateway, pipe, session, std};
use crate::frame::{FramePool, Slot};
use crate::gateway::{Gateway, Ports};

#[test]
fn the_prompt_shows_at_every_console_that_settings_are_not_saved() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |keys: &str| {
        let printed = session(gateway, &mut store, Mode::Echo, keys, 3);
        printed.rsplit('\n').next().unwrap().split('>').next().unwrap().trim_start().to_string()
    };
    assert_eq!(typed("save\r"), "mobgate");
    assert_eq!(typed("port P1 serial uart1 rtu client\r"), "mobgate*");
    assert_eq!(typed(""), "mobgate*", "another session's");
    assert_eq!(typed("save force\r"), "mobgate");
    assert_eq!(typed("edit port P1 9x00\r"), "mobgate");
    assert_eq!(typed("edit port P1 19200\r"), "mobgate", "it was so before");
    assert_eq!(typed("edit port P1 9600\r"), "mobgate*");
    assert_eq!(typed("load\r"), "mobgate");
    store.absent = true;
    let keys = "edit port P1 9600\rsave\r";
    assert!(session(gateway, &mut store, Mode::Echo, keys, 3).contains("\rmobgate*> "));
    assert!(gateway.has_unsaved(), "a save that failed has saved nothing");
}

#[test]
fn save_knows_one_word() {
    let gateway = &new_gateway();
    let printed = session(gateway, &mut Memory::default(), Mode::Plain, "save forse\nsave force now\n", 9);
    let expected = "error: line 1, column 6: \"forse\": expected force; did you mean force?\n\
                    error: line 2, column 12: \"now\": expected the end of the line\n";
    assert_eq!(printed, expected);
}

// Without data points such a line is refused for that.
#[cfg(feature = "points")]
#[test]
fn a_saved_line_that_asks_for_what_the_board_has_not_is_named() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut load = |text: &str| {
        store.saved = text.as_bytes().to_vec();
        session(gateway, &mut store, Mode::Plain, "load", 11)
    };
    let network =
        "network lines are for boards with a network of their own; here the operating system manages it";
    assert_eq!(
        load("# one\nport P1 tcp server 502\n\n  network dhcp\n"),
        std::format!("error: line 1, saved settings: line 4, column 3: \"network\": {network}\n")
    );
    assert_eq!(
        load("port P1 tcp server 502\nport E ethercat\n"),
        "error: line 1, saved settings: line 2, column 8: \"ethercat\": this board has no EtherCAT \
         controller: it cannot have an ethercat port\n"
    );
    assert_eq!(
        load("port P1 tcp server 502 clients 30\nport P2 tcp server 503 clients 30\n"),
        "error: line 1, saved settings: line 2, column 24: \"clients\": the TCP servers need 62 connections \
         (one more each than their clients), this board has 40\n"
    );
    // What a later line sets right is no fault.
    assert_eq!(load("port P1 tcp server 502 clients 60\nedit port P1 clients 3\n"), "loaded\n");
}

#[test]
fn two_names_of_one_line_are_refused_with_both_ports() {
    let slots = [const { Slot::new() }; 8];
    let ports = Ports::<4>::new();
    let pool = FramePool::new(&slots, 4);
    let gateway = Gateway::new(&pool, &ports, &[]);
    let aliases = |one: &str, other: &str| one.trim_start_matches("tty") == other.trim_start_matches("tty");
    let gateway = gateway.with_same_device(aliases);
    let typed =
        "port P1 serial S0 rtu client\nport P2 serial S0 rtu client\nport P3 serial ttyS0 rtu server\n";
    assert_eq!(
        pipe(&gateway, typed),
        "error: line 2, column 16: \"S0\": port P1 has this device\n\
         error: line 3, ports P1 and P3 are on the same device\n"
    );
    let mut store = Memory { saved: typed.replace("port P2", "# P2").into_bytes(), ..Memory::default() };
    assert_eq!(
        session(&gateway, &mut store, Mode::Plain, "load", 11),
        "error: line 1, saved settings: line 3, column 16: \"ttyS0\": ports P1 and P3 are on the same device\n"
    );
}

#[test]
fn settings_that_are_empty_can_be_saved() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let text = "save\nport P1 tcp server 502\nload\nshow config\n";
    assert_eq!(session(gateway, &mut store, Mode::Plain, text, 11), "saved\nloaded\n");
}
