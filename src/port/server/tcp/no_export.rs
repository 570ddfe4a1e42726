//! What stands for a capture's client in a gateway that keeps no frames: without the feature `capture`.

use super::{End, Server};
use crate::hal::TcpStream;

impl Server<'_, '_> {
    /// There is nothing to give. Settings with such a server are refused before.
    pub(super) async fn export<S: TcpStream>(&self, _: &mut S) -> End {
        End::Left
    }
}
