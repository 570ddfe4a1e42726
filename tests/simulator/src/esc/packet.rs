//! A network interface as the cable: MainDevices in other programs reach the segment by real frames, on the wall clock.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use embassy_time::Instant;
use nix::ifaddrs::getifaddrs;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::socket::{
    AddressFamily, LinkAddr, MsgFlags, SockFlag, SockProtocol, SockType, bind, recvfrom, send, socket,
};
use nix::sys::time::TimeSpec;

use super::cable::SharedSegment;
use super::frame::FRAME_BYTES_MAX;
use super::{Fate, now};

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
        let Some(mut frame) = self.receive()? else { return self.wait(until) };
        if segment.borrow_mut().pass(now(), &mut frame, Fate::Intact) {
            send(self.0.as_raw_fd(), &frame, MsgFlags::empty())?;
        }
        Ok(())
    }

    fn wait(&self, until: Option<Instant>) -> io::Result<()> {
        let timeout = until.map(|until| {
            let left = until.saturating_duration_since(Instant::now());
            TimeSpec::from(std::time::Duration::from_micros(left.as_micros()))
        });
        match ppoll(&mut [PollFd::new(self.0.as_fd(), PollFlags::POLLIN)], timeout, None) {
            Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Passes every frame that comes at `socket` through `segment`, until `device` is done, which runs between the frames.
pub fn serve<T>(
    socket: &PacketSocket,
    segment: &SharedSegment,
    device: impl Future<Output = T>,
) -> io::Result<T> {
    let mut device = pin!(device);
    let woken = Arc::new(Woken(AtomicBool::new(true)));
    let waker = Waker::from(woken.clone());
    loop {
        mobgate_clock::fire_due();
        while woken.0.swap(false, Ordering::Relaxed) {
            if let Poll::Ready(value) = device.as_mut().poll(&mut Context::from_waker(&waker)) {
                return Ok(value);
            }
        }
        socket.pass(segment, mobgate_clock::next_alarm().map(Instant::from_ticks))?;
    }
}
