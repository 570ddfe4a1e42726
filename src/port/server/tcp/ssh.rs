//! A client of an SSH server: the board serves it, and reports the log-in.

use core::net::SocketAddr;

use embassy_futures::select::{Either, select};

use super::window::Window;
use super::{End, Server};
use crate::hal::TcpStream;

impl Server<'_, '_> {
    /// Serves the console. A session is never displaced; clients that have not logged in displace each other.
    pub(super) async fn converse<S: TcpStream>(
        &self,
        stream: &mut S,
        peer: SocketAddr,
        window: &mut Window,
    ) -> End {
        let logged_in = || self.connection.update(|connection| connection.marked = true);
        let served = select(self.connection.leave.wait(), stream.serve_ssh(self.id, peer, &logged_in)).await;
        if self.connection.update(|connection| connection.marked) {
            window.answered();
        }
        match served {
            Either::First(()) => End::Crowded,
            Either::Second(()) => End::Left,
        }
    }
}
