//! What passes the program's interface, with the kernel's time stamps.

use std::collections::HashMap;
use std::io::IoSliceMut;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use ethercat_esc::Command;
use ethercat_esc::frame::{FRAME_BYTES_MAX, datagrams};
use mobgate_simulator::own_network::SEGMENT_END;
use nix::cmsg_space;
use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::sys::socket::sockopt::{ReceiveTimeout, ReceiveTimestampns};
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, LinkAddr, MsgFlags, SockFlag, SockProtocol, SockType, bind, recvmsg,
    setsockopt, socket,
};
use nix::sys::time::{TimeSpec, TimeVal};

/// The kernel's mark of a frame that this machine sends on the interface.
const PACKET_OUTGOING: u8 = 4;
/// Where a frame says its number, in its first datagram.
const INDEX: usize = 17;

/// How the frames with process data fared.
#[derive(Default)]
pub(crate) struct Passages {
    /// From the way in to the way out.
    pub(crate) added: Vec<Duration>,
    /// Frames that did not come out before the next one with the same number came in.
    pub(crate) lost: usize,
}

/// A socket that sees all that comes in at the program's interface, and goes out.
pub(crate) struct Tap(OwnedFd);

impl Tap {
    pub(crate) fn open() -> Self {
        let mut found = getifaddrs().unwrap().filter(|found| found.interface_name == SEGMENT_END);
        let address = found.find_map(|found| found.address?.as_link_addr().copied()).unwrap();
        let flags = SockFlag::SOCK_CLOEXEC;
        let tap = socket(AddressFamily::Packet, SockType::Raw, flags, SockProtocol::EthAll).unwrap();
        setsockopt(&tap, ReceiveTimestampns, &true).unwrap();
        setsockopt(&tap, ReceiveTimeout, &TimeVal::new(0, 50_000)).unwrap();
        bind(tap.as_raw_fd(), &address).unwrap();
        Self(tap)
    }

    /// Watches until it is `over`.
    pub(crate) fn watch(&self, over: &AtomicBool) -> Passages {
        let (mut passages, mut inside) = (Passages::default(), HashMap::new());
        while !over.load(Relaxed) {
            let Some((number, at, outgoing)) = self.next() else { continue };
            if outgoing {
                let came: Option<Duration> = inside.remove(&number);
                passages.added.extend(came.map(|came| at.saturating_sub(came)));
            } else {
                passages.lost += usize::from(inside.insert(number, at).is_some());
            }
        }
        passages.lost += inside.len();
        passages
    }

    /// The next frame with process data, if one comes soon: its number, when it was here, and whether on the way out.
    fn next(&self) -> Option<(u8, Duration, bool)> {
        let mut frame = [0; FRAME_BYTES_MAX];
        let mut space = cmsg_space!(TimeSpec);
        let mut slices = [IoSliceMut::new(&mut frame)];
        let message =
            recvmsg::<LinkAddr>(self.0.as_raw_fd(), &mut slices, Some(&mut space), MsgFlags::empty());
        let message = match message {
            Err(Errno::EAGAIN | Errno::EINTR) => return None,
            message => message.unwrap(),
        };
        let outgoing = message.address?.pkttype() == PACKET_OUTGOING;
        let stamp = message.cmsgs().unwrap().find_map(|message| match message {
            ControlMessageOwned::ScmTimestampns(stamp) => Some(Duration::from(stamp)),
            _ => None,
        });
        let length = message.bytes;
        let frame = &mut frame[..length];
        let exchanges = datagrams(frame).any(|datagram| datagram.command() == Some(Command::Lrw));
        exchanges.then(|| (frame[INDEX], stamp.unwrap(), outgoing))
    }
}
