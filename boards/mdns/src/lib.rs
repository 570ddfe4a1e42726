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

use core::net::Ipv4Addr;

use domain::base::iana::{Opcode, Rtype};
use domain::base::message_builder::{PushError, RecordSectionBuilder};
use domain::base::{Message, MessageBuilder, Name, StaticCompressor, ToName, Ttl};
use domain::rdata::{A, Ptr, Srv, Txt};
use embassy_time::{Duration, Instant};
use heapless::{String, Vec};
use mobgate::settings::{HOST_NAME_BYTES_MAX, NAME_BYTES_MAX, PORTS_MAX, Settings};

/// Where queries and answers go (RFC 6762, 3).
pub const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
/// The UDP port of both ends. Who asks from another one is no multicast DNS client: it is answered alone (RFC 6762, 6.7).
pub const PORT: u16 = 5353;
/// Room for a message. What does not fit is left out: with short names that are more than three servers.
pub const MESSAGE_BYTES: usize = 400;
/// What is said; nothing when it is empty.
pub type Said = Vec<u8, MESSAGE_BYTES>;
/// An announcement is sent so often (RFC 6762, 8.3).
pub const ANNOUNCEMENTS: usize = 2;
/// From one announcement to the next.
pub const AGAIN: Duration = Duration::from_secs(1);
/// How many hops its packets could make: those who listen may want to see that they have made none (RFC 6762, 11).
pub const HOPS: u8 = 255;

/// What may be remembered for how long (RFC 6762, 10).
const TTL: Ttl = Ttl::from_secs(120);
const DOMAIN: &str = "local";
const SERVICE: [&str; 3] = ["_modbus", "_tcp", DOMAIN];
/// The list of all kinds of services (RFC 6763, 9).
const KINDS: [&str; 4] = ["_services", "_dns-sd", "_udp", DOMAIN];
/// What there is to know of a server: a string with its length in front (RFC 6763, 6).
const ABOUT: &[u8] = b"\x0fproduct=mobgate";
/// A name, a blank, and the name of a port: no more than the 63 bytes of a label.
const INSTANCE_BYTES_MAX: usize = HOST_NAME_BYTES_MAX + 1 + NAME_BYTES_MAX;
/// Such an instance and the service, and a length before each label.
const DNS_NAME_BYTES_MAX: usize = 80;

/// How often is answered at most, so that many questions cost nobody much: a requester repeats his (RFC 6762, 5.2).
pub struct Rate {
    second: Instant,
    answers: u8,
}

impl Rate {
    /// Answers in a second.
    pub const RESPONSES_MAX: u8 = 10;

    /// Nothing has been answered.
    pub const fn new() -> Self {
        Self { second: Instant::from_ticks(0), answers: 0 }
    }

    /// Whether one more may be answered `now`; then it is counted.
    pub fn admits(&mut self, now: Instant) -> bool {
        if now >= self.second + Duration::from_secs(1) {
            *self = Self { second: now, answers: 0 };
        }
        let admits = self.answers < Self::RESPONSES_MAX;
        self.answers += u8::from(admits);
        admits
    }
}

impl Default for Rate {
    fn default() -> Self {
        Self::new()
    }
}

/// A name as it is in messages.
type DnsName = Name<Vec<u8, DNS_NAME_BYTES_MAX>>;

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

/// Writes the response to `query`. There is nothing to say when it asks for something else, is no query, or the gateway is not to be
/// found.
pub fn answer(gateway: Gateway<'_>, query: &[u8], from_port: u16, said: &mut Said) {
    said.clear();
    let Ok(query) = Message::from_octets(query) else { return };
    let (header, is_legacy) = (query.header(), from_port != PORT);
    if header.qr() || header.opcode() != Opcode::QUERY {
        return;
    }
    let questions = || query.question().flatten();
    gateway.says(said, |records, said| {
        let mut message = response(said)?;
        if is_legacy {
            message.header_mut().set_id(header.id());
        }
        let mut message = message.question();
        for question in questions().filter(|_| is_legacy) {
            message.push(question)?;
        }
        let mut message = message.answer();
        records.visit(&mut |owner, data| {
            let asks = |kind: Rtype| kind == Rtype::ANY || kind == data.kind();
            let is_asked =
                questions().any(|question| asks(question.qtype()) && question.qname().name_eq(owner));
            if is_asked { data.push(&mut message, owner, TTL) } else { Ok(()) }
        })?;
        if message.counts().ancount() == 0 {
            return Ok(false);
        }
        // Who looks for servers will ask for what they are (RFC 6763, 12.1).
        let mut message = message.additional();
        records.visit(&mut |owner, data| {
            let is_service = questions().any(|question| question.qname().name_eq(&records.service));
            let is_told = is_service && data.kind() != Rtype::PTR;
            if is_told { data.push(&mut message, owner, TTL) } else { Ok(()) }
        })?;
        Ok(true)
    });
}

/// Writes what is sent to all when the gateway or its settings are new.
pub fn announcement(gateway: Gateway<'_>, said: &mut Said) {
    gateway.says(said, |records, said| records.all(said, TTL));
}

