//! Who is served next, told a second time in the plainest way: by looking through everything that ever happened.

use std::cmp::Reverse;
use std::net::Ipv4Addr;

use mobgate::port::client::queue::{Access, Entry, Next, PASSED_OVER_MAX, PortQueue, Requester, WAITING_MAX};

use crate::prelude::*;

/// When units that are held are free again.
const LATER: Instant = Instant::from_secs(1);

/// What is asked and by whom.
type Order = (usize, u8);

#[derive(Default)]
struct Model {
    /// In the order of arrival.
    waiting: Vec<(Order, Entry)>,
    /// Whose turn it was.
    turns: Vec<Requester>,
    /// The class that was served in each turn, and the classes that could have been.
    classes: Vec<(usize, Vec<usize>)>,
}

impl Model {
    fn push(&mut self, order: Order, entry: Entry) -> Option<Order> {
        let mut refused = None;
        if self.waiting.len() == WAITING_MAX {
            let Some(eviction_candidate) = self.eviction_candidate(entry.requester) else {
                return Some(order);
            };
            refused = Some(self.waiting.remove(eviction_candidate).0);
        }
        self.waiting.push((order, entry));
        refused
    }

    /// The newest order of whoever has most, if that is more than the newcomer would have.
    fn eviction_candidate(&self, newcomer: Requester) -> Option<usize> {
        let newest = |crowd: &dyn Fn(&Requester) -> usize, among: &dyn Fn(&Requester) -> bool| {
            let candidates = (0..self.waiting.len()).filter(|at| among(&self.waiting[*at].1.requester));
            candidates
                .map(|at| (crowd(&self.waiting[at].1.requester), at))
                .max()
                .filter(|(most, _)| *most > crowd(&newcomer) + 1)
                .map(|(_, at)| at)
        };
        let count = |like: &dyn Fn(&Requester) -> bool| {
            self.waiting.iter().filter(|(_, entry)| like(&entry.requester)).count()
        };
        let of_address = |requester: &Requester| count(&|other| other.shares_address(requester));
        let of_connection = |requester: &Requester| count(&|other| other == requester);
        newest(&of_address, &|_| true)
            .or_else(|| newest(&of_connection, &|requester| requester.shares_address(&newcomer)))
    }

    fn next(&mut self, held: u8) -> Next<Order> {
        let ready: Vec<usize> =
            (0..self.waiting.len()).filter(|at| self.waiting[*at].1.unit != held).collect();
        let mut present: Vec<usize> = ready.iter().map(|at| self.waiting[*at].1.priority as usize).collect();
        present.sort_unstable();
        present.dedup();
        let Some(&highest) = present.first() else {
            return if self.waiting.is_empty() { Next::Empty } else { Next::Wait(LATER) };
        };
        let bound = usize::from(PASSED_OVER_MAX);
        let overdue =
            |class, bound| class > highest && present.contains(&class) && self.passed(class) >= bound;
        let [normal, low] = [Priority::Normal as usize, Priority::Low as usize];
        let class = if overdue(low, if highest == normal { bound } else { 2 * bound }) {
            low
        } else if overdue(normal, bound) {
            normal
        } else {
            highest
        };
        let of_class = ready.into_iter().filter(|at| self.waiting[*at].1.priority as usize == class);
        let first = of_class.max_by_key(|at| {
            let requester = self.waiting[*at].1.requester;
            let idle = |like: &dyn Fn(&Requester) -> bool| {
                self.turns.iter().rev().position(like).unwrap_or(usize::MAX)
            };
            let of_address = idle(&|other| other.shares_address(&requester));
            (of_address, idle(&|other| *other == requester), Reverse(*at))
        });
        let (order, entry) = self.waiting.remove(first.expect("one of this class is ready"));
        self.turns.push(entry.requester);
        self.classes.push((class, present));
        Next::Serve(order, entry)
    }

    /// How often in a row `class` has waited while a higher one was served.
    fn passed(&self, class: usize) -> usize {
        let passed = |(served, present): &&(usize, Vec<usize>)| *served < class && present.contains(&class);
        self.classes.iter().rev().take_while(passed).count()
    }

