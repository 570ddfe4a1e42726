//! Makes the gateway discoverable on the machine's networks by multicast DNS: one socket for all of them, and the kernel's
//! notifications of network changes.
//!
//! A query is answered through the interface of the querier's network; queries from outside the local networks are ignored (RFC
//! 6762, 11).

use std::future::pending;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::OwnedFd;

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer};
use mobgate::gateway::Gateway;
use mobgate_mdns::{AGAIN, ANNOUNCEMENTS, GROUP, HOPS, PORT, Rate, Said, announcement, answer, farewell};
use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SocketType, bind, recv, socket};
use socket2::{Domain, Protocol, Socket, Type};

use crate::descriptor::Descriptor;

/// Multicast groups of the kernel's notifications about links and IPv4 addresses (rtnetlink(7)).
const NEWS: u32 = 0x1 | 0x10;
/// Buffer for a kernel notification. Only its arrival matters.
const NEWS_BYTES: usize = 8_192;
/// Longest message (RFC 6762, 17).
const QUERY_BYTES_MAX: usize = 9_000;
/// Retry interval if the socket cannot be opened.
const RETRY: Duration = Duration::from_secs(60);

/// Answers while the settings of `gateway` announce something; returns only if the kernel refuses notifications.
pub async fn run(gateway: &Gateway<'_>) {
    let news = match news() {
        Ok(news) => news,
        Err(error) => return log::warn!("mdns: the kernel does not tell of networks: {error}"),
    };
    Responder::new(gateway).run(news).await
}

/// The kernel's notifications of network changes.
fn news() -> io::Result<Descriptor<OwnedFd>> {
    let news = socket(AddressFamily::NETLINK, SocketType::RAW, None)?;
    bind(&news, &SocketAddrNetlink::new(0, NEWS))?;
    Descriptor::new(news)
}

/// A network of this machine.
struct Network {
    name: String,
    address: Ipv4Addr,
    mask: Ipv4Addr,
    /// Withdraws what is announced there; empty if nothing is.
    farewell: Said,
}

impl Network {
    fn has(&self, address: Ipv4Addr) -> bool {
        self.address & self.mask == address & self.mask
    }

    /// Whether `other` is the same network with the same announcements.
    fn is(&self, other: &Self) -> bool {
        (&self.name, self.address, &self.farewell) == (&other.name, other.address, &other.farewell)
    }
}

struct Responder<'s, 'g> {
    gateway: &'s Gateway<'g>,
    name: String,
    host: String,
    networks: Vec<Network>,
    socket: Option<Descriptor<UdpSocket>>,
    /// The socket could not be opened, and a warning was logged.
    failed: bool,
    /// Announcements still to be sent, and the time of the next one or of the next attempt to open the socket.
    announcements: usize,
    due: Instant,
    rate: Rate,
}

impl<'s, 'g> Responder<'s, 'g> {
    fn new(gateway: &'s Gateway<'g>) -> Self {
        let name = host_label(&rustix::system::uname().nodename().to_string_lossy());
        // The machine's own name belongs to its own responder.
        let host = format!("{name}-mobgate");
        let (networks, socket, failed) = (Vec::new(), None, false);
        let (announcements, due, rate) = (0, Instant::MAX, Rate::new());
        Self { gateway, name, host, networks, socket, failed, announcements, due, rate }
    }

    async fn run(mut self, mut news: Descriptor<OwnedFd>) {
        let (mut query, mut told) = ([0; QUERY_BYTES_MAX], [0; NEWS_BYTES]);
        self.look();
        loop {
            let socket = self.socket.as_mut();
            let received = async {
                match socket {
                    Some(socket) => socket.read_with(|socket| socket.recv_from(&mut query)).await,
                    None => pending().await,
                }
            };
            let changed = news.read_with(|news| Ok(recv(news, &mut told, RecvFlags::empty())?));
            match select4(received, changed, self.gateway.new_mdns(), Timer::at(self.due)).await {
                Either4::First(Ok((length, from))) => self.answer(&query[..length], from),
                Either4::First(Err(error)) => self.fails(&error),
                // Also if the kernel lost notifications (ENOBUFS).
                Either4::Second(_) | Either4::Third(()) => self.look(),
                Either4::Fourth(()) if self.socket.is_none() => self.look(),
                Either4::Fourth(()) => self.announce(),
            }
        }
    }

    /// Updates the networks and what is announced there.
    fn look(&mut self) {
        let mut networks = networks();
        for network in &mut networks {
            network.farewell = self.say(network.address, farewell);
        }
        for gone in self.networks.iter().filter(|old| !networks.iter().any(|new| new.is(old))) {
            self.multicast(gone.address, &gone.farewell);
        }
        let news = networks.iter().any(|new| !self.networks.iter().any(|old| old.is(new)));
        self.networks = networks;
        if self.networks.iter().all(|network| network.farewell.is_empty()) {
            (self.socket, self.due) = (None, Instant::MAX);
        } else if news || self.socket.is_none() {
            match self.open() {
                Ok(()) => {
                    let name =
                        self.gateway.settings(|settings| settings.mdns_name(&self.name).map(str::to_owned));
                    log::info!("found on the network as {}", name.unwrap_or_default());
                    (self.announcements, self.due) = (ANNOUNCEMENTS, Instant::now());
                }
                Err(error) => self.fails(&error),
            }
        }
    }

