//! Binds sockets to one of the machine's addresses, or to all of them.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::os::fd::AsFd;

use mobgate::hal::{OpenError, OpenErrorKind};
use mobgate::settings::TcpListen;
use rustix::io::Errno;
use socket2::{Domain, Protocol, Socket, Type};

use crate::descriptor::Descriptor;
use crate::hint;

/// Calls `bind` for `listen`. Without an address, binds to all: IPv6 and IPv4, or IPv4 where the system has no IPv6.
pub(crate) fn at<S: AsFd>(
    listen: &TcpListen,
    bind: impl Fn(SocketAddr) -> io::Result<S>,
) -> Result<Descriptor<S>, OpenError> {
    let bound = match listen.address {
        Some(address) => bind((address, listen.port).into()),
        None => {
            bind((Ipv6Addr::UNSPECIFIED, listen.port).into()).or_else(|error| {
                match Errno::from_io_error(&error) {
                    Some(Errno::AFNOSUPPORT | Errno::ADDRNOTAVAIL) => {
                        bind((Ipv4Addr::UNSPECIFIED, listen.port).into())
                    }
                    _ => Err(error),
                }
            })
        }
    };
    bound.and_then(Descriptor::new).map_err(|error| refusal(&error))
}

/// A socket for `at`. The IPv6 wildcard address takes IPv4, too.
pub(crate) fn socket(at: SocketAddr, kind: Type, protocol: Protocol) -> io::Result<Socket> {
    let socket = Socket::new(Domain::for_address(at), kind, Some(protocol))?;
    if at.ip() == IpAddr::V6(Ipv6Addr::UNSPECIFIED) {
        socket.set_only_v6(false)?;
    }
    Ok(socket)
}

/// Maps a system error to the user's.
fn refusal(error: &io::Error) -> OpenError {
    let (kind, hint) = match Errno::from_io_error(error) {
        Some(Errno::ACCESS | Errno::PERM) => (OpenErrorKind::Denied, hint::port_denied()),
        Some(Errno::ADDRINUSE) => (OpenErrorKind::InUse, "see who listens: ss -ltnp"),
        Some(Errno::ADDRNOTAVAIL | Errno::AFNOSUPPORT) => {
            (OpenErrorKind::NotFound, "no network interface has this address")
        }
        _ => (OpenErrorKind::Failed, ""),
    };
    OpenError::new(kind, hint)
}
