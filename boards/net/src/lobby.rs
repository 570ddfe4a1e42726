//! Hands connections over to tasks, each of which has a slot and serves one connection at a time, its guest.

use core::cell::Cell;
use core::net::IpAddr;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use mobgate::settings::PortId;

/// Most tasks that serve sessions of SSH.
pub const SSH_SESSIONS_MAX: usize = 8;

/// Those tasks' slots, for connections of the type `C`.
pub(crate) struct Lobby<C> {
    free: Channel<NoopRawMutex, usize, SSH_SESSIONS_MAX>,
    slots: [Slot<C>; SSH_SESSIONS_MAX],
}

/// A task's slot.
pub(crate) struct Slot<C> {
    guest: Signal<NoopRawMutex, Guest<C>>,
    /// Which guest it is: each has another number.
    number: Cell<u32>,
    event: Signal<NoopRawMutex, Event>,
    leave: Signal<NoopRawMutex, ()>,
}

/// A connection, the port that it came by, and the peer.
pub(crate) struct Guest<C> {
    pub(crate) connection: C,
    pub(crate) port: PortId,
    pub(crate) peer: IpAddr,
}

enum Event {
    LoggedIn,
    Ended,
}

/// Ends the guest's session when dropped, unless that has ended.
struct Stay<'l, C>(&'l Slot<C>, u32);

impl<C> Drop for Stay<'_, C> {
    fn drop(&mut self) {
        if self.0.number.get() == self.1 {
            self.0.leave.signal(());
        }
    }
}

impl<C> Lobby<C> {
    pub(crate) const fn new() -> Self {
        let slots = [const {
            Slot { guest: Signal::new(), number: Cell::new(0), event: Signal::new(), leave: Signal::new() }
        }; _];
        Self { free: Channel::new(), slots }
    }

    /// The slot of the task with this number, if there is one.
    pub(crate) fn slot(&self, task: usize) -> Option<&Slot<C>> {
        self.slots.get(task)
    }

    /// Waits until a task is free. Its slot must be taken at once.
    pub(crate) async fn free_slot(&self) -> Option<&Slot<C>> {
        self.slot(self.free.receive().await)
    }

    /// Waits for the next guest of the task with this number.
    pub(crate) async fn next(&self, task: usize) -> Option<Guest<C>> {
        let slot = self.slot(task)?;
        self.free.send(task).await;
        Some(slot.guest.wait().await)
    }
}

impl<C> Slot<C> {
    /// Lets the task serve `guest` until the end. Dropping the future is the session's end.
    pub(crate) async fn take(&self, guest: Guest<C>, logged_in: &dyn Fn()) {
        self.leave.reset();
        self.event.reset();
        self.guest.signal(guest);
        let _stay = Stay(self, self.number.get());
        while let Event::LoggedIn = self.event.wait().await {
            logged_in();
        }
    }

    /// A user has logged in.
    pub(crate) fn logged_in(&self) {
        self.event.signal(Event::LoggedIn);
    }

    /// Waits until the guest must leave.
    pub(crate) async fn leave(&self) {
        self.leave.wait().await;
    }

    /// The guest is gone.
    pub(crate) fn is_left(&self) {
        self.number.update(|number| number.wrapping_add(1));
        self.event.signal(Event::Ended);
    }
}
