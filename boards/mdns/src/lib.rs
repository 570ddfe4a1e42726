//! How a gateway is found on the network: by multicast DNS (RFC 6762) it tells whoever asks for `_modbus._tcp` (RFC 6763) where its
//! Modbus TCP servers are.
//!
//! This is what is said, without a socket: [`answer`] to a query, [`announcement`] when there is something new, and
//! [`farewell`] when there is nothing any more. A system sends that from [`PORT`] to [`GROUP`].
//!
//! A name that another host of the network has is not contested (RFC 6762, 8 and 9): a board's name ends in its Ethernet address, and
//! a Linux machine's is its own.
#![no_std]
#![forbid(unsafe_code)]

use core::net::{Ipv4Addr, Ipv6Addr};

use edge_mdns::domain::base::Ttl;
use edge_mdns::host::{Host, Service, ServiceAnswers};
use edge_mdns::{
    HostAnswer, HostAnswers, HostAnswersMdnsHandler, MdnsError, MdnsHandler, MdnsRequest, MdnsResponse,
};
use embassy_time::{Duration, Instant};
use heapless::String;
use mobgate::config::{HOST_NAME_BYTES_MAX, NAME_BYTES_MAX, PORTS_MAX, Settings};

/// Where queries and answers go (RFC 6762, 3).
pub const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
/// The UDP port of both ends. Who asks from another one is no multicast DNS client: it is answered alone (RFC 6762, 6.7).
pub const PORT: u16 = 5353;
/// Room that a message needs. What does not fit is left out: with short names that are more than two servers.
pub const MESSAGE_BYTES: usize = 512;
/// An announcement is sent so often, a second apart (RFC 6762, 8.3).
pub const ANNOUNCEMENTS: usize = 2;

/// What may be remembered for how long (RFC 6762, 10).
const TTL_SECONDS: u32 = 120;
const SERVICE: (&str, &str) = ("_modbus", "_tcp");
const ABOUT: &[(&str, &str)] = &[("product", "mobgate")];
/// A name, a blank, and the name of a port: no more than the 63 bytes of a label.
const INSTANCE_BYTES_MAX: usize = HOST_NAME_BYTES_MAX + 1 + NAME_BYTES_MAX;

/// How often is answered at most, so that many questions cost nobody much: an asker repeats his (RFC 6762, 5.2).
pub struct Rate {
    second: Instant,
    answers: u8,
}

impl Rate {
    /// Answers in a second.
    pub const ANSWERS_MAX: u8 = 10;

    /// Nothing has been answered.
    pub const fn new() -> Self {
        Self { second: Instant::from_ticks(0), answers: 0 }
    }

    /// Whether one more may be answered `now`; then it is counted.
    pub fn admits(&mut self, now: Instant) -> bool {
        if now >= self.second + Duration::from_secs(1) {
            *self = Self { second: now, answers: 0 };
        }
        let admits = self.answers < Self::ANSWERS_MAX;
        self.answers += u8::from(admits);
        admits
    }
}

impl Default for Rate {
    fn default() -> Self {
        Self::new()
    }
}

/// A gateway as one of its networks sees it.
#[derive(Clone, Copy)]
pub struct Gateway<'s> {
    /// Its settings.
    pub settings: &'s Settings,
    /// Its name unless the settings say another: a label of letters, digits and `-`.
    pub own_name: &'s str,
    /// The name of the host at `address`; the gateway's, if the host is nothing else.
    pub host: Option<&'s str>,
    /// Its address there.
    pub address: Ipv4Addr,
}

/// The answer to `query`, written to `into`; its length. `None` when there is nothing to say: it asks for something else, is no
/// query, or the gateway is not to be found.
pub fn answer(gateway: Gateway<'_>, query: &[u8], from_port: u16, into: &mut [u8]) -> Option<usize> {
    gateway.say(
        TTL_SECONDS,
        MdnsRequest::Request { legacy: from_port != PORT, multicast: true, data: query },
        into,
    )
}

/// What is sent to all when the gateway or its settings are new; its length.
pub fn announcement(gateway: Gateway<'_>, into: &mut [u8]) -> Option<usize> {
    gateway.say(TTL_SECONDS, MdnsRequest::None, into)
}

/// What is sent to all when what was announced with these settings is so no more (RFC 6762, 10.1); its length.
pub fn farewell(gateway: Gateway<'_>, into: &mut [u8]) -> Option<usize> {
    gateway.say(0, MdnsRequest::None, into)
}

impl Gateway<'_> {
    fn say(self, ttl: u32, request: MdnsRequest<'_>, into: &mut [u8]) -> Option<usize> {
        let name = self.settings.mdns_name(self.own_name)?;
        let servers = self.settings.modbus_servers(self.address).count().min(PORTS_MAX);
        (1..=servers).rev().find_map(|servers| {
            let records = Records { gateway: self, name, servers, ttl: Ttl::from_secs(ttl) };
            match HostAnswersMdnsHandler::new(records).handle(request.clone(), into) {
                Ok(MdnsResponse::Reply { data, .. }) => Some(Some(data.len())),
                Ok(MdnsResponse::None) | Err(MdnsError::InvalidMessage) => Some(None),
                Err(MdnsError::ShortBuf) => None,
            }
        })?
    }
}

/// What there is to be said.
struct Records<'s> {
    gateway: Gateway<'s>,
    name: &'s str,
    /// How many of its servers.
    servers: usize,
    ttl: Ttl,
}

impl HostAnswers for Records<'_> {
    fn visit<F, E>(&self, mut each: F) -> Result<(), E>
    where
        F: FnMut(HostAnswer) -> Result<(), E>,
        E: From<MdnsError>,
    {
        let Self { gateway, name, servers, ttl } = self;
        let mut host = Host {
            hostname: gateway.host.unwrap_or(name),
            ipv4: gateway.address,
            ipv6: Ipv6Addr::UNSPECIFIED,
            ttl: *ttl,
        };
        for (nth, (port_name, port)) in
            gateway.settings.modbus_servers(gateway.address).take(*servers).enumerate()
        {
            // The first one has the gateway's name alone.
            let mut instance = String::<INSTANCE_BYTES_MAX>::new();
            let parts = if nth == 0 { [name, "", ""] } else { [name, " ", port_name] };
            // It has room for both.
            parts.iter().for_each(|part| _ = instance.push_str(part));
            let service = Service {
                name: &instance,
                priority: 0,
                weight: 0,
                service: SERVICE.0,
                protocol: SERVICE.1,
                port,
                service_subtypes: &[],
                txt_kvs: ABOUT,
            };
            ServiceAnswers::new(&host, &service).visit(&mut each)?;
            // Its address is said once.
            host.ipv4 = Ipv4Addr::UNSPECIFIED;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
