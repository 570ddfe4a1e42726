//! Responses that are kept: a pure part.

use mobgate::port::client::cache::{Cache, CacheKey, RESPONSE_BYTES_MAX, RESPONSES_MAX};

use crate::prelude::*;

const NOW: Instant = Instant::from_secs(10);
const AGE: Duration = Duration::from_secs(1);

fn question(unit: u8, address: u8) -> CacheKey {
    CacheKey::new(unit, &[3, 0, address, 0, 1]).unwrap()
}

#[test]
fn only_reads_of_coils_inputs_and_registers_are_kept() {
    for function in 0..=255 {
        let kept = CacheKey::new(1, &[function, 0, 0, 0, 1]).is_some();
        assert_eq!(kept, (1..=4).contains(&function), "{function}");
    }
    assert_eq!(CacheKey::new(1, &[]), None);
    assert_eq!(CacheKey::new(1, &[3, 0, 0, 0]), None);
    assert_eq!(CacheKey::new(1, &[3, 0, 0, 0, 1, 0]), None);
}

#[test]
fn the_oldest_responses_go_for_new_ones() {
    let mut cache = Cache::new();
    for address in 0..=RESPONSES_MAX as u8 {
        cache.keep(question(1, address), &[3, 2, 0, address], NOW);
    }
    assert_eq!(cache.len(), RESPONSES_MAX);
    assert_eq!(cache.response(question(1, 0), NOW, AGE), None);
    assert_eq!(cache.response(question(1, 1), NOW, AGE), Some(&[3, 2, 0, 1][..]));
    cache.keep(question(1, 99), &[3; RESPONSE_BYTES_MAX + 1], NOW);
    assert!(cache.is_empty(), "a response that cannot be leaves nothing behind");
}

#[derive(Debug, Clone)]
enum Step {
    Keep(u8, u8, usize),
    Written(u8),
    Ask(u8, u8, u64),
}

fn any_step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (1..4_u8, 0..8_u8, 1..254_usize).prop_map(|(unit, address, length)| Step::Keep(unit, address, length)),
        1 => (0..4_u8).prop_map(Step::Written),
        6 => (1..4_u8, 0..8_u8, 0..60_u64).prop_map(|(unit, address, age)| Step::Ask(unit, address, age)),
    ]
}

/// A response, with the question and the moment.
type Kept = ((u8, u8), u64, Vec<u8>);

proptest! {
    /// What is given is the newest response to the question, not too old, and no older than a write; only the oldest ones are
    /// forgotten, and only for want of room.
    #[test]
    fn a_response_from_memory_is_the_last_one_and_new_enough(steps in prop::collection::vec(any_step(), 1..200)) {
        let mut cache = Cache::new();
        let mut model: Vec<Kept> = Vec::new();
        for (step, now) in steps.into_iter().zip(0_u64..) {
            match step {
                Step::Keep(unit, address, length) => {
                    let response = vec![now as u8; length];
                    cache.keep(question(unit, address), &response, Instant::from_secs(now));
                    model.retain(|(asked, ..)| *asked != (unit, address));
                    model.push(((unit, address), now, response));
                    while model.len() > RESPONSES_MAX
                        || model.iter().map(|(.., response)| response.len()).sum::<usize>() > RESPONSE_BYTES_MAX
                    {
                        model.remove(0);
                    }
                }
                Step::Written(unit) => {
                    cache.written(unit);
                    model.retain(|((of, _), ..)| unit != 0 && *of != unit);
                }
                Step::Ask(unit, address, age) => {
                    let (at, age) = (Instant::from_secs(now), Duration::from_secs(age));
                    let known = model.iter().find(|(asked, ..)| *asked == (unit, address));
                    let fit = known.filter(|(_, sent, _)| now - sent <= age.as_secs());
                    let expected = fit.map(|(.., response)| &response[..]);
                    prop_assert_eq!(cache.response(question(unit, address), at, age), expected);
                }
            }
            prop_assert_eq!(cache.len(), model.len());
        }
    }
}
