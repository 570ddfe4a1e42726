//! Stands in for the capture export without the feature `capture`.

use super::{End, Server};
use crate::hal::TcpStream;

impl Server<'_, '_> {
    /// Never used: settings with such a server are refused.
    pub(super) async fn export<S: TcpStream>(&self, _: &mut S) -> End {
        End::Left
    }
}
