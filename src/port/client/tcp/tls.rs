//! A connection to a server with TLS: the board shakes hands, and checks the server's certificate.

use crate::hal::{OpenError, TcpStream};
use crate::port::client::dispatcher::Dispatcher;
use crate::settings::{ServerAddress, TcpClientSettings};

/// Begins TLS with `server` if the port speaks it.
pub(super) async fn secure<S: TcpStream>(
    dispatcher: &Dispatcher<'_>,
    settings: &TcpClientSettings,
    stream: &mut S,
    server: &ServerAddress,
) -> Result<(), OpenError> {
    if settings.tls.on {
        stream.secure(dispatcher.id(), Some(server)).await?;
    }
    Ok(())
}
