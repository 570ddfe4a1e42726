//! Which request a response belongs to, told a second time in the plainest way: by comparing it with what each request may be
//! answered with.

use std::collections::BTreeSet;

use mobgate::gateway::outstanding::{Match, OF_UNIT_MAX, OUTSTANDING_MAX, Outstanding, Settled, Shape};

use crate::prelude::*;

/// Requests, and how the normal response to each begins, as far as that can be told.
const REQUESTS: &[(&[u8], &[u8])] = &[
    (&[1, 0, 0, 0, 1], &[1, 1]),
    (&[1, 0, 9, 0, 8], &[1, 1]),
    (&[1, 0, 0, 0, 9], &[1, 2]),
    (&[1, 0, 0, 7, 208], &[1, 250]),
    (&[2, 0, 0, 0, 1], &[2, 1]),
    (&[2, 0, 0, 1, 0], &[2, 32]),
    (&[3, 0, 0, 0, 1], &[3, 2]),
    (&[3, 0, 0, 0, 2], &[3, 4]),
    (&[3, 9, 9, 0, 2], &[3, 4]),
    (&[3, 0, 0, 0, 125], &[3, 250]),
    (&[4, 0, 0, 0, 1], &[4, 2]),
    (&[4, 0, 0, 0, 2], &[4, 4]),
    (&[5, 0, 1, 255, 0], &[5, 0, 1, 255, 0]),
    (&[6, 0, 1, 0, 2], &[6, 0, 1, 0, 2]),
    (&[6, 0, 1, 0, 3], &[6, 0, 1, 0, 3]),
    (&[6, 0, 0, 0, 2], &[6, 0, 0, 0, 2]),
    (&[7], &[7]),
    (&[8, 0, 0, 1, 2], &[8, 0, 0, 1, 2]),
    (&[8, 0, 0, 1, 3], &[8, 0, 0, 1, 3]),
    (&[8, 0, 2, 0, 1], &[8, 0, 2]),
    (&[8, 0, 3, 0, 1], &[8, 0, 3]),
    (&[8, 1, 0, 0, 1], &[8, 1, 0]),
    (&[15, 0, 1, 0, 2, 1, 3], &[15, 0, 1, 0, 2]),
    (&[16, 0, 1, 0, 1, 2, 0, 9], &[16, 0, 1, 0, 1]),
    (&[16, 0, 1, 0, 2, 4, 0, 9, 0, 9], &[16, 0, 1, 0, 2]),
    (&[21, 9, 6, 0, 4, 0, 7, 0, 1, 0, 9], &[21, 9, 6, 0, 4, 0, 7, 0, 1, 0, 9]),
    (&[21, 9, 6, 0, 4, 0, 7, 0, 1, 0, 8], &[21, 9, 6, 0, 4, 0, 7, 0, 1, 0, 8]),
    (&[22, 0, 4, 0, 242, 0, 37], &[22, 0, 4, 0, 242, 0, 37]),
    (&[22, 0, 4, 0, 242, 0, 36], &[22, 0, 4, 0, 242, 0, 36]),
    (&[23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 9], &[23, 2]),
    (&[23, 0, 0, 0, 3, 0, 0, 0, 1, 2, 0, 9], &[23, 6]),
    (&[65, 1, 2], &[65]),
];

/// A normal response that begins so.
fn response(beginning: &[u8]) -> Vec<u8> {
    let fill = match *beginning {
        [1..=4 | 23, count] => usize::from(count),
        [8, _, _] => 2,
        // As long as an exception, and with a code of one.
        [7] => 1,
        _ => 0,
    };
    [beginning, &vec![5; fill]].concat()
}

/// Whether a proof has the checksum of another response of its function. Checksums of 16 bits are what the gateway compares; one that
/// is taken for another counts as outstanding for longer, which is safe, and which the model does not know.
fn is_taken_for_another(proof: &[u8; 5]) -> bool {
    let others = REQUESTS.iter().filter(|(_, beginning)| beginning[0] == proof[0]);
    others.into_iter().any(|(_, beginning)| checksum(beginning) == checksum(proof))
}

