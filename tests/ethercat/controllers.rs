//! What controllers differ in: how many SyncManagers they have, and how they interrupt. The suite runs on all of them.

use std::process::Command;

use mobgate_simulator::sub_device::{Counted, exchange_at_pace, spi_traffic};

use crate::prelude::*;

#[test]
fn a_main_device_that_writes_all_eight_sync_managers_leaves_no_event_behind() {
    for state in [INIT, PRE_OP, SAFE_OP, OP] {
        let mut counts = None;
        let start = Start { kind: Kind::ET1100, pause: Duration::from_micros(50), edges: false };
        let mut rig = Rig::start(&MAILBOX_128, Bench::default(), start, |chip| {
            let (esc, interrupt) = direct(chip);
            let esc = Counted::new(esc, Channel::MailboxOut.registers());
            counts = Some(esc.counts());
            (esc, interrupt)
        });
        rig.bring_to(state);
        let looks = counts.unwrap();
        let before = looks.events.get();
        for unused in 4..8 {
            assert_eq!(rig.write(0x0800 + 8 * unused, &[0; 8]), 1);
        }
        rig.pass(1);
        assert_eq!(rig.segment.chip(0).borrow().peek::<1>(0x0220)[0] & 0x10, 0, "in {state}");
        let looked = looks.events.get() - before;
        assert!(looked < 20, "in {state}: {looked} looks for four changes");
        assert_eq!(rig.status(), (state, 0));
    }
}

#[test]
fn a_chip_whose_memory_is_slower_than_the_spi_reaches_op_and_stays_there() {
    let timing = Timing { fifo_nanos: 2_000, ..Timing::USUAL };
    let (mut rig, _) = behind_spi(InterruptPin::High, timing);
    rig.bring_to(OP);
    for fill in 0..100 {
        assert_eq!(rig.cycle(fill).1, 3);
        assert_eq!(rig.application().outputs, [fill; 120]);
    }
    assert_eq!((rig.status(), rig.application().faults.as_slice()), ((OP, 0), &[][..]));
}

#[test]
fn a_cycle_in_op_keeps_its_budget_on_the_spi() {
    for (proves, bytes, selects) in [(false, 320, 9), (true, 480, 16)] {
        let cost = spi_traffic(&GATEWAY, 200, proves).unwrap();
        println!("{cost:?}");
        assert!(cost.usual.bytes <= bytes && cost.usual.selects <= selects, "{cost:?}");
    }
}

/// The suite: all that goes by frames and looks at what comes back. Left out is what chooses its controller itself and takes long.
const SUITE: [&str; 10] = [
    "states::",
    "mailbox::",
    "sdo::",
    "information::",
    "process_data::",
    "lost_answers::inputs",
    "--skip=esc_mailbox",
    "--skip=statement_42",
    "--skip=statement_45",
    "--skip=statement_54",
];

#[test]
fn the_suite_passes_on_every_controller() {
    let this = std::env::current_exe().unwrap();
    // The first one is what the suite runs on anyway.
    for controller in &CONTROLLERS[1..] {
        let run = Command::new(&this).args(SUITE).env(CHOICE, controller.name).output().unwrap();
        let said = String::from_utf8_lossy(&run.stdout);
        let passed = said.lines().filter(|line| line.ends_with("... ok")).count();
        println!("{}: {passed} tests", controller.name);
        assert!(run.status.success() && passed > 70, "on {}: {said}", controller.name);
    }
    at_most("controllers_failed", 0, &format!("of {}", CONTROLLERS.len()), 0);
}

#[test]
fn in_the_shortest_cycle_that_is_promised_no_image_is_lost_and_in_a_shorter_one_that_is_counted() {
    for spi_hz in [20_000_000, 30_000_000] {
        // `cargo xtask bench ethercat` exchanges a hundred times as many.
        let paced = exchange_at_pace(&GATEWAY, spi_hz, 100, 1_000).unwrap();
        println!("{paced:?}");
        assert_eq!((paced.cost.bytes, paced.cost.selects), (316, 8), "what the SPI counts");
        let exchanged = paced.exchanged;
        assert_eq!((exchanged.short, exchanged.lost, exchanged.wrong, paced.missed), (0, 0, 0, 0));
        let hurried = exchange_at_pace(&GATEWAY, spi_hz, 60, 1_000).unwrap();
        assert!(hurried.exchanged.lost > 0 && hurried.missed > 0, "{hurried:?}");
        assert_eq!(hurried.exchanged.wrong, 0);
    }
}
