//! Which request a response belongs to, where there are no transaction ids.

use std::collections::VecDeque;

use mobgate::gateway::outstanding::{
    DIAGNOSTIC_PROOF, Match, OF_UNIT_MAX, OUTSTANDING_MAX, Outstanding, Shape,
};

use crate::prelude::*;

const PORT: u8 = 1;
const UNIT: u8 = 72;
const LONGER: [u8; 5] = [3, 0, 7, 0, 2];
const WRITE: [u8; 5] = [6, 0, 7, 0, 1];

fn sent(outstanding: &mut Outstanding, request: &[u8]) {
    outstanding.sent(PORT, UNIT, Shape::of_request(request), Purpose::Request);
}

fn is_unique(outstanding: &Outstanding, request: &[u8]) -> bool {
    outstanding.is_unique(PORT, UNIT, &Shape::of_request(request))
}

fn whose(outstanding: &mut Outstanding, response: &[u8]) -> Match {
    outstanding.match_response(PORT, UNIT, response).whose
}

#[test]
fn a_response_settles_its_request_and_all_before() {
    let mut outstanding = Outstanding::new();
    for request in [&READ, &WRITE, &[4, 0, 0, 0, 1]] {
        sent(&mut outstanding, request);
    }
    assert_eq!(whose(&mut outstanding, &WRITE), Match::Earlier(Purpose::Request));
    assert_eq!(whose(&mut outstanding, &[4, 2, 0, 0]), Match::Latest(Purpose::Request));
    assert!(outstanding.is_in_step(PORT, UNIT, false));
    assert_eq!(whose(&mut outstanding, &[3, 2, 0, 0]), Match::Unsolicited, "it was settled by the first");
}

#[test]
fn a_response_that_fits_several_is_nobodys_and_settles_the_first() {
    let mut outstanding = Outstanding::new();
    sent(&mut outstanding, &READ);
    sent(&mut outstanding, &READ);
    assert_eq!(whose(&mut outstanding, &[3, 2, 0, 0]), Match::Several);
    assert_eq!(whose(&mut outstanding, &[3, 2, 0, 0]), Match::Latest(Purpose::Request));
    assert!(outstanding.is_in_step(PORT, UNIT, false));
}

#[test]
fn the_function_decides_whether_a_request_is_unique_since_its_exception_has_nothing_else() {
    let mut outstanding = Outstanding::new();
    assert!(is_unique(&outstanding, &READ));
    sent(&mut outstanding, &READ);
    assert!(!is_unique(&outstanding, &LONGER));
    assert!(outstanding.proves(PORT, UNIT, &Shape::of_request(&LONGER)), "its normal response is longer");
    assert!(!outstanding.proves(PORT, UNIT, &Shape::of_request(&READ)));
    assert!(is_unique(&outstanding, &WRITE));
    assert!(outstanding.is_unique(PORT, UNIT + 1, &Shape::of_request(&READ)), "another unit");
    assert!(outstanding.is_unique(PORT + 1, UNIT, &Shape::of_request(&READ)), "another port");
}

#[test]
fn what_responses_have_in_common_is_their_shape() {
    assert_ne!(Shape::of_request(&[]), Shape::of_request(&[1]), "not even a function");
    let alike = [
        // One to eight coils take one byte.
        ([1, 0, 0, 0, 1], [1, 0, 9, 0, 8], true),
        ([1, 0, 0, 0, 8], [1, 0, 0, 0, 9], false),
        ([3, 0, 0, 0, 2], [3, 9, 9, 0, 2], true),
        ([3, 0, 0, 0, 2], [4, 0, 0, 0, 2], false),
        ([6, 0, 1, 0, 2], [6, 0, 1, 0, 2], true),
        ([6, 0, 1, 0, 2], [6, 0, 1, 0, 3], false),
        ([8, 0, 0, 0, 1], [8, 0, 0, 0, 2], false),
        ([8, 0, 2, 0, 1], [8, 0, 2, 0, 2], true),
        ([65, 0, 0, 0, 1], [65, 0, 0, 0, 2], true),
    ];
    for (one, other, same) in alike {
        assert_eq!(Shape::of_request(&one) == Shape::of_request(&other), same, "{one:?} {other:?}");
    }
}

#[test]
fn exceptions_that_a_gateway_between_may_have_sent_settle_nothing() {
    for (code, settles) in
        [(1, true), (2, true), (4, true), (5, false), (6, false), (0x0a, false), (0x0b, false)]
    {
        let mut outstanding = Outstanding::new();
        sent(&mut outstanding, &WRITE);
        sent(&mut outstanding, &READ);
        assert_eq!(whose(&mut outstanding, &[0x83, code]), Match::Latest(Purpose::Request));
        assert_eq!(outstanding.is_in_step(PORT, UNIT, false), settles, "{code}");
    }
}

#[test]
fn an_unsolicited_response_may_come_again() {
    let mut outstanding = Outstanding::new();
    for _ in 0..3 {
        whose(&mut outstanding, &[3, 2, 0, 0]);
        assert!(!is_unique(&outstanding, &READ));
    }
    let proof = outstanding.diagnostic(7);
    outstanding.sent(PORT, UNIT, Shape::of_request(&proof), Purpose::Diagnostic);
    assert_eq!(whose(&mut outstanding, &proof), Match::Latest(Purpose::Diagnostic));
    assert!(is_unique(&outstanding, &READ));
}