/// Serial Line 6.2.2, bit by bit.
fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 })
    })
}

/// A port and a unit.
type Place = (u8, u8);

#[derive(Clone)]
struct Sent {
    place: Place,
    purpose: Purpose,
    beginning: Vec<u8>,
}

impl Sent {
    /// Whether `response` may be the one to this.
    fn may_get(&self, response: &[u8]) -> bool {
        if response[0] & 0x80 != 0 {
            self.beginning[0] == response[0] & 0x7f
        } else {
            response.starts_with(&self.beginning)
        }
    }
}

#[derive(Default)]
struct Model {
    /// Of all units, in the order in which they were sent; what came unsolicited is in front of what was sent to its unit.
    sent: Vec<Sent>,
    forgotten: BTreeSet<Place>,
}

impl Model {
    fn of(&self, place: Place) -> impl Iterator<Item = &Sent> {
        self.sent.iter().filter(move |sent| sent.place == place)
    }

    fn is_in_step(&self, place: Place, open: bool) -> bool {
        self.of(place).count() <= usize::from(open) && !self.forgotten.contains(&place)
    }

    fn is_unique(&self, place: Place, function: u8) -> bool {
        !self.forgotten.contains(&place) && self.of(place).all(|sent| sent.beginning[0] != function)
    }

    fn proves(&self, place: Place, response: &[u8]) -> bool {
        !self.forgotten.contains(&place) && !self.of(place).any(|sent| sent.may_get(response))
    }

    fn settle_all(&mut self, place: Place) {
        self.sent.retain(|sent| sent.place != place);
        self.forgotten.remove(&place);
    }

    fn forget(&mut self, place: Place) {
        self.settle_all(place);
        self.forgotten.insert(place);
    }

    fn make_room(&mut self, place: Place) {
        if self.of(place).count() == OF_UNIT_MAX {
            self.forget(place);
        } else if self.sent.len() == OUTSTANDING_MAX {
            self.forget(self.sent[0].place);
        }
    }

    fn send(&mut self, sent: Sent) {
        self.make_room(sent.place);
        self.sent.push(sent);
    }

    /// `beginning`: how others like `response` begin.
    fn heard(&mut self, place: Place, response: &[u8], beginning: &[u8]) -> Settled {
        let of: Vec<Sent> = self.of(place).cloned().collect();
        let mut fitting = (0..of.len()).filter(|at| of[*at].may_get(response));
        let is_forgotten = self.forgotten.contains(&place);
        let Some(first) = fitting.next() else {
            let whose = if is_forgotten { Match::Several } else { Match::Unsolicited };
            if !is_forgotten {
                self.make_room(place);
                let at = self.sent.iter().position(|sent| sent.place == place).unwrap_or(self.sent.len());
                let (purpose, beginning) = (Purpose::Unsolicited, beginning.to_vec());
                self.sent.insert(at, Sent { place, purpose, beginning });
            }
            return Settled { whose, passed_diagnostic: false, is_diagnostic: false };
        };
        let purpose = of[first].purpose;
        let is_exception = response[0] & 0x80 != 0;
        let is_diagnostic = purpose == Purpose::Diagnostic;
        let diagnostic_before = |end: usize| of[..end].iter().any(|sent| sent.purpose == Purpose::Diagnostic);
        if is_forgotten && (!is_diagnostic || is_exception) {
            let passed_diagnostic = diagnostic_before(of.len() - 1);
            return Settled { whose: Match::Several, passed_diagnostic, is_diagnostic };
        }
        let whose = match purpose {
            _ if fitting.next().is_some() => Match::Several,
            Purpose::Unsolicited => Match::Several,
            _ if first + 1 == of.len() => Match::Latest(purpose),
            _ => Match::Earlier(purpose),
        };
        if is_exception && [5, 6, 10, 11].contains(&response[1]) {
            return Settled { whose, passed_diagnostic: false, is_diagnostic };
        }
        // What came unsolicited may come again.
        let mut settled = first + usize::from(purpose != Purpose::Unsolicited);
        self.sent.retain(|sent| {
            let goes = sent.place == place && settled > 0;
            settled -= usize::from(goes);
            !goes
        });
        if is_diagnostic && !is_exception {
            self.forgotten.remove(&place);
        }
        Settled { whose, passed_diagnostic: diagnostic_before(first), is_diagnostic }
    }
}

