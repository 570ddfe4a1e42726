//! Stands in for TLS without the feature `tls`.

use core::future::{Ready, ready};
use core::net::SocketAddr;

use super::{End, Server};
use crate::hal::{OpenError, TcpHost, TcpStream};
use crate::settings::ClientRole;

impl Server<'_, '_> {
    /// No settings have such a port.
    pub(super) fn prepare<H: TcpHost>(&self, _: &H) -> Result<(), OpenError> {
        Ok(())
    }

    /// No settings have such a port.
    pub(super) fn secure<S: TcpStream>(&self, _: &mut S, _: SocketAddr) -> Ready<Result<ClientRole, End>> {
        ready(Ok(ClientRole::NONE))
    }
}
