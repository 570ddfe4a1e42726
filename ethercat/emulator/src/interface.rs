//! A Linux network interface as a controller's port 0: receives frames, and returns them to the sender.
//!
//! The raw socket is bound to EtherCAT (EtherType 88A4h): the kernel delivers no other frames, and none sent by this machine on the
//! interface, whether by this socket or another program. Opening it requires the capability CAP_NET_RAW. The kernel strips VLAN
//! tags and does not restore them; tagged frames belong to the VLAN's own interface.

use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};

use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use nix::sys::socket::{LinkAddr, bind, recvfrom};
use socket2::{Domain, Protocol, Socket, Type};

use crate::frame::ETHER_TYPE;

/// The kernel's type of Ethernet interfaces (ARPHRD_ETHER).
const ETHERNET: u16 = 1;

/// Why a network interface cannot be a controller's port.
#[derive(Debug, thiserror::Error)]
pub enum InterfaceError {
    /// No interface has that name.
    #[error("no such network interface")]
    Missing,
    /// It does not carry Ethernet frames.
    #[error("not an Ethernet interface")]
    NotEthernet,
    /// It is down.
    #[error("the network interface is down")]
    Down,
    /// This process lacks CAP_NET_RAW, or may not use sockets of the families AF_PACKET and AF_NETLINK.
    #[error("no permission to open a raw socket")]
    Denied,
    /// Any other error.
    #[error(transparent)]
    Failed(#[from] io::Error),
}

/// An open network interface. Nothing blocks: an operation that would have to wait returns
/// [`WouldBlock`](io::ErrorKind::WouldBlock).
#[derive(Debug)]
pub struct Interface {
    socket: Socket,
    index: usize,
}

impl Interface {
    /// Opens the interface called `name`.
    pub fn open(name: &str) -> Result<Self, InterfaceError> {
        let found = getifaddrs().map_err(|error| refused(error.into()))?;
        let (address, flags) = found
            .filter(|found| found.interface_name == name)
            .find_map(|found| Some((found.address?.as_link_addr().copied()?, found.flags)))
            .ok_or(InterfaceError::Missing)?;
        if address.hatype() != ETHERNET {
            return Err(InterfaceError::NotEthernet);
        }
        if !flags.contains(InterfaceFlags::IFF_UP) {
            return Err(InterfaceError::Down);
        }
        let protocol = Protocol::from(i32::from(ETHER_TYPE.to_be()));
        let socket = Socket::new(Domain::PACKET, Type::RAW.nonblocking().cloexec(), Some(protocol));
        let socket = socket.map_err(refused)?;
        bind(socket.as_raw_fd(), &address).map_err(io::Error::from)?;
        Ok(Self { socket, index: address.ifindex() })
    }

    /// Receives a frame without its FCS into `frame`, and returns its length. [`NetworkDown`](io::ErrorKind::NetworkDown): the
    /// interface went down or disappeared, and must be reopened.
    pub fn receive(&self, frame: &mut [u8]) -> io::Result<usize> {
        loop {
            let (length, from) = recvfrom::<LinkAddr>(self.socket.as_raw_fd(), frame)?;
            // Frames of other interfaces may arrive between socket creation and bind.
            if from.is_some_and(|from| from.ifindex() == self.index) {
                return Ok(length);
            }
        }
    }

    /// Sends a frame.
    pub fn send(&self, frame: &[u8]) -> io::Result<()> {
        self.socket.send(frame).map(|_| ())
    }
}

/// The reason of a failed socket creation.
fn refused(error: io::Error) -> InterfaceError {
    match error.raw_os_error().map(Errno::from_raw) {
        // EAFNOSUPPORT: a service may be restricted to some address families.
        Some(Errno::EPERM | Errno::EACCES | Errno::EAFNOSUPPORT) => InterfaceError::Denied,
        _ => InterfaceError::Failed(error),
    }
}

impl AsFd for Interface {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}