    /// Opens the socket if necessary, and joins the group on all networks.
    fn open(&mut self) -> io::Result<()> {
        let socket = match self.socket.take() {
            Some(socket) => socket,
            None => {
                let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
                // The machine may run another responder.
                socket.set_reuse_address(true)?;
                socket.set_multicast_ttl_v4(HOPS.into())?;
                socket.bind(&SocketAddrV4::new(GROUP, PORT).into())?;
                Descriptor::new(socket.into())?
            }
        };
        for network in &self.networks {
            match socket.get_ref().join_multicast_v4(&GROUP, &network.address) {
                // Already joined.
                Err(error) if error.kind() == io::ErrorKind::AddrInUse => {}
                joined => joined?,
            }
        }
        (self.socket, self.failed) = (Some(socket), false);
        Ok(())
    }

    fn fails(&mut self, error: &io::Error) {
        if !self.failed {
            log::warn!("mdns: UDP port {PORT}: {error}; the gateway is not found on the network");
        }
        (self.failed, self.socket, self.due) = (true, None, Instant::now() + RETRY);
    }

    fn announce(&mut self) {
        for network in &self.networks {
            self.multicast(network.address, &self.say(network.address, announcement));
        }
        self.announcements = self.announcements.saturating_sub(1);
        self.due = if self.announcements > 0 { Instant::now() + AGAIN } else { Instant::MAX };
    }

    fn answer(&mut self, query: &[u8], from: SocketAddr) {
        let IpAddr::V4(peer) = from.ip() else { return };
        let Some(network) = self.networks.iter().find(|network| network.has(peer)) else { return };
        let said = self.say(network.address, |gateway, said| answer(gateway, query, from.port(), said));
        if said.is_empty() || !self.rate.admits(Instant::now()) {
            return;
        }
        match (&self.socket, from.port()) {
            (_, PORT) => self.multicast(network.address, &said),
            // A lost answer is asked for again.
            (Some(socket), _) => _ = socket.get_ref().send_to(&said, from),
            (None, _) => {}
        }
    }

    /// The message for the network with this `address`, as written by `what`.
    fn say(&self, address: Ipv4Addr, what: impl FnOnce(mobgate_mdns::Gateway<'_>, &mut Said)) -> Said {
        let mut said = Said::new();
        self.gateway.settings(|settings| {
            let (own_name, host) = (self.name.as_str(), Some(self.host.as_str()));
            what(mobgate_mdns::Gateway { settings, own_name, host, address }, &mut said);
        });
        said
    }

    /// Multicasts in the network with this `address`.
    fn multicast(&self, address: Ipv4Addr, message: &Said) {
        let Some(socket) = self.socket.as_ref().filter(|_| !message.is_empty()) else { return };
        let socket = socket.get_ref();
        let sent = socket2::SockRef::from(socket)
            .set_multicast_if_v4(&address)
            .and_then(|()| socket.send_to(message, (GROUP, PORT)));
        if let Err(error) = sent {
            log::debug!("mdns: at {address}: {error}");
        }
    }
}

/// The multicast networks that are up, without the loopback.
fn networks() -> Vec<Network> {
    let needed = InterfaceFlags::IFF_UP | InterfaceFlags::IFF_MULTICAST;
    let all = getifaddrs().into_iter().flatten();
    all.filter(|one| one.flags.contains(needed) && !one.flags.contains(InterfaceFlags::IFF_LOOPBACK))
        .filter_map(|one| {
            let address = one.address?.as_sockaddr_in()?.ip();
            let mask = one.netmask?.as_sockaddr_in()?.ip();
            Some(Network { name: one.interface_name, address, mask, farewell: Said::new() })
        })
        .collect()
}

/// The first label of a host name, limited to what a gateway's name may contain.
fn host_label(name: &str) -> String {
    let label = name.split('.').next().unwrap_or_default();
    let good = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '-' };
    let label: String = label.chars().map(good).take(mobgate::settings::HOST_NAME_BYTES_MAX).collect();
    let label = label.trim_matches('-');
    if label.is_empty() { "mobgate".to_owned() } else { label.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_is_called_by_its_first_label() {
        for (name, label) in [
            ("pc", "pc"),
            ("pc.example.com", "pc"),
            ("my_pc", "my-pc"),
            ("-", "mobgate"),
            ("", "mobgate"),
            ("(none)", "none"),
            ("a-name-that-is-longer-than-a-gateways", "a-name-that-is-longer-than-a-gat"),
        ] {
            assert_eq!(host_label(name), label, "{name}");
        }
    }
}