    /// All that may go with the order that was served, the last one first.
    fn companions(&mut self, leader: &Entry, asked: u8) -> Vec<Order> {
        let mut companions = Vec::new();
        for at in (0..self.waiting.len()).rev() {
            let ((_, what), entry) = self.waiting[at];
            let fits = entry.unit == leader.unit && what == asked;
            let shared = [leader.access, entry.access] == [Access::SharedRead; 2];
            let barred = self.waiting[..at].iter().any(|(_, earlier)| {
                earlier.access == Access::Write && [0, leader.unit].contains(&earlier.unit)
            });
            if fits && shared && !barred {
                companions.push(self.waiting.remove(at).0);
            }
        }
        companions
    }
}

#[derive(Debug, Clone)]
enum Step {
    Push(u8, Entry),
    /// Serve, while the unit of this id is held.
    Serve(u8),
    /// The same, and what was served comes back with all that went with it.
    Return(u8),
}

fn any_step() -> impl Strategy<Value = Step> {
    let priority = prop_oneof![Just(Priority::High), Just(Priority::Normal), Just(Priority::Low)];
    let access = prop_oneof![
        1 => Just(Access::Write),
        1 => Just(Access::Read),
        6 => Just(Access::SharedRead),
    ];
    let push = (0..5_u8, 0..3_u16, priority, 0..4_u8, access, 0..3_u8).prop_map(
        |(address, connection, priority, unit, access, what)| {
            let address = (address > 0).then(|| IpAddr::V4(Ipv4Addr::new(10, 0, 0, address)));
            let requester = Requester::new((0, connection), address);
            Step::Push(what, Entry { requester, priority, unit, deadline: Instant::MAX, access })
        },
    );
    prop_oneof![8 => push, 2 => (0..6_u8).prop_map(Step::Serve), 1 => (0..6_u8).prop_map(Step::Return)]
}

proptest! {
    #[test]
    fn the_queue_serves_refuses_and_merges_as_its_plain_description_says(
        steps in prop::collection::vec(any_step(), 1..300),
        drained in prop::collection::vec(0..6_u8, 100),
        merge in any::<bool>(),
    ) {
        let (mut queue, mut model) = (PortQueue::new(), Model::default());
        let mut entries = HashMap::new();
        for (number, step) in steps.into_iter().chain(drained.into_iter().map(Step::Serve)).enumerate() {
            match step {
                Step::Push(what, entry) => {
                    entries.insert(number, entry);
                    prop_assert_eq!(queue.push((number, what), entry), model.push((number, what), entry));
                }
                Step::Serve(held) | Step::Return(held) => {
                    let ready = |unit| if unit == held { Ready::At(LATER) } else { Ready::Now };
                    let served = queue.next(Instant::MIN, ready);
                    prop_assert_eq!(&served, &model.next(held));
                    let Next::Serve(leader, entry) = served else { continue };
                    let mut taken = vec![leader];
                    let fits = |(_, what): &Order| merge && *what == leader.1;
                    let offered = queue.companions(&entry).copied().filter(fits).collect::<Vec<_>>();
                    taken.extend(std::iter::from_fn(|| queue.companion(&entry, fits)));
                    if merge {
                        prop_assert_eq!(&taken[1..], &model.companions(&entry, leader.1));
                    }
                    prop_assert!(offered.iter().rev().eq(&taken[1..]));
                    for (merged, _) in taken[1..].iter().filter(|(merged, _)| merged % 2 == 1) {
                        queue.charge(entries[merged].requester);
                        model.turns.push(entries[merged].requester);
                    }
                    if matches!(step, Step::Return(_)) {
                        for order in taken {
                            prop_assert_eq!(queue.push_front(order, entries[&order.0]), None);
                            model.waiting.insert(0, (order, entries[&order.0]));
                        }
                    }
                }
            }
            prop_assert_eq!(queue.len(), model.waiting.len());
        }
    }
}