#[test]
fn where_more_is_outstanding_than_is_remembered_only_a_number_proves_anything() {
    let mut outstanding = Outstanding::new();
    for address in 0..=OF_UNIT_MAX as u8 {
        sent(&mut outstanding, &[6, 0, address, 0, 0]);
    }
    assert!(!is_unique(&outstanding, &READ));
    assert!(!outstanding.proves(PORT, UNIT, &Shape::of_request(&READ)));
    assert_eq!(whose(&mut outstanding, &[3, 2, 0, 0]), Match::Several, "anything may have been asked");
    let proof = outstanding.diagnostic(7);
    assert_eq!(proof[..3], DIAGNOSTIC_PROOF);
    outstanding.sent(PORT, UNIT, Shape::of_request(&proof), Purpose::Diagnostic);
    assert_eq!(whose(&mut outstanding, &proof), Match::Latest(Purpose::Diagnostic));
    assert!(outstanding.is_in_step(PORT, UNIT, false));
}

#[test]
fn it_is_known_of_each_unit_by_itself_that_more_is_outstanding_than_is_remembered() {
    for unit in 0..=255 {
        let mut outstanding = Outstanding::new();
        outstanding.forget(PORT, unit);
        for other in 0..=255 {
            assert_eq!(outstanding.is_in_step(PORT, other, false), other != unit, "{other}, not {unit}");
        }
        assert!(outstanding.is_in_step(PORT + 1, unit, false));
        outstanding.settle_all(PORT, unit);
        assert!(outstanding.is_in_step(PORT, unit, false), "{unit}");
    }
}

#[test]
fn a_unit_that_is_asked_in_vain_for_ever_does_not_cost_another_what_is_known_of_it() {
    let mut outstanding = Outstanding::new();
    outstanding.sent(PORT, UNIT + 1, Shape::of_request(&READ), Purpose::Request);
    (0..2 * OUTSTANDING_MAX).for_each(|_| sent(&mut outstanding, &READ));
    assert!(outstanding.is_in_step(PORT, UNIT + 1, true));
    assert!(!outstanding.is_unique(PORT, UNIT + 1, &Shape::of_request(&READ)));
}

#[test]
fn the_numbers_of_proofs_come_again_after_all_others_only() {
    let mut outstanding = Outstanding::new();
    let mut seen = vec![false; 65_536];
    for nth in 0..65_536 {
        let [.., high, low] = outstanding.diagnostic(12_345);
        let number = usize::from(u16::from_be_bytes([high, low]));
        assert!(!std::mem::replace(&mut seen[number], true), "{number} again after {nth}");
    }
}

/// A request on its way through a device that responds in order, or not at all.
struct InPipe {
    serial: u64,
    response: Vec<u8>,
}

fn response(request: &[u8], random: &mut Random) -> Vec<u8> {
    let function = request[0];
    if random.chance(0.2) {
        return vec![function | 0x80, [2, 4, 6, 0x0b][random.index(4)]];
    }
    match function {
        1 => vec![1, request[4].div_ceil(8), 0],
        3 | 4 => [vec![function, 2 * request[4]], vec![0; 2 * usize::from(request[4])]].concat(),
        _ => request.to_vec(),
    }
}

proptest! {
    /// The rule as a port applies it, beside a device of which it is known which response answers which request.
    #[test]
    fn a_response_that_is_taken_is_the_one_to_the_request(seed: u64) {
        let mut random = Random::new(seed);
        let mut outstanding = Outstanding::new();
        let mut pipe: VecDeque<InPipe> = VecDeque::new();
        let (mut serial, mut taken) = (0, 0);
        for _ in 0..500 {
            let request = match random.index(5) {
                0 => vec![1, 0, 0, 0, random.within(1..=16) as u8],
                1 | 2 => vec![3, 0, 0, 0, random.within(1..=3) as u8],
                3 => vec![4, 0, 0, 0, 1],
                _ => vec![6, 0, random.within(0..=2) as u8, 0, 1],
            };
            let shape = Shape::of_request(&request);
            let (request, purpose) = if outstanding.is_unique(PORT, UNIT, &shape) {
                (request, Purpose::Request)
            } else if random.chance(0.5) && outstanding.proves(PORT, UNIT, &Shape::of_request(&LONGER)) {
                (LONGER.to_vec(), Purpose::Read)
            } else {
                (outstanding.diagnostic(seed).to_vec(), Purpose::Diagnostic)
            };
            outstanding.sent(PORT, UNIT, Shape::of_request(&request), purpose);
            serial += 1;
            // It is lost on its way, or its response is, or the response comes some time.
            if random.chance(0.8) {
                pipe.push_back(InPipe { serial, response: response(&request, &mut random) });
            }
            for _ in 0..random.index(3) {
                let Some(InPipe { serial: answered, response }) = pipe.pop_front() else { break };
                if let Match::Latest(of) = whose(&mut outstanding, &response) {
                    prop_assert_eq!(answered, serial, "{:?} was taken for the response to {:?}", response, request);
                    prop_assert_eq!(of, purpose);
                    taken += 1;
                }
            }
        }
        prop_assert!(taken > 20, "only {} responses were taken", taken);
    }
}
