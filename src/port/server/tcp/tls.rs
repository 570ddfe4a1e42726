//! A client of a server with TLS: the board shakes hands, and tells the role in the client's certificate.

use core::net::SocketAddr;
use core::pin::pin;

use embassy_time::Duration;

use super::{End, Server};
use crate::hal::{OpenError, TcpHost, TcpStream};
use crate::port::server::listening;
use crate::port::timer::within;
use crate::settings::{ClientRole, PortKind};

/// A client that has not completed the handshake by then is disconnected. It occupies none of the port's connections, but the task that
/// accepts new ones.
const HANDSHAKE_MAX: Duration = Duration::from_secs(5);

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
        match within(HANDSHAKE_MAX, pin!(stream.secure(self.id, None))).await {
            Some(Ok(role)) => Ok(role),
            Some(Err(OpenError { hint, .. })) => {
                listening::refuses_certificate(self.gateway, self.id, peer.ip(), hint);
                Err(End::Unwelcome)
            }
            None => Err(End::Stalled),
        }
    }

    /// Whether the address may connect.
    fn admits(&self, peer: SocketAddr) -> bool {
        self.gateway.settings(|settings| {
            settings.tcp_server(self.id).is_some_and(|server| server.allowed.admits(peer.ip()))
        })
    }
}
