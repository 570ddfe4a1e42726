//! Clients of a server with TLS.

use core::net::SocketAddr;

use super::{End, Server};
use crate::hal::{OpenError, TcpHost, TcpStream};
use crate::port::server::handshake::{Unsecured, handshake};
use crate::settings::{ClientRole, PortKind};

impl Server<'_, '_> {
    /// Whether the port speaks TLS.
    fn is_secure(&self) -> bool {
        let is_secure = |kind: &PortKind| kind.tls().is_some();
        self.gateway.settings(|settings| settings.port(self.id).is_some_and(|port| is_secure(&port.kind)))
    }

    /// Fails if the port speaks TLS and the board cannot, or lacks the certificates.
    pub(super) fn prepare<H: TcpHost>(&self, host: &H) -> Result<(), OpenError> {
        if self.is_secure() { host.prepare_tls(self.id) } else { Ok(()) }
    }

    /// Starts TLS if the port speaks it, and returns the client's role. A peer that may not connect gets no handshake.
    pub(super) async fn secure<S: TcpStream>(
        &self,
        stream: &mut S,
        peer: SocketAddr,
    ) -> Result<ClientRole, End> {
        if !self.is_secure() || !self.admits(peer) {
            return Ok(ClientRole::NONE);
        }
        handshake(self.gateway, self.id, stream, peer.ip()).await.map_err(|why| match why {
            Unsecured::Refused => End::Unwelcome,
            Unsecured::Stalled => End::Stalled,
        })
    }

    /// Whether the address may connect.
    fn admits(&self, peer: SocketAddr) -> bool {
        self.gateway.settings(|settings| {
            settings.tcp_server(self.id).is_some_and(|server| server.allowed.admits(peer.ip()))
        })
    }
}
