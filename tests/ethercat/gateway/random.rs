//! Random configurations: taken over as a model says, which computes the layout cell by cell, or not at all.

use std::collections::BTreeSet;

use super::objects::{configure_at, layout, objects, read, reason, write};
use crate::prelude::*;

const SLAVES: usize = 32;

/// The layouts, unless the images do not fit into so many bytes of inputs and outputs.
fn model(slaves: &[Vec<u16>], room: [usize; 2]) -> Option<Vec<[u16; 10]>> {
    let (mut input, mut output) = (Vec::new(), Vec::new());
    let mut layouts = Vec::new();
    for slave in slaves {
        let part = |buffer: &mut Vec<usize>, kinds: &[usize], room: usize| {
            let start = buffer.len();
            let mut places = vec![start as u16];
            for &kind in kinds {
                let (count, first) = (slave[1 + 2 * kind], slave[2 + 2 * kind]);
                (count == 0 || u32::from(first) + u32::from(count) - 1 <= 65_535).then_some(())?;
                places.push(buffer.len() as u16);
                let bytes: BTreeSet<usize> = (0..usize::from(count))
                    .flat_map(|cell| if kind < 2 { vec![cell / 8] } else { vec![2 * cell, 2 * cell + 1] })
                    .collect();
                buffer.extend(bytes);
            }
            places.push(buffer.len().saturating_sub(1).max(start) as u16);
            (buffer.len() <= room).then_some(places)
        };
        let places = [part(&mut input, &[0, 1, 2, 3], room[0])?, part(&mut output, &[0, 3], room[1])?];
        layouts.push(places.concat().try_into().unwrap());
    }
    Some(layouts)
}

fn random_slave(random: &mut Random) -> Vec<u16> {
    let mut settings = vec![random.within(1..=247) as u16];
    for bits in [true, true, false, false] {
        let most = if bits { 70 } else { 9 };
        let most = if random.chance(0.005) { 65_535 } else { most };
        let count = random.within(0..=most) as u16;
        let last = 65_536 - u64::from(count);
        let address =
            if random.chance(0.01) { 65_535 - random.within(0..=80) } else { random.within(0..=last) };
        settings.extend([count, address.min(65_535) as u16]);
    }
    settings
}

/// Assigns PDOs that carry images of a random size; how many bytes of inputs and of outputs.
fn random_assignment(random: &mut Random, objects: &mut GatewayObjects<'_>) -> [usize; 2] {
    let (inputs, outputs) = (random.index(4), random.index(4));
    objects.assigned(Channel::Inputs, &[0x1a02, 0x1a00, 0x1a04, 0x1a05][..=inputs]);
    objects.assigned(Channel::Outputs, &[0x1601, 0x1602, 0x1603][..outputs]);
    [inputs, outputs].map(|pdos| [0, 120, 256, 512][pdos])
}

#[test]
fn random_configurations_are_taken_over_as_a_model_says_or_not_at_all() {
    let mut random = Random::new(7);
    let (mut good, mut bad, mut long, mut many) = (0, 0, 0, 0);
    let (place, mut objects) = objects();
    for round in 0..3_000_u32 {
        write(&mut objects, 0x2005, 2, 0).unwrap();
        let room = random_assignment(&mut random, &mut objects);
        let count = random.index(SLAVES + 1);
        let slaves: Vec<_> = (0..count).map(|_| random_slave(&mut random)).collect();
        write(&mut objects, 0x2000, 1, count as u32).unwrap();
        for (slave, nth) in slaves.iter().zip(0..) {
            // The first four have two places.
            let index = if nth < 4 && random.chance(0.5) { 0x2001 + nth } else { 0x2100 + nth };
            configure_at(&mut objects, index, slave);
        }
        // What is not taken over must leave this as it is.
        objects.outputs(0x1600, &[round as u8; 120]);
        objects.outputs(0x1603, &[round as u8; 256]);
        let before = place.outputs(<[u8]>::to_vec);
        let taken = write(&mut objects, 0x2005, 1, 1);
        let layouts: Vec<_> = (0..SLAVES as u16).map(|slave| layout(&mut objects, slave)).collect();
        let in_use = (place.is_running(), read(&mut objects, 0x2005, 2));
        assert_eq!(in_use, (taken.is_ok(), taken.is_ok().into()));
        match model(&slaves, room) {
            Some(mut expected) => {
                assert_eq!(taken, Ok(()), "{room:?} {slaves:?}");
                long += usize::from(expected.iter().any(|layout| layout[5] > 256));
                expected.resize(SLAVES, [0; 10]);
                assert_eq!(layouts, expected);
                place.outputs(|outputs| assert_eq!(outputs, [0; 512]));
                good += 1;
                many += usize::from(count > 16);
            }
            None => {
                assert_eq!(taken, Err(Abort::Incompatible), "{room:?} {slaves:?}");
                assert!(reason(&mut objects).starts_with("slave "));
                assert_eq!(layouts, [[0; 10]; SLAVES], "none is in use");
                place.outputs(|outputs| assert_eq!(outputs, before));
                bad += 1;
            }
        }
    }
    let are_enough = good > 300 && bad > 300 && long > 50 && many > 10;
    assert!(are_enough, "{good} good, {bad} bad, {long} long, {many} many");
}
