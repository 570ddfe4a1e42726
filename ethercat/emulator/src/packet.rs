//! A network interface as the cable: MainDevices in other programs reach the segment with real frames, on the wall clock.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::os::fd::AsFd;

use crate::frame::FRAME_BYTES_MAX;
use crate::interface::{Interface, InterfaceError};
use embassy_time::Instant;

use super::cable::SharedSegment;
use super::{Fate, now};
use mobgate_world::wall_clock::{run_beside, wait};

/// A raw socket on one network interface.
pub struct PacketSocket(Interface);

impl PacketSocket {
    /// Opens a socket on `interface`. Requires CAP_NET_RAW, which everyone has in a network namespace of their own.
    pub fn open(interface: &str) -> Result<Self, InterfaceError> {
        Interface::open(interface).map(Self)
    }

    /// Passes a received frame through `segment`, or waits for one until a time.
    pub fn pass(&self, segment: &SharedSegment, until: Option<Instant>) -> io::Result<()> {
        if self.pass_one(segment)? { Ok(()) } else { wait(&[self.0.as_fd()], until) }
    }

    /// Passes a received frame through `segment`; returns whether there was one.
    fn pass_one(&self, segment: &SharedSegment) -> io::Result<bool> {
        self.carry(self, |frame| segment.borrow_mut().pass(now(), frame, Fate::Intact))
    }

    /// Takes a received frame, and sends it out at `behind` if it `passes`; returns whether there was one.
    fn carry(&self, behind: &Self, passes: impl FnOnce(&mut [u8]) -> bool) -> io::Result<bool> {
        let mut frame = [0; FRAME_BYTES_MAX];
        let frame = match self.0.receive(&mut frame) {
            Ok(length) => &mut frame[..length],
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
            Err(error) => return Err(error),
        };
        if passes(frame) {
            behind.0.send(frame)?;
        }
        Ok(true)
    }
}

/// Passes every frame received at `socket` through `segment`, until `device` completes, which runs between frames.
pub fn serve<T>(
    socket: &PacketSocket,
    segment: &SharedSegment,
    device: impl Future<Output = T>,
) -> io::Result<T> {
    run_beside(&[socket.0.as_fd()], || socket.pass_one(segment), device)
}

/// The same with a ring: frames received at one of `ends` leave at the other.
pub fn serve_ring<T>(
    ends: [&PacketSocket; 2],
    ring: &SharedSegment,
    device: impl Future<Output = T>,
) -> io::Result<T> {
    let [first, second] = ends;
    let carry = || {
        let forth = first.carry(second, |frame| ring.borrow_mut().pass(now(), frame, Fate::Intact))?;
        let back = second.carry(first, |frame| ring.borrow_mut().pass_back(now(), frame, Fate::Intact))?;
        Ok(forth || back)
    };
    run_beside(&[first.0.as_fd(), second.0.as_fd()], carry, device)
}
