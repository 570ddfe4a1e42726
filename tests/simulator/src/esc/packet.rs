//! A network interface as the cable: MainDevices in other programs reach the segment by real frames, on the wall clock.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::os::fd::{AsRawFd, OwnedFd};

use embassy_time::Instant;
use nix::ifaddrs::getifaddrs;
use nix::sys::socket::{
    AddressFamily, LinkAddr, MsgFlags, SockFlag, SockProtocol, SockType, bind, recvfrom, send, socket,
};

use super::cable::SharedSegment;
use super::frame::FRAME_BYTES_MAX;
use super::{Fate, now};
use crate::wall_clock::{run_beside, wait};

/// The kernel's mark of a frame that this machine sent on the interface.
const PACKET_OUTGOING: u8 = 4;

/// A raw socket on one network interface.
pub struct PacketSocket(OwnedFd);

impl PacketSocket {
    /// Opens a socket on `interface`. Needs the right to do so, which everybody has in a network namespace of their own.
    pub fn open(interface: &str) -> io::Result<Self> {
        let address = getifaddrs()?
            .filter(|found| found.interface_name == interface)
            .find_map(|found| found.address?.as_link_addr().copied())
            .ok_or_else(|| io::Error::new(ErrorKind::NotFound, format!("no interface {interface}")))?;
        let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
        let socket = socket(AddressFamily::Packet, SockType::Raw, flags, SockProtocol::EthAll)?;
        bind(socket.as_raw_fd(), &address)?;
        Ok(Self(socket))
    }

    /// A frame that came from outside, if one waits.
    fn receive(&self) -> io::Result<Option<Vec<u8>>> {
        let mut frame = vec![0; FRAME_BYTES_MAX + 4];
        loop {
            match recvfrom::<LinkAddr>(self.0.as_raw_fd(), &mut frame) {
                Ok((_, Some(from))) if from.pkttype() == PACKET_OUTGOING => {}
                Ok((length, _)) => {
                    frame.truncate(length);
                    return Ok(Some(frame));
                }
                Err(nix::errno::Errno::EAGAIN) => return Ok(None),
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Passes a frame through `segment` that has come, or waits for one until a time.
    pub fn pass(&self, segment: &SharedSegment, until: Option<Instant>) -> io::Result<()> {
        if self.pass_one(segment)? { Ok(()) } else { wait(&self.0, until) }
    }

    /// Passes a frame through `segment` that has come; says whether one had.
    fn pass_one(&self, segment: &SharedSegment) -> io::Result<bool> {
        let Some(mut frame) = self.receive()? else { return Ok(false) };
        if segment.borrow_mut().pass(now(), &mut frame, Fate::Intact) {
            send(self.0.as_raw_fd(), &frame, MsgFlags::empty())?;
        }
        Ok(true)
    }
}

/// Passes every frame that comes at `socket` through `segment`, until `device` is done, which runs between the frames.
pub fn serve<T>(
    socket: &PacketSocket,
    segment: &SharedSegment,
    device: impl Future<Output = T>,
) -> io::Result<T> {
    run_beside(&socket.0, || socket.pass_one(segment), device)
}
