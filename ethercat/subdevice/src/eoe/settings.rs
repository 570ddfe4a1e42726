//! IP settings, as a MainDevice sets and reads them.

use core::net::Ipv4Addr;

use heapless::{String, Vec};

use super::error::EthernetError;
use crate::mailbox::{MailboxError, PAYLOAD_BYTES_MAX};

/// Most bytes of a name.
pub const NAME_BYTES_MAX: usize = 32;

/// Bytes of the flags that tell which fields there are.
const FLAGS_BYTES: usize = 4;
/// Bytes of each field, in the order of its flag: MAC, address, mask, gateway, DNS server, name.
const FIELDS: [usize; 6] = [6, 4, 4, 4, 4, NAME_BYTES_MAX];
/// Flags of all fields but the name, and their bytes.
const ADDRESSES: u8 = 0x1f;
const ADDRESSES_BYTES: usize = 22;
/// Flag of the name.
const NAME: u8 = 0x20;

/// Settings of a network interface; `None` is left as it is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IpSettings {
    /// Its MAC address.
    pub mac: Option<[u8; 6]>,
    /// Its IP address; 0.0.0.0 is none.
    pub address: Option<Ipv4Addr>,
    /// The network mask.
    pub mask: Option<Ipv4Addr>,
    /// The default gateway; 0.0.0.0 is none.
    pub gateway: Option<Ipv4Addr>,
    /// The DNS server; 0.0.0.0 is none.
    pub dns_server: Option<Ipv4Addr>,
    /// The host's name.
    pub name: Option<String<NAME_BYTES_MAX>>,
}

impl IpSettings {
    /// Parses the body of a request. The outer error is the message's, the inner one its response's.
    pub(super) fn decode(body: &[u8]) -> Result<Result<Self, EthernetError>, MailboxError> {
        let (&[flags, ..], body) =
            body.split_first_chunk::<FLAGS_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        let has = |field: usize| flags & 1 << field != 0;
        // SOEM 2 leaves out what is not set; TwinCAT and SOEM 1 send zeros in its place, so that the message is longer.
        let last = (0..FIELDS.len()).rev().find(|&field| has(field));
        let spaced: usize = FIELDS.iter().take(last.map_or(0, |last| last + 1)).sum();
        let has_gaps = body.len() >= spaced;
        let mut rest = body;
        let mut fields = [None::<&[u8]>; FIELDS.len()];
        for (nth, (field, bytes)) in fields.iter_mut().zip(FIELDS).enumerate() {
            if !has(nth) && !has_gaps {
                continue;
            }
            // A name may end early.
            let bytes = if bytes == NAME_BYTES_MAX { bytes.min(rest.len()) } else { bytes };
            match rest.split_at_checked(bytes) {
                Some((value, behind)) => {
                    *field = Some(value).filter(|_| has(nth));
                    rest = behind;
                }
                None if has(nth) => return Err(MailboxError::SizeTooShort),
                None => break,
            }
        }
        let [mac, address, mask, gateway, dns_server, name] = fields;
        let ip = |field: Option<&[u8]>| field.and_then(|field| field.try_into().ok()).map(from_wire);
        let name = match name.map(text).transpose() {
            Ok(name) => name,
            Err(error) => return Ok(Err(error)),
        };
        Ok(Ok(Self {
            mac: mac.and_then(|mac| mac.try_into().ok()),
            address: ip(address),
            mask: ip(mask),
            gateway: ip(gateway),
            dns_server: ip(dns_server),
            name,
        }))
    }

    /// Whether each address can be a device's: not a group's, and no mask with holes.
    pub(super) fn are_valid(&self) -> bool {
        let is_single = |ip: Ipv4Addr| !ip.is_multicast() && !ip.is_broadcast();
        let has_no_holes = |mask: Ipv4Addr| {
            let host = !mask.to_bits();
            host & host.wrapping_add(1) == 0
        };
        self.mac.is_none_or(|[first, ..]| first & 1 == 0)
            && self.address.is_none_or(is_single)
            && self.gateway.is_none_or(is_single)
            && self.mask.is_none_or(has_no_holes)
    }

    /// The body of a response of `room` bytes at most. All addresses are in it, so that it is the same with and without gaps, and
    /// the name if there is room for it. `None` if there is not even room for the addresses.
    pub(super) fn encode(&self, room: usize) -> Option<Vec<u8, PAYLOAD_BYTES_MAX>> {
        let named = self.name.as_deref().filter(|_| room >= FLAGS_BYTES + ADDRESSES_BYTES + NAME_BYTES_MAX);
        let flags = ADDRESSES | if named.is_some() { NAME } else { 0 };
        let mut body = Vec::new();
        body.extend_from_slice(&[flags, 0, 0, 0]).ok()?;
        body.extend_from_slice(&self.mac.unwrap_or_default()).ok()?;
        for ip in [self.address, self.mask, self.gateway, self.dns_server] {
            body.extend_from_slice(&to_wire(ip.unwrap_or(Ipv4Addr::UNSPECIFIED))).ok()?;
        }
        if let Some(name) = named {
            body.extend(name.bytes().chain(core::iter::repeat(0)).take(NAME_BYTES_MAX));
        }
        (body.len() <= room).then_some(body)
    }
}

/// An address is a number, its lowest byte first: the octets are in reverse, as SOEM and SOES have them.
fn from_wire(bytes: [u8; 4]) -> Ipv4Addr {
    Ipv4Addr::from(u32::from_le_bytes(bytes))
}

fn to_wire(ip: Ipv4Addr) -> [u8; 4] {
    u32::from(ip).to_le_bytes()
}

/// A name up to its first zero, if any.
fn text(bytes: &[u8]) -> Result<String<NAME_BYTES_MAX>, EthernetError> {
    let bytes = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
    let text = str::from_utf8(bytes).map_err(|_| EthernetError::Unspecified)?;
    String::try_from(text).map_err(|_| EthernetError::Unspecified)
}
