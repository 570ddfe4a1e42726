//! What one end hears and another one sends at once, as a board does it in its receive interrupt.
//!
//! The reader of the first end is the interrupt: it is polled when a character has come, and waits on.

use std::task::{Context, Poll, Waker};

use embassy_time::Duration;
use embassy_time_driver::schedule_wake;
use mobgate::hal::Relay;

use super::bus::{LineEnd, Relayed, Silence, now_ns, tick_after};

impl LineEnd {
    /// Lets `to` send what is heard here and was not read yet.
    pub(crate) fn begin_relay(&self, relay: Relay, to: &LineEnd) {
        let mut bus = self.wire.0.borrow_mut();
        let end = &mut bus.ends[self.number];
        let (to, next, heard_ns) = (to.clone(), end.next, now_ns());
        end.relayed = Some(Relayed { relay, to, next, heard_ns, is_broken: false });
        let waiting = std::mem::take(&mut end.waiting);
        drop(bus);
        waiting.into_iter().for_each(Waker::wake);
    }

    /// What is left of the relay, which is over.
    pub(crate) fn end_relay(&self) -> Option<Relay> {
        self.wire.0.borrow_mut().ends[self.number].relayed.take().map(|relayed| relayed.relay)
    }

    /// Whether another end is sending what is heard here, or has sent what was not read here yet.
    pub(crate) fn is_relayed(&self) -> bool {
        let end = &self.wire.0.borrow().ends[self.number];
        end.relayed.as_ref().is_some_and(|relayed| relayed.is_running() || end.next < relayed.next)
    }

    /// Characters heard here that another end sent at once.
    pub fn relayed_chars(&self) -> u64 {
        self.wire.0.borrow().ends[self.number].relayed_chars
    }

    /// For how long it has been silent here since the relay broke off, unless something has been read that came later.
    pub(crate) fn silence(&self) -> Duration {
        let bus = self.wire.0.borrow();
        let end = &bus.ends[self.number];
        let broken = end.relayed.as_ref().filter(|relayed| relayed.is_broken && end.next <= relayed.next);
        broken.map_or(Duration::from_ticks(0), |broken| Duration::from_nanos(now_ns() - broken.heard_ns))
    }

    /// Relays what has come, and waits until nothing is to be relayed.
    pub(super) fn poll_relay(&self, context: &mut Context<'_>) -> Poll<()> {
        while let Some((to, byte)) = self.relay_next() {
            to.wire.0.borrow_mut().transmit(to.number, &[byte], None);
        }
        let mut bus = self.wire.0.borrow_mut();
        let silence_ns = Silence::of(&bus.ends[self.number].line).inside_ns;
        let Some(relayed) = bus.ends[self.number].relayed.as_ref().filter(|relayed| relayed.is_running())
        else {
            return Poll::Ready(());
        };
        let silent_ns = relayed.heard_ns + silence_ns;
        let coming = bus.audible(self.number, relayed.next).next();
        let coming = coming.filter(|(_, character)| character.start_ns <= silent_ns);
        let wake_at = tick_after(coming.map_or(silent_ns + 1, |(_, character)| character.end_ns));
        let end = &mut bus.ends[self.number];
        if wake_at * 1_000 <= now_ns() {
            end.relayed.iter_mut().for_each(|relayed| relayed.is_broken = true);
            return Poll::Ready(());
        }
        end.wait(context);
        drop(bus);
        schedule_wake(wake_at, context.waker());
        Poll::Pending
    }

    /// Takes the next character that has come, as long as there is no gap before it: who sends what instead.
    fn relay_next(&self) -> Option<(LineEnd, u8)> {
        let mut bus = self.wire.0.borrow_mut();
        let silence_ns = Silence::of(&bus.ends[self.number].line).inside_ns;
        loop {
            let relayed = bus.ends[self.number].relayed.as_ref().filter(|relayed| relayed.is_running())?;
            let (number, character) = bus.audible(self.number, relayed.next).next()?;
            if character.end_ns > now_ns() || character.start_ns > relayed.heard_ns + silence_ns {
                return None;
            }
            let (byte, end_ns) = (bus.heard_as(character, self.number).0, character.end_ns);
            bus.ends[self.number].relayed_chars += 1;
            let relayed = bus.ends[self.number].relayed.as_mut()?;
            (relayed.next, relayed.heard_ns) = (number + 1, end_ns);
            if let Some(byte) = relayed.relay.step(byte) {
                return Some((relayed.to.clone(), byte));
            }
        }
    }
}