/// Both of them: they must say the same.
struct Both {
    outstanding: Outstanding,
    model: Model,
}

impl Both {
    fn send(&mut self, place: Place, (request, beginning): (&[u8], &[u8]), purpose: Purpose) {
        self.outstanding.sent(place.0, place.1, Shape::of_request(request), purpose);
        self.model.send(Sent { place, purpose, beginning: beginning.to_vec() });
    }

    fn check(&self, place: Place, requests: &[(&[u8], &[u8])]) {
        let Self { outstanding, model } = self;
        let (port, unit) = place;
        for open in [false, true] {
            assert_eq!(outstanding.is_in_step(port, unit, open), model.is_in_step(place, open), "{place:?}");
        }
        for (request, beginning) in requests {
            let shape = Shape::of_request(request);
            let is_unique = model.is_unique(place, request[0]);
            assert_eq!(outstanding.is_unique(port, unit, &shape), is_unique, "{place:?} {request:?}");
            let proves = model.proves(place, &response(beginning));
            assert_eq!(outstanding.proves(port, unit, &shape), proves, "{place:?} {request:?}");
        }
    }
}

proptest! {
    #[test]
    fn what_may_still_be_answered_is_what_its_plain_description_says(seed: u64, few: bool) {
        let mut random = Random::new(seed);
        let mut both = Both { outstanding: Outstanding::new(), model: Model::default() };
        // Other units have nearly all places.
        let others = if random.chance(0.15) { (OUTSTANDING_MAX / OF_UNIT_MAX - 1) as u8 } else { 0 };
        for unit in 0..others {
            (0..OF_UNIT_MAX).for_each(|at| both.send((2, unit), REQUESTS[at], Purpose::Request));
        }
        let places = [(1, 5), (1, 37), (3, 5), (2, 0)];
        // Few functions: more is outstanding that a response may fit.
        let first = random.index(REQUESTS.len() - 5);
        let requests = if few { &REQUESTS[first..first + 5] } else { REQUESTS };
        for _ in 0..80 {
            let place = places[random.index(places.len())];
            let (request, beginning) = requests[random.index(requests.len())];
            match random.index(40) {
                0 => {
                    both.outstanding.forget(place.0, place.1);
                    both.model.forget(place);
                }
                1 => {
                    both.outstanding.settle_all(place.0, place.1);
                    both.model.settle_all(place);
                }
                2..=5 => {
                    let mut proof = both.outstanding.diagnostic(seed);
                    while is_taken_for_another(&proof) {
                        proof = both.outstanding.diagnostic(seed);
                    }
                    both.send(place, (&proof, &proof), Purpose::Diagnostic);
                }
                6..=24 => {
                    let purpose = if random.chance(0.3) { Purpose::Read } else { Purpose::Request };
                    both.send(place, (request, beginning), purpose);
                }
                kind => {
                    let open = both.model.of(place).count();
                    let beginning = match both.model.of(place).nth(random.index(open.max(1))) {
                        Some(sent) if random.chance(0.7) => sent.beginning.clone(),
                        _ => beginning.to_vec(),
                    };
                    let exception = [beginning[0] | 0x80, random.within(1..=12) as u8];
                    let (response, beginning) = match kind {
                        25..=28 => (exception.to_vec(), &beginning[..1]),
                        _ => (response(&beginning), &beginning[..]),
                    };
                    let settled = both.outstanding.match_response(place.0, place.1, &response);
                    prop_assert_eq!(settled, both.model.heard(place, &response, beginning), "{:?}", response);
                }
            }
            let asked = random.index(REQUESTS.len() - 3);
            for place in [place, places[random.index(places.len())]] {
                both.check(place, &REQUESTS[asked..asked + 3]);
                both.check(place, &requests[..2]);
            }
        }
    }
}
