//! One participant's connection to a wire: a byte stream for the gateway, whole frames with exact times for devices.

use std::future::poll_fn;
use std::task::{Context, Poll};

use embassy_time_driver::schedule_wake;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate::hal::Flaws;
use mobgate::settings::LineSettings;

use super::bus::{Bus, Heard, LineEnd, Silence, TRANSMIT_CHARS_MAX, Wire, now_ns, tick_after};
use super::character::Flaw;
use crate::timing::chars_ns;

impl LineEnd {
    pub(super) fn new(wire: Wire, number: usize, generation: u32) -> Self {
        Self { wire, number, generation }
    }

    /// The participant's number, in the order of [`Wire::tap`].
    pub fn number(&self) -> usize {
        self.number
    }

    /// The participant's speed and character format.
    pub fn line(&self) -> LineSettings {
        self.wire.0.borrow().ends[self.number].line
    }

    /// Sets speed and format for what is sent and heard from now on.
    pub fn set_line(&self, line: LineSettings) {
        self.wire.0.borrow_mut().ends[self.number].set_line(line);
    }

    /// Whether the participant hears itself, like an adapter whose receiver stays on.
    pub fn set_echo(&self, echo: bool) {
        self.wire.0.borrow_mut().ends[self.number].echo = echo;
    }

    /// Swaps the participant's two wires, or puts them right.
    pub fn set_swapped(&self, swapped: bool) {
        self.wire.0.borrow_mut().ends[self.number].swapped = swapped;
    }

    /// What the participant's receiver has noticed since the last call.
    pub(crate) fn take_flaws(&self) -> Flaws {
        std::mem::take(&mut self.wire.0.borrow_mut().ends[self.number].flaws)
    }

    /// Sends `bytes`, of which the one in the middle has the `flaw`.
    pub(crate) fn write_flawed(&self, bytes: &[u8], flaw: Flaw) {
        self.wire.0.borrow_mut().transmit(self.number, bytes, Some(flaw));
    }

    /// Switches the transceiver's driver; the record notes when.
    pub(crate) fn drive(&self, on: bool) {
        self.wire.0.borrow_mut().record.ends[self.number].switched.push((now_ns(), on));
    }

    /// Pulls the adapter out: this handle and its clones are dead for good.
    pub fn unplug(&self) {
        let mut bus = self.wire.0.borrow_mut();
        let end = &mut bus.ends[self.number];
        end.plugged = false;
        end.generation += 1;
        let waiting = std::mem::take(&mut end.waiting);
        drop(bus);
        waiting.into_iter().for_each(std::task::Waker::wake);
    }

    /// Puts the adapter back, to be opened anew.
    pub fn replug(&self) {
        self.wire.0.borrow_mut().ends[self.number].plugged = true;
    }

    /// Characters lost because nobody read them.
    pub fn overruns(&self) -> u64 {
        self.wire.0.borrow().ends[self.number].overruns
    }

    /// A living handle with an empty receiver; an error when the adapter is out or somebody has it open.
    pub(crate) fn open(&self, line: LineSettings) -> Result<Self, ErrorKind> {
        let mut bus = self.wire.0.borrow_mut();
        let next = bus.first_unheard();
        let end = &mut bus.ends[self.number];
        if !end.plugged {
            return Err(ErrorKind::NotFound);
        }
        if std::mem::replace(&mut end.opened, true) {
            return Err(ErrorKind::AddrInUse);
        }
        end.set_line(line);
        end.next = next;
        Ok(Self { wire: self.wire.clone(), number: self.number, generation: end.generation })
    }

    /// Ends the time in which nobody else can [`open`](Self::open) this participant.
    pub(crate) fn close(&self) {
        self.wire.0.borrow_mut().ends[self.number].opened = false;
    }

    fn is_dead(&self, bus: &Bus) -> bool {
        let end = &bus.ends[self.number];
        !end.plugged || end.generation != self.generation
    }

