//! Look-ups in the settings: of a port, a server, a point, or the board.

#[cfg(feature = "dial-in")]
use core::net::IpAddr;
use core::net::Ipv4Addr;

use crate::settings::{
    EthercatSettings, Framing, LineSettings, Mdns, OwnNetwork, PortId, PortKind, SERVERS, SerialSettings,
    ServerAddress, ServerSettings, Settings, Side, StreamFraming, canonical,
};
// As what uses it.
#[cfg(feature = "dial-in")]
use crate::settings::{DialIn, TcpListen};
#[cfg(feature = "tls")]
use crate::settings::{PORTS_MAX, TlsSettings};

/// Whose a device is that has connected.
#[cfg(feature = "dial-in")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Whose {
    /// That of this client port.
    Port(PortId),
    /// It may be told after so many further bytes, at least.
    After(usize),
    /// That of no port.
    Nobody,
}

impl Settings {
    /// The settings of the EtherCAT port, if there is one.
    pub fn ethercat(&self) -> Option<&EthercatSettings> {
        self.ports.iter().flatten().find_map(|port| match &port.kind {
            PortKind::Ethercat(settings) => Some(settings),
            _ => None,
        })
    }

    /// The line whose speed and format the MainDevice sets, if it exists.
    pub(crate) fn ethercat_line(&self) -> Option<PortId> {
        let id = self.find(self.ethercat()?.line.as_ref()?)?;
        let is_rtu_client = matches!(
            self.port(id)?.kind,
            PortKind::Serial(SerialSettings { framing: Framing::Rtu, side: Side::Client, .. })
        );
        is_rtu_client.then_some(id)
    }

    /// The settings of that line.
    pub(crate) fn ethercat_speed(&self) -> Option<&LineSettings> {
        match &self.port(self.ethercat_line()?)?.kind {
            PortKind::Serial(serial) => Some(&serial.line),
            _ => None,
        }
    }

    /// The server lines of the port at `id`, each with its index among all server lines.
    pub(crate) fn servers_of(&self, id: PortId) -> impl Iterator<Item = (usize, &ServerSettings)> + Clone {
        // The compiler drops the code if there are no server lines.
        let all: &[ServerSettings] = if SERVERS { &self.servers } else { &[] };
        all.iter().enumerate().filter(move |(_, server)| server.port == id)
    }

    /// The address of server `number` (from 0) of the TCP client at `id`.
    pub(crate) fn address(&self, id: PortId, number: usize) -> Option<&ServerAddress> {
        let PortKind::TcpClient(client) = &self.port(id)?.kind else { return None };
        client.server.as_ref().or_else(|| Some(&self.servers_of(id).nth(number)?.1.at))
    }

    /// The server of `unit` at the TCP client `id`, and the server's own id for it.
    pub(crate) fn server(&self, id: PortId, unit: u8) -> Option<(&ServerAddress, u8)> {
        let PortKind::TcpClient(client) = &self.port(id)?.kind else { return None };
        if let Some(server) = &client.server {
            return Some((server, client.unit.unwrap_or(unit)));
        }
        let (_, server) = self.servers_of(id).find(|(_, server)| server.units.contains(unit))?;
        Some((&server.at, server.tag.apply(unit)?))
    }

    /// The client ports whose devices connect to `listen`.
    // As these; also below.
    #[cfg(feature = "dial-in")]
    pub(crate) fn dial_ins(&self, listen: &TcpListen) -> impl Iterator<Item = (PortId, &DialIn)> {
        self.ports.iter().enumerate().filter_map(move |(at, port)| match &port.as_ref()?.kind {
            PortKind::TcpClient(client) => {
                let dial_in = client.dial_in.as_ref().filter(|dial_in| dial_in.listen == *listen)?;
                Some((PortId(at as u8), dial_in))
            }
            _ => None,
        })
    }

    /// Whose a device from `peer` is that has connected to `listen`, and has sent `begin` so far.
    #[cfg(feature = "dial-in")]
    pub(crate) fn whose(&self, listen: &TcpListen, peer: IpAddr, begin: &[u8]) -> Whose {
        let mut whose = Whose::Nobody;
        for (id, DialIn { allowed, first, .. }) in self.dial_ins(listen) {
            if !allowed.admits(peer) {
                continue;
            }
            if begin.starts_with(first) {
                return Whose::Port(id);
            }
            if first.starts_with(begin) {
                let missing = first.len() - begin.len();
                whose = match whose {
                    Whose::After(other) => Whose::After(other.min(missing)),
                    _ => Whose::After(missing),
                };
            }
        }
        whose
    }

    /// The TLS settings of the port or publisher at `id`, if it speaks TLS; publishers have ids behind those of ports.
    // Left out of images without TLS.
    #[cfg(feature = "tls")]
    pub fn tls(&self, id: PortId) -> Option<&TlsSettings> {
        match id.index().checked_sub(PORTS_MAX) {
            Some(nth) => self.publishers.get(nth).map(|publisher| &publisher.tls).filter(|tls| tls.on),
            None => self.port(id)?.kind.tls(),
        }
    }

    /// The mDNS name of the gateway: `own` unless the settings have one; `None` if mDNS is off.
    pub fn mdns_name<'s>(&'s self, own: &'s str) -> Option<&'s str> {
        let Mdns::On { name } = &self.mdns else { return None };
        let told = match &self.network {
            Some(OwnNetwork::Dhcp { name }) => name.as_str(),
            _ => "",
        };
        [name, told, own].into_iter().find(|name| !name.is_empty())
    }

    /// The TCP ports and names of the Modbus TCP servers reachable at `own`.
    pub fn modbus_servers(&self, own: Ipv4Addr) -> impl Iterator<Item = (&str, u16)> {
        self.ports.iter().flatten().filter_map(move |port| match &port.kind {
            PortKind::TcpServer(server) if server.framing == StreamFraming::Mbap => {
                let at = server.listen.address.unwrap_or(own.into());
                (at.is_unspecified() || canonical(at) == own)
                    .then_some((port.name.as_str(), server.listen.port))
            }
            _ => None,
        })
    }

    /// Index of the point `name`.
    pub fn find_point(&self, name: &str) -> Option<u8> {
        let index = self.points.iter().position(|point| point.name.eq_ignore_ascii_case(name))?;
        u8::try_from(index).ok()
    }

    /// Index of the device `name`.
    pub fn find_device(&self, name: &str) -> Option<u8> {
        let index = self.devices.iter().position(|device| device.name.eq_ignore_ascii_case(name))?;
        u8::try_from(index).ok()
    }

    /// Name of device `index`; `?` if there is none.
    pub fn device_name(&self, index: u8) -> &str {
        self.devices.get(usize::from(index)).map_or("?", |device| &device.name)
    }
}
