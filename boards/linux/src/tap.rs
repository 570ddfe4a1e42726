//! A TAP interface as a MainDevice's Ethernet: a network interface whose cable ends in this program, with the kernel's stack at its
//! other end.
//!
//! Making one, and giving it addresses, needs the capability CAP_NET_ADMIN. One that was made for the program's user
//! (`ip tuntap add dev NAME mode tap user USER`) can be used without it, with the addresses that it has.

mod addresses;

use std::cell::RefCell;
use std::fmt;
use std::fs::File;
use std::future::pending;
use std::io::{self, ErrorKind, Read, Write};
use std::net::Ipv4Addr;
use std::rc::Rc;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use ethercat_subdevice::eoe::{EthernetError, FRAME_BYTES_MAX, IpSettings, Link};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::Errno;
use rustix::ioctl::{Setter, ioctl};

use crate::descriptor::Descriptor;
use crate::hint;

/// The kernel's device for such interfaces.
const DEVICE: &str = "/dev/net/tun";
/// Bytes of an interface's name with its terminating zero (IFNAMSIZ).
const NAME_BYTES: usize = 16;

/// `struct ifreq` of linux/if.h, as long as on any machine.
#[repr(C)]
struct InterfaceRequest {
    name: [u8; NAME_BYTES],
    flags: libc::c_short,
    rest: [u8; 22],
}

/// The SubDevice's link: to the TAP interface that is open, if any.
#[derive(Default)]
pub(crate) struct TapLink {
    tap: RefCell<Option<Rc<Tap>>>,
    lost: Signal<NoopRawMutex, &'static str>,
}

/// An open TAP interface.
struct Tap {
    name: String,
    file: Descriptor<File>,
    /// What the MainDevice has set.
    settings: RefCell<IpSettings>,
}

impl TapLink {
    /// Opens the interface `name`, unless it is open, and switches it on; it is made if there is none. Closes any other.
    ///
    /// # Errors
    /// Why not, and what to do.
    pub(crate) fn open(&self, name: Option<&str>) -> Result<(), &'static str> {
        if self.current().as_ref().map(|tap| tap.name.as_str()) != name {
            self.close();
            let tap = name.map(Tap::open).transpose()?;
            self.tap.replace(tap.map(Rc::new));
            self.lost.reset();
        }
        Ok(())
    }

    pub(crate) fn close(&self) {
        self.tap.take();
    }

    /// Waits for a frame of the kernel's stack.
    pub(crate) async fn arrival(&self) {
        match self.current() {
            Some(tap) => tap.file.arrival().await,
            None => pending().await,
        }
    }

    /// Waits until the interface is lost; returns why.
    pub(crate) async fn lost(&self) -> &'static str {
        self.lost.wait().await
    }

    fn current(&self) -> Option<Rc<Tap>> {
        self.tap.borrow().clone()
    }
}

impl Link for &TapLink {
    fn receive(&mut self, frame: &[u8]) {
        if let Some(tap) = self.current() {
            // While it is off, or the kernel's queue is full, frames get lost, as on any cable.
            let _ = tap.file.get_ref().write(frame);
        }
    }

    fn transmit(&mut self, into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let tap = self.current()?;
        match tap.file.get_ref().read(into) {
            Ok(length) => Some(length),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => None,
            Err(error) => {
                self.close();
                self.lost.signal(hint::keep(format!("the TAP interface {}: {error}", tap.name)));
                None
            }
        }
    }

    fn start(&mut self) {
        let mut frame = [0; FRAME_BYTES_MAX];
        // As many as wait at most.
        for _ in 0..addresses::QUEUE_FRAMES {
            if self.transmit(&mut frame).is_none() {
                break;
            }
        }
    }

    fn configure(&mut self, new: &IpSettings) -> Result<(), EthernetError> {
        self.current().ok_or(EthernetError::NoIpSupport)?.configure(new)
    }

    fn settings(&mut self) -> Result<IpSettings, EthernetError> {
        Ok(self.current().ok_or(EthernetError::NoIpSupport)?.settings())
    }
}

