//! A connection to a server with TLS: the board shakes hands, and checks the server's certificate.

use super::ConnectionTask;
use crate::hal::{OpenError, TcpConnect, TcpStream};
use crate::settings::ServerAddress;

impl<C: TcpConnect> ConnectionTask<'_, '_, C> {
    /// Opens a connection to the server at `address`, with TLS if the port speaks it.
    pub(super) async fn open(&self, address: &ServerAddress) -> Result<C::Stream<'_>, OpenError> {
        let mut stream = self.connector.connect(address).await?;
        if self.settings.tls.on {
            stream.secure(self.dispatcher.id(), Some(address)).await?;
        }
        Ok(stream)
    }
}
