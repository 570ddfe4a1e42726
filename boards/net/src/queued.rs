//! A driver whose SYNs wait in the backlog while no socket is free for them.

use core::task::Context;

use embassy_net::driver::{Capabilities, Driver, HardwareAddress, LinkState, RxToken};

use crate::backlog::Backlog;

/// A board's Ethernet driver, for a stack whose [`Sockets`](crate::Sockets) have the same backlog.
pub struct Queued<D> {
    driver: D,
    backlog: &'static Backlog,
}

impl<D> Queued<D> {
    /// Lets SYNs that `driver` receives wait in `backlog`.
    pub const fn new(driver: D, backlog: &'static Backlog) -> Self {
        Self { driver, backlog }
    }
}

impl<D: Driver> Driver for Queued<D> {
    type RxToken<'a>
        = Received<D::RxToken<'a>>
    where
        Self: 'a;
    type TxToken<'a>
        = D::TxToken<'a>
    where
        Self: 'a;

    fn receive(&mut self, context: &mut Context<'_>) -> Option<(Self::RxToken<'_>, Self::TxToken<'_>)> {
        let Self { driver, backlog } = self;
        if !backlog.is_empty() && backlog.has_next(context) {
            // As in drivers: nothing is received without room for the response.
            let response = driver.transmit(context)?;
            return Some((Received { from: Source::Backlog, backlog }, response));
        }
        let (received, response) = driver.receive(context)?;
        Some((Received { from: Source::Driver(received), backlog }, response))
    }

    fn transmit(&mut self, context: &mut Context<'_>) -> Option<Self::TxToken<'_>> {
        self.driver.transmit(context)
    }

    fn link_state(&mut self, context: &mut Context<'_>) -> LinkState {
        self.driver.link_state(context)
    }

    fn capabilities(&self) -> Capabilities {
        self.driver.capabilities()
    }

    fn hardware_address(&self) -> HardwareAddress {
        self.driver.hardware_address()
    }
}

/// A frame that was received now, or before.
pub struct Received<R> {
    from: Source<R>,
    backlog: &'static Backlog,
}

enum Source<R> {
    Driver(R),
    /// The SYN that is next.
    Backlog,
}

impl<R: RxToken> RxToken for Received<R> {
    fn consume<T, F: FnOnce(&mut [u8]) -> T>(self, take: F) -> T {
        let backlog = self.backlog;
        match self.from {
            // The stack ignores an empty frame.
            Source::Driver(received) => {
                received.consume(|frame| give(take, if backlog.admits(frame) { frame } else { &mut [] }))
            }
            Source::Backlog => give(take, &mut backlog.take()),
        }
    }
}

/// Not inlined: what the stack does with a frame is many instructions, which would be there twice.
#[inline(never)]
fn give<T>(take: impl FnOnce(&mut [u8]) -> T, frame: &mut [u8]) -> T {
    take(frame)
}
