//! Connections of SSH servers, served by tasks of the board.
//!
//! A session takes a future of many bytes, so each has a task of its own, and a connection's task hands its socket over. The
//! connection waits until a task is free, and ends with the session; if it is displaced before, so is the session.

use core::net::IpAddr;

use embassy_futures::select::select;
use mobgate::hal::TcpStream as _;
use mobgate::settings::PortId;

use crate::pool::Sockets;
use crate::tcp::TcpStream;

impl Sockets {
    /// Serves the connections of SSH servers one after the other, by `serve`, in the task with this number, below
    /// [`SSH_SESSIONS_MAX`](crate::SSH_SESSIONS_MAX). Never returns.
    ///
    /// `serve` gets the connection, the port, the peer, and what to call once somebody has logged in.
    pub async fn serve_ssh(
        &'static self,
        task: usize,
        mut serve: impl AsyncFnMut(&mut TcpStream, PortId, IpAddr, &dyn Fn()),
    ) {
        let Some(slot) = self.lobby.slot(task) else { return };
        while let Some(guest) = self.lobby.next(task).await {
            let mut stream = TcpStream::new(guest.connection);
            let logged_in = || slot.logged_in();
            select(slot.leave(), serve(&mut stream, guest.port, guest.peer, &logged_in)).await;
            stream.close().await;
            slot.is_left();
        }
    }
}
