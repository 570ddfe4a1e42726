//! Who had how many turns, and who gives way when the queue is full.

use heapless::Vec;

use super::{ASKERS_MAX, Asker, Known, PortQueue, add};

impl<T> PortQueue<T> {
    /// The place of `asker` in the table, made if there is none.
    pub(super) fn place_of(&mut self, asker: Asker) -> u8 {
        if let Some(place) = self.askers.iter().position(|known| known.asker == asker) {
            return place as u8;
        }
        let of_address = self.askers.iter().find(|known| known.asker.address == asker.address);
        let known = Known { asker, turn: 0, by_address: of_address.map_or(0, |known| known.by_address) };
        let Err(known) = self.askers.push(known) else { return (self.askers.len() - 1) as u8 };
        // The one served longest ago ranks like one never served, so it may be forgotten. Not all wait: there is room.
        let waits = |place: usize| self.waiting.iter().any(|waiting| usize::from(waiting.asker) == place);
        let idle = self.askers.iter().enumerate().filter(|(place, _)| !waits(*place));
        let oldest = idle.min_by_key(|(_, known)| known.turn).map_or(0, |(place, _)| place);
        if let Some(place) = self.askers.get_mut(oldest) {
            *place = known;
        }
        oldest as u8
    }

    pub(super) fn note_turn(&mut self, place: u8) {
        let turn = self.turns.checked_add(1).unwrap_or_else(|| {
            // Once in four thousand million turns everybody starts afresh.
            self.askers.iter_mut().for_each(|known| (known.turn, known.by_address) = (0, 0));
            1
        });
        self.turns = turn;
        let Some(served) = self.askers.get_mut(usize::from(place)) else { return };
        served.turn = turn;
        let address = served.asker.address;
        let of_address = self.askers.iter_mut().filter(|known| known.asker.address == address);
        of_address.for_each(|known| known.by_address = turn);
    }

    /// The newest order of the address that has most of them, if that is more than `newcomer`'s would have; within that
    /// address the same holds of its connections. Each order is counted once, as a refusal must take less than serving.
    pub(super) fn crowder(&self, newcomer: Asker) -> Option<usize> {
        let mut own = [0_u8; ASKERS_MAX];
        let (mut of_address, mut of_newcomer, mut most) = (0, 0, 0);
        for waiting in &self.waiting {
            let count = add(&mut own, usize::from(waiting.asker), 1);
            let Some(Known { asker, .. }) = self.asker(waiting.asker) else { continue };
            if asker.is_beside(&newcomer) {
                of_address += 1;
                of_newcomer += u8::from(*asker == newcomer);
                most = most.max(count);
            }
        }
        let address = self.crowded_address(&own, of_address + 1);
        if address.is_none() && most <= of_newcomer + 1 {
            return None;
        }
        self.waiting.iter().rposition(|waiting| {
            let has_most = own.get(usize::from(waiting.asker)) == Some(&most);
            self.asker(waiting.asker).is_some_and(|Known { asker, .. }| match &address {
                Some(addresses) => addresses.iter().any(|other| asker.is_beside(other)),
                None => has_most && asker.is_beside(&newcomer),
            })
        })
    }

    /// The addresses with most orders, if those are more than `more_than`; `own` has those of each asker.
    pub(super) fn crowded_address(
        &self,
        own: &[u8; ASKERS_MAX],
        more_than: u8,
    ) -> Option<Vec<Asker, ASKERS_MAX>> {
        // Mostly it is the newcomer's own address that has nearly all.
        if self.waiting.len() < 2 * usize::from(more_than) {
            return None;
        }
        let mut of_address = [0_u8; ASKERS_MAX];
        let mut most = 0;
        for (known, &count) in self.askers.iter().zip(own) {
            let first = self.askers.iter().position(|first| first.asker.is_beside(&known.asker)).unwrap_or(0);
            most = most.max(add(&mut of_address, first, count));
        }
        let largest = self.askers.iter().zip(of_address).filter(|(_, count)| *count == most);
        (most > more_than).then(|| largest.map(|(known, _)| known.asker).collect())
    }
}