    /// The next frame: all that comes until it has been silent for `silence.between_ns`.
    ///
    /// Of a transmission without end the newest 4096 characters are kept, so that it ends some day.
    pub async fn frame(&self, silence: Silence) -> Heard {
        poll_fn(|context| self.poll_frame(context, silence)).await
    }

    fn poll_frame(&self, context: &mut Context<'_>, silence: Silence) -> Poll<Heard> {
        let mut bus = self.wire.0.borrow_mut();
        let (heard, next) = bus.frame_from(self.number, silence);
        let over_at = tick_after(heard.end_ns + silence.between_ns);
        let end = &mut bus.ends[self.number];
        if !heard.bytes.is_empty() && over_at * 1_000 <= now_ns() {
            end.next = next;
            return Poll::Ready(heard);
        }
        end.wait(context);
        drop(bus);
        if !heard.bytes.is_empty() {
            schedule_wake(over_at, context.waker());
        }
        Poll::Pending
    }

    /// Waits until a read would give so many characters, at least one, or the news that the adapter is out.
    pub(crate) async fn readable(&self, characters: usize) {
        poll_fn(|context| {
            if self.poll_relay(context).is_pending() {
                return Poll::Pending;
            }
            let mut bus = self.wire.0.borrow_mut();
            let last = characters.saturating_sub(1);
            let coming = bus.audible_from(self.number).nth(last).map(|(_, character)| character.end_ns);
            if self.is_dead(&bus) || coming.is_some_and(|end_ns| end_ns <= now_ns()) {
                return Poll::Ready(());
            }
            bus.ends[self.number].wait(context);
            drop(bus);
            if let Some(end_ns) = coming {
                schedule_wake(tick_after(end_ns), context.waker());
            }
            Poll::Pending
        })
        .await;
    }

    fn poll_read(&self, context: &mut Context<'_>, into: &mut [u8]) -> Poll<Result<usize, ErrorKind>> {
        if self.poll_relay(context).is_pending() {
            return Poll::Pending;
        }
        let mut bus = self.wire.0.borrow_mut();
        if into.is_empty() || self.is_dead(&bus) {
            return Poll::Ready(Ok(0));
        }
        let count = bus.read(self.number, into);
        if count > 0 {
            bus.record.ends[self.number].reads += 1;
            return Poll::Ready(Ok(count));
        }
        let coming = bus.audible_from(self.number).next().map(|(_, character)| character.end_ns);
        bus.ends[self.number].wait(context);
        drop(bus);
        if let Some(end_ns) = coming {
            schedule_wake(tick_after(end_ns), context.waker());
        }
        Poll::Pending
    }

    /// Waits until fewer than `limit` characters are in the transmitter.
    fn poll_room(&self, context: &mut Context<'_>, limit: u64) -> Poll<Result<(), ErrorKind>> {
        let mut bus = self.wire.0.borrow_mut();
        if self.is_dead(&bus) {
            return Poll::Ready(Err(ErrorKind::BrokenPipe));
        }
        let end = &mut bus.ends[self.number];
        let room_at = end.run.end_ns.saturating_sub(chars_ns(&end.line, limit - 1));
        if room_at <= now_ns() {
            return Poll::Ready(Ok(()));
        }
        // Also at the list of those who wait: an unplugged adapter must not keep its writer.
        end.wait(context);
        drop(bus);
        schedule_wake(tick_after(room_at), context.waker());
        Poll::Pending
    }
}

impl ErrorType for LineEnd {
    type Error = ErrorKind;
}

impl Read for LineEnd {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        poll_fn(|context| self.poll_read(context, into)).await
    }
}

impl Write for LineEnd {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        poll_fn(|context| self.poll_room(context, TRANSMIT_CHARS_MAX)).await?;
        self.wire.0.borrow_mut().transmit(self.number, bytes, None);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        poll_fn(|context| self.poll_room(context, 1)).await
    }
}
