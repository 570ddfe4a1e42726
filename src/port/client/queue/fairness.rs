//! Fairness of the queue: turns per requester and address, and which request is evicted when the queue is full.

use heapless::Vec;

use super::{Known, PortQueue, REQUESTERS_MAX, Requester, add};

impl<T> PortQueue<T> {
    /// The index of `requester` in the table; adds it if necessary.
    pub(super) fn slot_of(&mut self, requester: Requester) -> u8 {
        if let Some(slot) = self.requesters.iter().position(|known| known.requester == requester) {
            return slot as u8;
        }
        let of_address = self.requesters.iter().find(|known| known.requester.address == requester.address);
        let known = Known { requester, turn: 0, by_address: of_address.map_or(0, |known| known.by_address) };
        let Err(known) = self.requesters.push(known) else { return (self.requesters.len() - 1) as u8 };
        // The requester served longest ago ranks like one never served, so it can be forgotten. Not all are waiting, so there is
        // one to forget.
        let waits = |slot: usize| self.waiting.iter().any(|waiting| usize::from(waiting.requester) == slot);
        let idle = self.requesters.iter().enumerate().filter(|(slot, _)| !waits(*slot));
        let oldest = idle.min_by_key(|(_, known)| known.turn).map_or(0, |(slot, _)| slot);
        if let Some(slot) = self.requesters.get_mut(oldest) {
            *slot = known;
        }
        oldest as u8
    }

    pub(super) fn note_turn(&mut self, slot: u8) {
        let turn = self.turns.checked_add(1).unwrap_or_else(|| {
            // After 2^32 turns all counters restart.
            self.requesters.iter_mut().for_each(|known| (known.turn, known.by_address) = (0, 0));
            1
        });
        self.turns = turn;
        let Some(served) = self.requesters.get_mut(usize::from(slot)) else { return };
        served.turn = turn;
        let address = served.requester.address;
        let of_address = self.requesters.iter_mut().filter(|known| known.requester.address == address);
        of_address.for_each(|known| known.by_address = turn);
    }

    /// The newest request of the address with the most requests, if those outnumber what the address of `newcomer` would have;
    /// within one address, the same rule applies to its connections. A single pass, as refusing must be cheaper than serving.
    pub(super) fn eviction_candidate(&self, newcomer: Requester) -> Option<usize> {
        let mut own = [0_u8; REQUESTERS_MAX];
        let (mut of_address, mut of_newcomer) = (0, 0);
        // Of one requester at the newcomer's address.
        let mut most = 0;
        for waiting in &self.waiting {
            let count = add(&mut own, usize::from(waiting.requester), 1);
            let Some(Known { requester, .. }) = self.requester(waiting.requester) else { continue };
            if requester.shares_address(&newcomer) {
                of_address += 1;
                of_newcomer += u8::from(*requester == newcomer);
                most = most.max(count);
            }
        }
        let address = self.busiest_addresses(&own, of_address + 1);
        if address.is_none() && most <= of_newcomer + 1 {
            return None;
        }
        self.waiting.iter().rposition(|waiting| {
            let has_most = own.get(usize::from(waiting.requester)) == Some(&most);
            self.requester(waiting.requester).is_some_and(|Known { requester, .. }| match &address {
                Some(addresses) => addresses.iter().any(|other| requester.shares_address(other)),
                None => has_most && requester.shares_address(&newcomer),
            })
        })
    }

    /// The addresses with the most requests, if those are more than `more_than`; `own` has the count of each requester.
    pub(super) fn busiest_addresses(
        &self,
        own: &[u8; REQUESTERS_MAX],
        more_than: u8,
    ) -> Option<Vec<Requester, REQUESTERS_MAX>> {
        // Short cut for the usual case: the newcomer's own address has nearly all.
        if self.waiting.len() < 2 * usize::from(more_than) {
            return None;
        }
        let mut of_address = [0_u8; REQUESTERS_MAX];
        let mut most = 0;
        for (known, &count) in self.requesters.iter().zip(own) {
            let shares_address = |first: &Known| first.requester.shares_address(&known.requester);
            let first = self.requesters.iter().position(shares_address).unwrap_or(0);
            most = most.max(add(&mut of_address, first, count));
        }
        let largest = self.requesters.iter().zip(of_address).filter(|(_, count)| *count == most);
        (most > more_than).then(|| largest.map(|(known, _)| known.requester).collect())
    }
}
