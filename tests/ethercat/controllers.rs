//! What controllers differ in: how many SyncManagers they have, and how they interrupt. The suite runs on all of them.

use embassy_time::Duration;
use ethercat_subdevice::sync_manager::Channel;
use mobgate_simulator::esc::Kind;
use mobgate_simulator::sub_device::{Counted, direct};

use crate::bench::{Bench, INIT, MAILBOX_128, OP, PRE_OP, Rig, SAFE_OP, Start};

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
