//! Connections of SSH servers on their way to the board's tasks that serve them.
//!
//! A session takes a future of many bytes, so each has a task of its own, and a connection's task hands its socket over. The
//! connection waits until a task is free, and ends with the session; if it is displaced before, so is the session.

use core::cell::Cell;
use core::net::IpAddr;

use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use mobgate::settings::PortId;

use crate::pool::Sockets;
use crate::tcp::TcpStream;

/// Most tasks that serve sessions.
pub const SSH_SESSIONS_MAX: usize = 8;

/// Those tasks.
pub(crate) struct Lobby {
    free: Channel<NoopRawMutex, usize, SSH_SESSIONS_MAX>,
    seats: [Seat; SSH_SESSIONS_MAX],
}

/// A task's place.
struct Seat {
    guest: Signal<NoopRawMutex, Guest>,
    /// Which guest it is: each has another number.
    number: Cell<u32>,
    event: Signal<NoopRawMutex, Event>,
    leave: Signal<NoopRawMutex, ()>,
}

struct Guest {
    stream: TcpStream,
    port: PortId,
    peer: IpAddr,
}

enum Event {
    LoggedIn,
    Ended,
}

/// Ends the guest's session when dropped, unless that has ended.
struct Stay<'l>(&'l Seat, u32);

impl Drop for Stay<'_> {
    fn drop(&mut self) {
        if self.0.number.get() == self.1 {
            self.0.leave.signal(());
        }
    }
}

impl Lobby {
    pub(crate) const fn new() -> Self {
        const SEAT: Seat =
            Seat { guest: Signal::new(), number: Cell::new(0), event: Signal::new(), leave: Signal::new() };
        Self { free: Channel::new(), seats: [SEAT; _] }
    }

    /// Lets a task serve `stream` until its end.
    pub(crate) async fn hand_over(
        &self,
        stream: TcpStream,
        port: PortId,
        peer: IpAddr,
        logged_in: &dyn Fn(),
    ) {
        let Some(seat) = self.seats.get(self.free.receive().await) else { return };
        seat.leave.reset();
        seat.event.reset();
        seat.guest.signal(Guest { stream, port, peer });
        let _stay = Stay(seat, seat.number.get());
        while let Event::LoggedIn = seat.event.wait().await {
            logged_in();
        }
    }
}

impl Sockets {
    /// Serves the connections of SSH servers one after the other, by `serve`, in the task with this number, below
    /// [`SSH_SESSIONS_MAX`]. Never returns.
    ///
    /// `serve` gets the connection, the port, the peer, and what to call once somebody has logged in.
    pub async fn serve_ssh(
        &'static self,
        task: usize,
        mut serve: impl AsyncFnMut(&mut TcpStream, PortId, IpAddr, &dyn Fn()),
    ) {
        let Some(seat) = self.lobby.seats.get(task) else { return };
        loop {
            self.lobby.free.send(task).await;
            let Guest { mut stream, port, peer } = seat.guest.wait().await;
            let logged_in = || seat.event.signal(Event::LoggedIn);
            select(seat.leave.wait(), serve(&mut stream, port, peer, &logged_in)).await;
            seat.number.update(|number| number.wrapping_add(1));
            mobgate::hal::TcpStream::close(stream).await;
            seat.event.signal(Event::Ended);
        }
    }
}
