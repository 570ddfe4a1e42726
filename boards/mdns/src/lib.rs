//! Multicast DNS messages (RFC 6762): a gateway announces its Modbus TCP servers as `_modbus._tcp` services (RFC 6763).
//!
//! No sockets: this crate writes the [`answer`] to a query, the [`announcement`] of a change, and the [`farewell`] at the end. A
//! system sends them from [`PORT`] to [`GROUP`].
//!
//! Names are not probed for conflicts (RFC 6762, 8 and 9): a board's name ends in its Ethernet address, and a Linux machine's is
//! its own.
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

/// Destination of queries and answers (RFC 6762, 3).
pub const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
/// The UDP port of both ends. A query from another port is a legacy one, answered by unicast (RFC 6762, 6.7).
pub const PORT: u16 = 5353;
/// Size of a message. Servers that do not fit are left out; with short names, about three fit.
pub const MESSAGE_BYTES: usize = 400;
/// A message; empty if there is nothing to send.
pub type Said = Vec<u8, MESSAGE_BYTES>;
/// Number of times an announcement is sent (RFC 6762, 8.3).
pub const ANNOUNCEMENTS: usize = 2;
/// Interval between announcements.
pub const AGAIN: Duration = Duration::from_secs(1);
/// IP TTL of its packets: receivers may check that they crossed no router (RFC 6762, 11).
pub const HOPS: u8 = 255;

/// How long records may be cached (RFC 6762, 10).
const TTL: Ttl = Ttl::from_secs(120);
const DOMAIN: &str = "local";
const SERVICE: [&str; 3] = ["_modbus", "_tcp", DOMAIN];
/// The list of all service types (RFC 6763, 9).
const KINDS: [&str; 4] = ["_services", "_dns-sd", "_udp", DOMAIN];
/// TXT record of a server: a string with a length prefix (RFC 6763, 6).
const ABOUT: &[u8] = b"\x0fproduct=mobgate";
/// A name, a space, and a port's name: no more than the 63 bytes of a label.
const INSTANCE_BYTES_MAX: usize = HOST_NAME_BYTES_MAX + 1 + NAME_BYTES_MAX;
/// Such an instance and the service, each label with a length prefix.
const DNS_NAME_BYTES_MAX: usize = 80;

/// Limits the answer rate, so that a flood of queries costs little: queriers repeat theirs (RFC 6762, 5.2).
pub struct Rate {
    second: Instant,
    answers: u8,
}

impl Rate {
    /// Most answers per second.
    pub const RESPONSES_MAX: u8 = 10;

    /// No answers yet.
    pub const fn new() -> Self {
        Self { second: Instant::from_ticks(0), answers: 0 }
    }

    /// Whether another answer may be sent at `now`; if so, counts it.
    pub fn admits(&mut self, now: Instant) -> bool {
        if now >= self.second + Duration::from_secs(1) {
            *self = Self { second: now, answers: 0 };
        }
        let admits = self.answers < Self::RESPONSES_MAX;
        self.answers += u8::from(admits);
        admits
    }
}

/// A name in wire format.
type DnsName = Name<Vec<u8, DNS_NAME_BYTES_MAX>>;

/// A gateway as seen on one of its networks.
#[derive(Clone, Copy)]
pub struct Gateway<'s> {
    /// Its settings.
    pub settings: &'s Settings,
    /// Its name, unless the settings set another: a label of letters, digits and `-`.
    pub own_name: &'s str,
    /// The host name at `address`; `None` if it is the gateway's name.
    pub host: Option<&'s str>,
    /// Its address on that network.
    pub address: Ipv4Addr,
}

/// Writes the response to `query`; empty if the message is no query or asks for something else, or if the gateway is hidden.
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
        // A client that browses for servers will ask for these next (RFC 6763, 12.1).
        let mut message = message.additional();
        records.visit(&mut |owner, data| {
            let is_service = questions().any(|question| question.qname().name_eq(&records.service));
            let is_told = is_service && data.kind() != Rtype::PTR;
            if is_told { data.push(&mut message, owner, TTL) } else { Ok(()) }
        })?;
        Ok(true)
    });
}

/// Writes the announcement of a new gateway, or of changed settings.
pub fn announcement(gateway: Gateway<'_>, said: &mut Said) {
    gateway.says(said, |records, said| records.all(said, TTL));
}

/// Writes the withdrawal of what was announced with these settings (RFC 6762, 10.1).
pub fn farewell(gateway: Gateway<'_>, said: &mut Said) {
    gateway.says(said, |records, said| records.all(said, Ttl::ZERO));
}

/// An authoritative response (RFC 6762, 18).
fn response(said: &mut Said) -> Result<MessageBuilder<StaticCompressor<&mut Said>>, PushError> {
    let mut message =
        MessageBuilder::from_target(StaticCompressor::new(said)).map_err(|_| PushError::ShortBuf)?;
    message.header_mut().set_qr(true);
    message.header_mut().set_aa(true);
    Ok(message)
}

impl Gateway<'_> {
    /// Lets `say` write to `said` with as many servers as fit; `say` returns whether there is anything to send.
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

    /// All records, still without servers.
    fn records(&self) -> Option<Records<'_>> {
        let name = self.settings.mdns_name(self.own_name)?;
        let host = dns_name(&[self.host.unwrap_or(name), DOMAIN])?;
        let (kinds, service) = (dns_name(&KINDS)?, dns_name(&SERVICE)?);
        Some(Records { gateway: *self, name, servers: 0, kinds, service, host })
    }
}

/// The records of a gateway.
struct Records<'s> {
    gateway: Gateway<'s>,
    name: &'s str,
    /// Number of its servers to include.
    servers: usize,
    kinds: DnsName,
    service: DnsName,
    host: DnsName,
}

/// The data of a record.
enum Data<'a> {
    Address(Ipv4Addr),
    Pointer(&'a DnsName),
    /// Port and host.
    Server(u16, &'a DnsName),
    About,
}

impl Records<'_> {
    /// Calls `each` with every record and its owner.
    fn visit(
        &self,
        each: &mut dyn FnMut(&DnsName, Data<'_>) -> Result<(), PushError>,
    ) -> Result<(), PushError> {
        let Self { gateway: Gateway { settings, address, .. }, name, servers, kinds, service, host } = self;
        each(host, Data::Address(*address))?;
        each(kinds, Data::Pointer(service))?;
        for (nth, (port_name, port)) in settings.modbus_servers(*address).take(*servers).enumerate() {
            // The first server has the gateway's name alone.
            let parts = if nth == 0 { [name, "", ""] } else { [name, " ", port_name] };
            let mut instance = String::<INSTANCE_BYTES_MAX>::new();
            // Sized for all three.
            parts.iter().for_each(|part| _ = instance.push_str(part));
            let [kind, protocol, domain] = SERVICE;
            let Some(instance) = dns_name(&[&instance, kind, protocol, domain]) else { continue };
            each(service, Data::Pointer(&instance))?;
            each(&instance, Data::Server(port, host))?;
            each(&instance, Data::About)?;
        }
        Ok(())
    }

    /// Writes all records as an unsolicited response.
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

    /// Appends the record to a section of a message.
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

/// A name of these labels; `None` if they are invalid.
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
