//! Addresses of a network interface: set by the kernel's netlink protocol (rtnetlink(7)).

use std::io::{self, Read};
use std::net::Ipv4Addr;

use ethercat_subdevice::eoe::IpSettings;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::LinkAddr;
use socket2::{Domain, Protocol, Socket, Type};

/// Frames that wait in the kernel for this program: those for a MainDevice that is away get old.
pub(super) const QUEUE_FRAMES: u32 = 64;
/// A way to other networks that the machine has otherwise is preferred.
const ROUTE_METRIC: u32 = 10_000;
/// Bytes of a message's header.
const HEADER_BYTES: usize = 16;
/// Attributes begin at multiples of so many bytes.
const ALIGNED: usize = 4;

/// Sets an interface's MAC address, and switches it on.
pub(super) fn switch_on(name: &str, mac: [u8; 6]) -> io::Result<()> {
    let up = (libc::IFF_UP as u32).to_ne_bytes();
    let link = [&[libc::AF_UNSPEC as u8, 0, 0, 0][..], &index(name)?, &up, &up].concat();
    let request = Request::new(libc::RTM_NEWLINK, 0, &link);
    let request = request.with(libc::IFLA_ADDRESS, &mac);
    request.with(libc::IFLA_TXQLEN, &QUEUE_FRAMES.to_ne_bytes()).send()
}

/// Sets an interface's addresses, in place of those of `before`.
pub(super) fn set(name: &str, before: &IpSettings, new: &IpSettings) -> io::Result<()> {
    if let Some(mac) = new.mac.filter(|_| new.mac != before.mac) {
        switch_on(name, mac)?;
    }
    let added = libc::NLM_F_CREATE | libc::NLM_F_REPLACE;
    // What is to go may be gone already.
    if let Some(gateway) = before.gateway.filter(|_| new.gateway != before.gateway) {
        let _ = route(libc::RTM_DELROUTE, 0, name, gateway)?.send();
    }
    if let Some(ip) = before.address.filter(|_| (before.address, before.mask) != (new.address, new.mask)) {
        let _ = address(libc::RTM_DELADDR, 0, name, ip, prefix(before))?.send();
    }
    if let Some(ip) = new.address {
        address(libc::RTM_NEWADDR, added, name, ip, prefix(new))?.send()?;
    }
    if let Some(gateway) = new.gateway {
        route(libc::RTM_NEWROUTE, added, name, gateway)?.send()?;
    }
    Ok(())
}

/// The addresses that an interface has.
pub(super) fn in_use(name: &str) -> IpSettings {
    let mut found = IpSettings::default();
    for interface in getifaddrs().into_iter().flatten().filter(|interface| interface.interface_name == name) {
        let Some(address) = interface.address else { continue };
        if let Some(mac) = address.as_link_addr().and_then(LinkAddr::addr) {
            found.mac = Some(mac);
        }
        if let Some(ip) = address.as_sockaddr_in() {
            found.address = Some(ip.ip());
            found.mask = interface.netmask.and_then(|mask| Some(mask.as_sockaddr_in()?.ip()));
        }
    }
    found
}

/// Bits of the network's prefix; without a mask it is a network of one.
pub(super) fn prefix(settings: &IpSettings) -> u8 {
    settings.mask.map_or(32, |mask| mask.to_bits().leading_ones() as u8)
}

fn index(name: &str) -> io::Result<[u8; 4]> {
    Ok(if_nametoindex(name)?.to_ne_bytes())
}

fn address(kind: u16, flags: i32, name: &str, ip: Ipv4Addr, prefix: u8) -> io::Result<Request> {
    let head = [&[libc::AF_INET as u8, prefix, 0, libc::RT_SCOPE_UNIVERSE][..], &index(name)?].concat();
    let request = Request::new(kind, flags, &head).with(libc::IFA_LOCAL, &ip.octets());
    Ok(request.with(libc::IFA_ADDRESS, &ip.octets()))
}

/// A way to all other networks.
fn route(kind: u16, flags: i32, name: &str, gateway: Ipv4Addr) -> io::Result<Request> {
    let kinds = [libc::RT_TABLE_MAIN, libc::RTPROT_STATIC, libc::RT_SCOPE_UNIVERSE, libc::RTN_UNICAST];
    let head = [&[libc::AF_INET as u8, 0, 0, 0][..], &kinds, &[0; 4]].concat();
    let request = Request::new(kind, flags, &head).with(libc::RTA_GATEWAY, &gateway.octets());
    let request = request.with(libc::RTA_OIF, &index(name)?);
    Ok(request.with(libc::RTA_PRIORITY, &ROUTE_METRIC.to_ne_bytes()))
}

/// A message to the kernel.
struct Request(Vec<u8>);

impl Request {
    fn new(kind: u16, flags: i32, body: &[u8]) -> Self {
        let flags = (flags | libc::NLM_F_REQUEST | libc::NLM_F_ACK) as u16;
        // The length comes last; sequence and sender may be zero.
        let mut bytes = [&[0; 4][..], &kind.to_ne_bytes(), &flags.to_ne_bytes(), &[0; 8]].concat();
        bytes.extend(body);
        Self(bytes)
    }

    fn with(mut self, kind: u16, value: &[u8]) -> Self {
        let length = (ALIGNED + value.len()) as u16;
        self.0.extend(length.to_ne_bytes());
        self.0.extend(kind.to_ne_bytes());
        self.0.extend(value);
        self.0.resize(self.0.len().next_multiple_of(ALIGNED), 0);
        self
    }

    /// Sends it; the kernel answers before that returns.
    fn send(mut self) -> io::Result<()> {
        let length = (self.0.len() as u32).to_ne_bytes();
        self.0.iter_mut().zip(length).for_each(|(into, byte)| *into = byte);
        let family = Protocol::from(libc::NETLINK_ROUTE);
        let socket = Socket::new(Domain::from(libc::AF_NETLINK), Type::RAW.cloexec(), Some(family))?;
        socket.send(&self.0)?;
        let mut response = [0; HEADER_BYTES + size_of::<i32>()];
        // What is longer is cut off: the request again.
        (&socket).read_exact(&mut response)?;
        let [.., a, b, c, d] = response;
        match i32::from_ne_bytes([a, b, c, d]) {
            0 => Ok(()),
            error => Err(io::Error::from_raw_os_error(-error)),
        }
    }
}
