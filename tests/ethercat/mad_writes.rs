//! A MainDevice that writes anything anywhere: nothing of it stops the device, or keeps a MainDevice that means it from Op.

use crate::prelude::*;

/// Worlds, and rounds of each.
const WORLDS: u64 = 50;
const ROUNDS: u64 = 200;
/// Writes of a round at most.
const WRITES_MAX: usize = 30;
const MAILBOXES_AND_DATA: u64 = 0x1400;

fn rig(random: &mut Random) -> Rig<Bench> {
    let pause = Duration::from_millis(2);
    // Most are quick to simulate.
    match random.index(6) {
        0..3 => Rig::reached_by(&MAILBOX_128, Bench::default(), pause, direct),
        3 | 4 => {
            let start = Start { kind: Kind::ET1100, pause, edges: true };
            Rig::start(&MAILBOX_128, Bench::default(), start, direct)
        }
        _ => behind_spi(InterruptPin::High, Timing::USUAL).0,
    }
}

/// Anything, mostly where it hurts.
fn write(rig: &mut Rig<Bench>, random: &mut Random) {
    let address = match random.index(8) {
        0 => 0x0120,
        1..4 => random.within(0x0800..=0x083f) as u16,
        4 => random.within(0x0600..=0x062f) as u16,
        5 => random.within(0x1000..=MAILBOXES_AND_DATA) as u16,
        _ => random.within(0x0000..=0x0fff) as u16,
    };
    let bytes: Vec<u8> = (0..=random.index(8)).map(|_| [random.byte(), 1, 0][random.index(3)]).collect();
    rig.segment.poke(0, address, &bytes);
    if random.chance(0.02) {
        b"RES".iter().for_each(|byte| assert!(rig.segment.poke(0, 0x0040, &[*byte]) <= 1));
    }
    rig.world.run_for(Duration::from_micros(random.within(0..=300)));
}

/// A MainDevice that means it: everything anew, as after power-on, and what it must have from register to register.
fn sane(rig: &mut Rig<Bench>, seed: u64, round: u64) {
    // Until a chip that was reset is there again.
    rig.pass(200);
    rig.write(0x0120, &(INIT | ERROR).to_le_bytes());
    rig.pass(10);
    assert_eq!(rig.status(), (INIT, 0), "seed {seed}, round {round}");
    for (address, bytes) in
        [(0x0400, &[0xc2, 0x09][..]), (0x0410, &[0xe8, 0x03]), (0x0420, &[0xe8, 0x03]), (0x0980, &[0, 0])]
    {
        rig.write(address, bytes);
    }
    // No distributed clocks: register 0981h after 0980h, which says whose it is.
    rig.write(0x0981, &[0]);
    rig.write(0x0600, &[0; 128]);
    rig.write(0x0800, &[0; 64]);
    rig.bring_to(OP);
    // They may have been changed by SDO.
    assert_eq!(rig.cycle(round as u8).1, 3, "seed {seed}, round {round}");
    assert_eq!(rig.application().outputs, [round as u8; 120], "seed {seed}, round {round}");
}

#[test]
fn after_10_000_rounds_of_random_writes_a_sane_main_device_always_gets_to_op() {
    each_seed(WORLDS, |seed| {
        let mut random = Random::new(seed);
        let mut rig = rig(&mut random);
        for round in 0..ROUNDS {
            if random.chance(0.5) {
                sane(&mut rig, seed, round);
                let down = [PRE_OP, SAFE_OP, OP][random.index(3)];
                rig.request(down);
            }
            for _ in 0..=random.index(WRITES_MAX) {
                write(&mut rig, &mut random);
            }
        }
        sane(&mut rig, seed, ROUNDS);
    });
}
