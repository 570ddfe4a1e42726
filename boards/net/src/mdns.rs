//! Makes the gateway discoverable on the board's network by multicast DNS.

use core::fmt::Write as _;
use core::net::Ipv4Addr;

use embassy_futures::select::{Either4, select4};
use embassy_net::udp::{PacketMetadata, UdpSocket};
use embassy_net::{IpAddress, IpEndpoint, Stack};
use embassy_time::{Instant, Timer};
use heapless::String;
use mobgate::gateway::Gateway;
use mobgate::settings::HOST_NAME_BYTES_MAX;
use mobgate_mdns::{
    self as mdns, AGAIN, ANNOUNCEMENTS, GROUP, HOPS, MESSAGE_BYTES, PORT, Rate, Said, announcement, answer,
};

use crate::address::state;

/// Longest query. Queries for one service type are shorter.
const QUERY_BYTES_MAX: usize = 300;

/// All mDNS hosts of the link.
const ALL: IpEndpoint = IpEndpoint::new(IpAddress::Ipv4(GROUP), PORT);

/// Answers while the settings of `gateway` announce something at `stack`; never returns. Withdrawn records expire after two
/// minutes: a board does not remember what it has announced, so it sends no farewell.
pub async fn run(gateway: &Gateway<'_>, stack: Stack<'static>) -> ! {
    let (mut received, mut sent) = ([PacketMetadata::EMPTY; 1], [PacketMetadata::EMPTY; 1]);
    let (mut query, mut answers) = ([0; QUERY_BYTES_MAX], [0; MESSAGE_BYTES]);
    let mut socket = UdpSocket::new(stack, &mut received, &mut query, &mut sent, &mut answers);
    socket.set_hop_limit(Some(HOPS));
    // The port has no other user, and there is room for one group.
    let _ = (socket.bind(PORT), stack.join_multicast_group(GROUP));
    let (name, mut said) = (own_name(state(stack).hardware), Said::new());
    let mut rate = Rate::new();
    loop {
        stack.wait_config_up().await;
        let (mut announcements, mut due) = (ANNOUNCEMENTS, Instant::now());
        loop {
            let Some(own) = stack.config_v4() else { break };
            let responder = Responder { gateway, name: &name, address: own.address.address() };
            let received = socket.recv_from_with(|query, from| {
                responder.say(|gateway| answer(gateway, query, from.endpoint.port, &mut said));
                from.endpoint
            });
            let happened =
                select4(received, gateway.new_mdns(), Timer::at(due), stack.wait_config_down()).await;
            let to = match happened {
                Either4::First(_) if said.is_empty() || !rate.admits(Instant::now()) => continue,
                Either4::First(from) if from.port != PORT => from,
                Either4::First(_) => ALL,
                Either4::Second(()) => {
                    (announcements, due) = (ANNOUNCEMENTS, Instant::now());
                    continue;
                }
                Either4::Third(()) => {
                    announcements -= 1;
                    due = if announcements > 0 { Instant::now() + AGAIN } else { Instant::MAX };
                    responder.say(|gateway| announcement(gateway, &mut said));
                    ALL
                }
                Either4::Fourth(()) => break,
            };
            if !said.is_empty() {
                // A lost message is asked for again.
                let _ = socket.send_to(&said, to).await;
            }
        }
    }
}

/// A board's unique default name.
pub(crate) fn own_name([.., a, b, c]: [u8; 6]) -> String<HOST_NAME_BYTES_MAX> {
    let mut name = String::new();
    // It fits.
    let _ = write!(name, "mobgate-{a:02x}{b:02x}{c:02x}");
    name
}

/// Shared with the datagram callback, which runs while the stack is borrowed.
struct Responder<'s, 'g> {
    gateway: &'s Gateway<'g>,
    name: &'s str,
    address: Ipv4Addr,
}

impl Responder<'_, '_> {
    fn say(&self, what: impl FnOnce(mdns::Gateway<'_>)) {
        let Self { gateway, name: own_name, address } = *self;
        gateway.settings(|settings| what(mdns::Gateway { settings, own_name, host: None, address }));
    }
}
