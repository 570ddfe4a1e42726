//! The controller at register level and the LAN9252 in front of it: what ETG.1000 and the data sheets say of them.

mod buffers;
mod clocks;
mod commands;
mod control;
mod eeprom;
mod fmmu;
mod lan9252;
mod line;
mod mailbox;
mod registers;

use ethercat_esc::{Segment, World, now, samples};

/// A world with a line of so many chips.
fn in_line<'w>(chips: u16) -> (World<'w>, Segment) {
    (World::new(1), samples::line(chips))
}

/// A world with one chip whose SyncManagers and FMMUs are set up.
fn set_up<'w>() -> (World<'w>, Segment) {
    (World::new(1), samples::ready())
}

/// What the processor at the first chip reads.
fn processor_reads(segment: &Segment, address: u16, bytes: usize) -> Vec<u8> {
    let mut into = vec![0; bytes];
    segment.chip(0).borrow_mut().read(now(), address, &mut into);
    into
}
