//! Stands in for SSH without the feature `ssh`.

use core::net::SocketAddr;

use super::window::Window;
use super::{End, Server};
use crate::hal::TcpStream;

impl Server<'_, '_> {
    /// Never used: no settings have such a server.
    pub(super) async fn converse<S: TcpStream>(&self, _: &mut S, _: SocketAddr, _: &mut Window) -> End {
        End::Left
    }
}
