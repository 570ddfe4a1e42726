//! Outgoing connections of the gateway to servers.

use core::net::{IpAddr, Ipv4Addr};

use embassy_net::Stack;
use embassy_net::tcp::ConnectError;
use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect};
use mobgate::settings::{Host, ServerAddress};

use crate::names;
use crate::pool::Sockets;
use crate::tcp::{IPV4_ONLY, TcpStream, set_up};

/// Opens outgoing connections.
#[derive(Clone, Copy)]
pub struct Connector(&'static Sockets);

impl Connector {
    /// Takes its sockets from `sockets`.
    pub const fn new(sockets: &'static Sockets) -> Self {
        Self(sockets)
    }
}

impl TcpConnect for Connector {
    type Stream<'a> = TcpStream;

    async fn connect(&self, server: &ServerAddress) -> Result<TcpStream, OpenError> {
        let address = address_of(self.0.stack(), server).await?;
        let mut pooled = self.0.tcp()?;
        pooled.get().connect((address, server.port)).await.map_err(refusal)?;
        // After the handshake, whose time the caller limits.
        set_up(pooled.get());
        Ok(TcpStream::new(pooled))
    }
}

/// The address of `server`, if there is a route to it; embassy-net would wait for ever.
pub(crate) async fn address_of(stack: Stack<'static>, server: &ServerAddress) -> Result<Ipv4Addr, OpenError> {
    let address = match &server.host {
        Host::Address(IpAddr::V4(address)) => *address,
        Host::Address(IpAddr::V6(_)) => return Err(IPV4_ONLY),
        Host::Name(name) => names::look_up(stack, name).await?,
    };
    let own = stack.config_v4();
    let has_way = own.is_some_and(|own| own.gateway.is_some() || own.address.contains_addr(&address));
    if has_way { Ok(address) } else { Err(refusal(ConnectError::NoRoute)) }
}

/// Maps embassy-net's error to the user's.
fn refusal(error: ConnectError) -> OpenError {
    match error {
        ConnectError::ConnectionReset => {
            OpenError::new(OpenErrorKind::Refused, "nobody listens there: is it the right TCP port?")
        }
        ConnectError::TimedOut => OpenError::new(OpenErrorKind::TimedOut, ""),
        ConnectError::NoRoute => {
            OpenError::new(OpenErrorKind::NotFound, "no way to that network: see show network")
        }
        ConnectError::InvalidState => OpenError::new(OpenErrorKind::Failed, ""),
    }
}