impl Tap {
    fn open(name: &str) -> Result<Self, &'static str> {
        let opened = attach(name).and_then(Descriptor::new).map_err(|error| {
            hint::keep(match Errno::from_io_error(&error) {
                Some(Errno::PERM | Errno::ACCESS) => return hint::tap_denied(),
                Some(Errno::NOENT | Errno::NODEV | Errno::NXIO) => {
                    format!("the kernel has no TAP interfaces: sudo modprobe tun ({DEVICE})")
                }
                Some(Errno::BUSY) => format!("the interface {name} is in use by another program"),
                Some(Errno::INVAL) => format!("{name} is not a TAP interface: name another one"),
                _ => format!("the TAP interface {name}: {error}"),
            })
        })?;
        if let Err(error) = addresses::switch_on(name, mac_of(name)) {
            log::warn!("{name}: the MAC address stays as it is: {}", why(&error));
        }
        Ok(Self { name: name.to_owned(), file: opened, settings: RefCell::default() })
    }

    /// Applies what is set in `new`, or nothing.
    fn configure(&self, new: &IpSettings) -> Result<(), EthernetError> {
        let before = self.settings.borrow().clone();
        let after = with(&before, new);
        let (name, shown) = (&self.name, Shown(&after));
        match addresses::set(name, &before, &after) {
            Ok(()) => log::info!("{name}: addresses of the MainDevice: {shown}"),
            Err(error) => {
                log::warn!("{name}: the MainDevice's addresses ({shown}) are not in use: {}", why(&error));
                // As far as some are.
                let _ = addresses::set(name, &after, &before);
                return Err(match is_denied(&error) {
                    true => EthernetError::NoIpSupport,
                    false => EthernetError::Unspecified,
                });
            }
        }
        self.settings.replace(after);
        Ok(())
    }

    /// What the MainDevice has set, or else what the interface has.
    fn settings(&self) -> IpSettings {
        with(&addresses::in_use(&self.name), &self.settings.borrow())
    }
}

/// `settings` with what is set in `new`.
fn with(settings: &IpSettings, new: &IpSettings) -> IpSettings {
    let ip =
        |before: Option<Ipv4Addr>, new: Option<Ipv4Addr>| new.or(before).filter(|ip| !ip.is_unspecified());
    IpSettings {
        mac: new.mac.or(settings.mac),
        address: ip(settings.address, new.address),
        mask: ip(settings.mask, new.mask),
        gateway: ip(settings.gateway, new.gateway),
        dns_server: ip(settings.dns_server, new.dns_server),
        name: new.name.clone().or_else(|| settings.name.clone()),
    }
}

fn attach(name: &str) -> io::Result<File> {
    let flags = OFlags::RDWR | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let file = open(DEVICE, flags, Mode::empty())?;
    let mut request = InterfaceRequest {
        name: [0; NAME_BYTES],
        // Frames come as they are, without a header of the kernel's.
        flags: (libc::IFF_TAP | libc::IFF_NO_PI) as libc::c_short,
        rest: [0; 22],
    };
    // The last byte stays zero.
    request.name.iter_mut().zip(name.bytes().take(NAME_BYTES - 1)).for_each(|(into, byte)| *into = byte);
    // SAFETY: TUNSETIFF reads and writes a `struct ifreq`; `InterfaceRequest` has its layout and is no shorter, and any bytes are
    // valid.
    unsafe { ioctl(&file, Setter::<{ libc::TUNSETIFF as _ }, InterfaceRequest>::new(request)) }?;
    Ok(file.into())
}

/// A MAC address of this machine's own choice (bit 1 of its first byte), the same after each start.
fn mac_of(name: &str) -> [u8; 6] {
    let machine = std::fs::read_to_string("/etc/machine-id").unwrap_or_else(|_| {
        String::from_utf8_lossy(rustix::system::uname().nodename().to_bytes()).into_owned()
    });
    // FNV-1a, 64 bits.
    let hashed = machine.bytes().chain(name.bytes()).fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    let [first, b, c, d, e, f, ..] = hashed.to_le_bytes();
    [first & 0xfc | 0x02, b, c, d, e, f]
}

fn is_denied(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::PERM | Errno::ACCESS))
}

/// What an error means to the user.
fn why(error: &io::Error) -> String {
    if is_denied(error) { hint::tap_denied().to_owned() } else { error.to_string() }
}

/// Settings, as in a line of the log.
struct Shown<'a>(&'a IpSettings);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.address {
            Some(ip) => write!(f, "{ip}/{}", addresses::prefix(self.0))?,
            None => f.write_str("no IP address")?,
        }
        self.0.gateway.map_or(Ok(()), |gateway| write!(f, " by {gateway}"))
    }
}

#[cfg(test)]
mod tests {
    use super::mac_of;

    #[test]
    fn a_mac_address_is_local_stable_and_one_for_each_name() {
        let [one, again, other] = ["eoe0", "eoe0", "eoe1"].map(mac_of);
        assert_eq!((one, one[0] & 3), (again, 2));
        assert_ne!(one, other);
    }
}