/// Writes what is sent to all when what was announced with these settings is so no more (RFC 6762, 10.1).
pub fn farewell(gateway: Gateway<'_>, said: &mut Said) {
    gateway.says(said, |records, said| records.all(said, Ttl::ZERO));
}

/// A response of one who is asked for his own (RFC 6762, 18).
fn response(said: &mut Said) -> Result<MessageBuilder<StaticCompressor<&mut Said>>, PushError> {
    let mut message =
        MessageBuilder::from_target(StaticCompressor::new(said)).map_err(|_| PushError::ShortBuf)?;
    message.header_mut().set_qr(true);
    message.header_mut().set_aa(true);
    Ok(message)
}

impl Gateway<'_> {
    /// Lets `say` write to `said`, of as many servers as there is room for; that says whether it is something.
    fn says(self, said: &mut Said, say: impl Fn(&Records<'_>, &mut Said) -> Result<bool, PushError>) {
        said.clear();
        let something = self.records().is_some_and(|mut records| {
            let servers = self.settings.modbus_servers(self.address).count().min(PORTS_MAX);
            (1..=servers).rev().find_map(|servers| {
                records.servers = servers;
                said.clear();
                say(&records, said).ok()
            }) == Some(true)
        });
        if !something {
            said.clear();
        }
    }

    /// What there is to be said, of no server.
    fn records(&self) -> Option<Records<'_>> {
        let name = self.settings.mdns_name(self.own_name)?;
        let host = dns_name(&[self.host.unwrap_or(name), DOMAIN])?;
        let (kinds, service) = (dns_name(&KINDS)?, dns_name(&SERVICE)?);
        Some(Records { gateway: *self, name, servers: 0, kinds, service, host })
    }
}

/// What there is to be said.
struct Records<'s> {
    gateway: Gateway<'s>,
    name: &'s str,
    /// How many of its servers.
    servers: usize,
    kinds: DnsName,
    service: DnsName,
    host: DnsName,
}

/// The data of a record.
enum Data<'a> {
    Address(Ipv4Addr),
    Pointer(&'a DnsName),
    /// The port and the host.
    Server(u16, &'a DnsName),
    About,
}

impl Records<'_> {
    /// Gives `each` every record with its owner.
    fn visit(
        &self,
        each: &mut dyn FnMut(&DnsName, Data<'_>) -> Result<(), PushError>,
    ) -> Result<(), PushError> {
        let Self { gateway: Gateway { settings, address, .. }, name, servers, kinds, service, host } = self;
        each(host, Data::Address(*address))?;
        each(kinds, Data::Pointer(service))?;
        for (nth, (port_name, port)) in settings.modbus_servers(*address).take(*servers).enumerate() {
            // The first one has the gateway's name alone.
            let parts = if nth == 0 { [name, "", ""] } else { [name, " ", port_name] };
            let mut instance = String::<INSTANCE_BYTES_MAX>::new();
            // It has room for all three.
            parts.iter().for_each(|part| _ = instance.push_str(part));
            let [kind, protocol, domain] = SERVICE;
            let Some(instance) = dns_name(&[&instance, kind, protocol, domain]) else { continue };
            each(service, Data::Pointer(&instance))?;
            each(&instance, Data::Server(port, host))?;
            each(&instance, Data::About)?;
        }
        Ok(())
    }

    /// Writes all of them as answers that nobody asked for.
    fn all(&self, said: &mut Said, ttl: Ttl) -> Result<bool, PushError> {
        let mut message = response(said)?.answer();
        self.visit(&mut |owner, data| data.push(&mut message, owner, ttl))?;
        Ok(true)
    }
}

impl Data<'_> {
    fn kind(&self) -> Rtype {
        match self {
            Self::Address(_) => Rtype::A,
            Self::Pointer(_) => Rtype::PTR,
            Self::Server(..) => Rtype::SRV,
            Self::About => Rtype::TXT,
        }
    }

    /// Appends it to a section of a message.
    fn push<'s>(
        self,
        section: &mut impl RecordSectionBuilder<StaticCompressor<&'s mut Said>>,
        owner: &DnsName,
        ttl: Ttl,
    ) -> Result<(), PushError> {
        match self {
            Self::Address(address) => section.push((owner, ttl, A::new(address))),
            Self::Pointer(name) => section.push((owner, ttl, Ptr::new(name))),
            Self::Server(port, host) => section.push((owner, ttl, Srv::new(0, 0, port, host))),
            Self::About => Txt::from_octets(ABOUT).map_or(Ok(()), |about| section.push((owner, ttl, about))),
        }
    }
}

/// A name of these labels; none, if they are no labels.
fn dns_name(labels: &[&str]) -> Option<DnsName> {
    let mut name = Vec::new();
    for label in labels {
        name.push(u8::try_from(label.len()).ok()?).ok()?;
        name.extend_from_slice(label.as_bytes()).ok()?;
    }
    name.push(0).ok()?;
    Name::from_octets(name).ok()
}

#[cfg(test)]
mod tests;
