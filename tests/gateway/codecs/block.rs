//! Blocks: what several reads have in common, and each one's part of the response, against a device's memory.

use mobgate::modbus::pdu::{Block, check_request};
use mobgate_simulator::device::Memory;

use crate::prelude::*;

fn request(function: u8, first: u16, quantity: u16) -> [u8; 5] {
    let ([a, b], [c, d]) = (first.to_be_bytes(), quantity.to_be_bytes());
    [function, a, b, c, d]
}

fn block(function: u8, first: u16, quantity: u16) -> Block {
    Block::of(&request(function, first, quantity)).unwrap()
}

/// Reads near each other, of which many can be joined.
fn any_read() -> impl Strategy<Value = (u16, u16)> {
    (0..300_u16, 1..=60_u16)
}

#[test]
fn a_block_is_a_read_that_a_device_could_answer() {
    for (function, most) in [(1, 2000), (2, 2000), (3, 125), (4, 125)] {
        assert!(Block::of(&request(function, 0, most)).is_some());
        assert_eq!(Block::of(&request(function, 0, most + 1)), None);
        assert_eq!(Block::of(&request(function, 0, 0)), None);
        assert!(Block::of(&request(function, u16::MAX, 1)).is_some());
        assert_eq!(Block::of(&request(function, u16::MAX, 2)), None, "over the end of the addresses");
    }
    for other in [&[3, 0, 0, 0][..], &[3, 0, 0, 0, 1, 0], &[5, 0, 0, 0, 1], &[6, 0, 0, 0, 1], &[]] {
        assert_eq!(Block::of(other), None);
    }
}

#[test]
fn blocks_touch_overlap_or_lie_apart() {
    let ten = block(3, 10, 10);
    for (first, quantity, distance) in [
        (20, 1, 0),
        (21, 1, 1),
        (9, 1, 0),
        (8, 1, 1),
        (0, 2, 8),
        (12, 2, 0),
        (0, 100, 0),
        (u16::MAX, 1, 65_515),
    ] {
        let other = block(3, first, quantity);
        assert_eq!((ten.distance(&other), other.distance(&ten)), (distance, distance), "{first}");
    }
}

#[test]
fn blocks_of_different_functions_and_blocks_too_far_apart_have_no_hull() {
    assert_eq!(block(3, 0, 1).hull(&block(4, 1, 1)), None);
    assert_eq!(block(3, 0, 1).hull(&block(3, 124, 1)), Some(block(3, 0, 125)));
    assert_eq!(block(3, 0, 1).hull(&block(3, 125, 1)), None);
    assert_eq!(block(1, 0, 1).hull(&block(1, 1999, 1)), Some(block(1, 0, 2000)));
    assert_eq!(block(1, 0, 1).hull(&block(1, 2000, 1)), None);
    assert_eq!(block(4, 0, 1).hull(&block(4, u16::MAX, 1)), None);
}

proptest! {
    #[test]
    fn each_part_is_what_the_device_would_have_answered_to_it_alone(
        function in 1..=4_u8,
        base in 0..9_000_u16,
        reads in vec(any_read(), 1..12),
        data in any::<u64>(),
    ) {
        let mut memory = Memory::new(7);
        for (at, (coil, input)) in memory.coils.iter_mut().zip(&mut memory.discrete_inputs).enumerate() {
            (*coil, *input) = (data.rotate_left(at as u32 * 7) & 1 == 1, data.rotate_left(at as u32 * 5) & 2 == 2);
        }
        let reads: Vec<Block> =
            reads.into_iter().map(|(first, quantity)| block(function, base + first, quantity)).collect();
        let joined = reads.iter().fold(reads[0], |joined, read| joined.hull(read).unwrap_or(joined));
        prop_assert_eq!(check_request(&joined.request()), Ok(()));
        let response = memory.execute(&joined.request()).unwrap();
        for read in reads {
            let mut out = [0xa5; PDU_BYTES_MAX];
            let part = joined.part(&response, &read, &mut out);
            let alone = memory.execute(&read.request()).unwrap();
            if joined.hull(&read) == Some(joined) {
                prop_assert_eq!(part, Some(&alone[..]));
                prop_assert_eq!(fits(&read.request(), &alone), Ok(()));
            } else {
                prop_assert_eq!(part, None);
            }
        }
    }

    #[test]
    fn a_hull_has_both_and_nothing_beyond(
        function in 1..=4_u8, one in any_read(), other in any_read(),
    ) {
        let [one, other] = [one, other].map(|(first, quantity)| block(function, first, quantity));
        let (a, b) = (one.extent(), other.extent());
        match one.hull(&other).map(|hull| hull.extent()) {
            Some(hull) => {
                prop_assert_eq!((hull.first, hull.last), (a.first.min(b.first), a.last.max(b.last)));
                let quantities = |block: &Block| block.extent().last - u32::from(block.extent().first) + 1;
                let apart = u32::from(one.distance(&other));
                prop_assert!(quantities(&one.hull(&other).unwrap()) <= quantities(&one) + quantities(&other) + apart);
            }
            None => prop_assert!(a.last.max(b.last) - u32::from(a.first.min(b.first)) >= 125 && function > 2),
        }
        prop_assert_eq!(one.hull(&other), other.hull(&one));
        prop_assert_eq!(Block::of(&one.request()), Some(one));
    }

    #[test]
    fn no_response_whatever_its_bytes_makes_a_part_that_does_not_fit(
        function in 1..=4_u8, one in any_read(), other in any_read(), response in vec(any::<u8>(), 0..260),
    ) {
        let [one, other] = [one, other].map(|(first, quantity)| block(function, first, quantity));
        let mut out = [0; PDU_BYTES_MAX];
        if let Some(part) = one.part(&response, &other, &mut out) {
            prop_assert_eq!(fits(&other.request(), part), Ok(()));
        }
    }
}
