//! All settings of the gateway together.

use heapless::Vec;

use crate::scanner::DEVICES_MAX;
#[cfg(feature = "tls")] // As what uses it.
use crate::settings::Purpose;
use crate::settings::{
    Certificate, Certificates, Destination, DeviceSettings, Mdns, NtpServers, OwnNetwork, POINTS_MAX,
    PORTS_MAX, PointSettings, Port, PortId, PortKind, Publishers, ROUTES_MAX, Route, SERVERS_MAX, SLAVES_MAX,
    ServerAddress, ServerSettings, SlaveSettings, Syslog, Syslogs, TcpServerSettings, User, Users,
};
#[cfg(any(feature = "files", feature = "web"))] // Likewise.
use crate::settings::{MQTT, USERS};

/// Everything that `save` stores and `show config` prints.
#[derive(Debug, Eq, Default)]
pub struct Settings {
    /// How the board gets its own address, if the gateway manages that; `None`: the default.
    pub network: Option<OwnNetwork>,
    /// Announcement by multicast DNS.
    pub mdns: Mdns,
    /// Where the audit trail is sent.
    pub(crate) syslog: Syslogs,
    /// The NTP server.
    pub(crate) ntp: NtpServers,
    /// The certificates of ports with TLS.
    pub(crate) certificates: Certificates,
    /// The brokers that get the data points.
    pub(crate) publishers: Publishers,
    /// The ports; a port keeps its index when others are added or deleted.
    pub ports: [Option<Port>; PORTS_MAX],
    /// The servers of TCP clients that have several.
    pub servers: Vec<ServerSettings, SERVERS_MAX>,
    /// The routing rules, in matching order.
    pub routes: Vec<Route, ROUTES_MAX>,
    /// The devices polled by the scanner.
    pub devices: Vec<DeviceSettings, DEVICES_MAX>,
    /// The points, in devices and in the gateway's own unit.
    pub points: Vec<PointSettings, POINTS_MAX>,
    /// The devices behind the EtherCAT process image, in the order of their values.
    pub slaves: Vec<SlaveSettings, SLAVES_MAX>,
    pub(crate) users: Users,
}

impl Settings {
    /// Settings without ports and rules.
    pub const fn new() -> Self {
        Self {
            network: None,
            mdns: Mdns::DEFAULT,
            syslog: Vec::new(),
            ntp: Vec::new(),
            certificates: Vec::new(),
            publishers: Vec::new(),
            ports: [const { None }; PORTS_MAX],
            servers: Vec::new(),
            routes: Vec::new(),
            devices: Vec::new(),
            points: Vec::new(),
            slaves: Vec::new(),
            users: Vec::new(),
        }
    }

    /// Resets everything.
    pub fn clear(&mut self) {
        self.network = None;
        self.mdns = Mdns::DEFAULT;
        self.syslog.clear();
        self.ntp.clear();
        self.certificates.clear();
        self.publishers.clear();
        self.ports.iter_mut().for_each(|port| *port = None);
        self.servers.clear();
        self.routes.clear();
        self.devices.clear();
        self.points.clear();
        self.slaves.clear();
        self.users.clear();
    }

    /// How the board gets its own address.
    pub fn own_network(&self) -> OwnNetwork {
        self.network.clone().unwrap_or_default()
    }

    /// Where the audit trail is sent, if anywhere.
    pub fn syslog(&self) -> Option<&Syslog> {
        self.syslog.first()
    }

    /// The NTP server, if any.
    pub fn ntp(&self) -> Option<&ServerAddress> {
        self.ntp.first()
    }

    /// The certificates of ports with TLS.
    pub fn certificates(&self) -> &[Certificate] {
        &self.certificates
    }

    /// The certificates for this purpose: those that `name` means, or all of them.
    #[cfg(feature = "tls")] // There are no others.
    pub fn certificates_for<'s>(
        &'s self,
        purpose: Purpose,
        name: Option<&'s str>,
    ) -> impl Iterator<Item = &'s Certificate> {
        let of_purpose = self.certificates.iter().filter(move |one| one.purpose == purpose);
        of_purpose.filter(move |one| name.is_none_or(|name| one.name.eq_ignore_ascii_case(name)))
    }

    /// The port at `id`.
    pub fn port(&self, id: PortId) -> Option<&Port> {
        self.ports.get(id.index())?.as_ref()
    }

    /// The port called `name`; a bare TCP port number also finds the port called `P` and that number, because the source paper
    /// prints `502` for P502.
    pub fn find(&self, name: &str) -> Option<PortId> {
        let named = |wanted: &dyn Fn(&str) -> bool| {
            self.ports.iter().position(|port| port.as_ref().is_some_and(|port| wanted(&port.name)))
        };
        let found = named(&|other| other.eq_ignore_ascii_case(name)).or_else(|| {
            let digits = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
            if !digits {
                return None;
            }
            named(&|other| other.strip_prefix(['P', 'p']) == Some(name))
        })?;
        Some(PortId(found as u8))
    }

    /// Whether the port at `id` must restart for the settings `new`. Names and special units are looked up for each request.
    pub(crate) fn restarts(&self, new: &Self, id: PortId) -> bool {
        let [kind, new_kind] = [self, new].map(|settings| settings.port(id).map(|port| &port.kind));
        let [servers, new_servers] =
            [self, new].map(|settings| settings.servers_of(id).map(|(_, line)| line));
        kind != new_kind || !servers.eq(new_servers)
    }

    /// The TCP server at `id`, if the port is one.
    pub(crate) fn tcp_server(&self, id: PortId) -> Option<&TcpServerSettings> {
        match &self.port(id)?.kind {
            PortKind::TcpServer(settings) => Some(settings),
            _ => None,
        }
    }

    /// The name of the port at `id`; `?` if there is none any more.
    pub fn name(&self, id: PortId) -> &str {
        self.port(id).map_or("?", |port| &port.name)
    }

    /// The user called `name`.
    pub(crate) fn user(&self, name: &str) -> Option<&User> {
        self.users.iter().find(|user| user.name == name)
    }

    /// The user called `name`, mutable.
    pub(crate) fn user_mut(&mut self, name: &str) -> Option<&mut User> {
        self.users.iter_mut().find(|user| user.name == name)
    }

    /// Gives users without a password the one that they have in `before`, and publishers that keep their user theirs: passwords are
    /// never shown, so a text that comes back has none.
    #[cfg(any(feature = "files", feature = "web"))] // As what asks for it.
    pub(crate) fn keep_passwords(&mut self, before: &Self) {
        for user in self.users.iter_mut().filter(|user| USERS && user.password.is_none()) {
            user.password = before.user(&user.name).and_then(|user| user.password.clone());
        }
        if MQTT {
            for publisher in self.publishers.iter_mut().filter(|publisher| publisher.password.is_empty()) {
                let mut all = before.publishers.iter();
                let same = all.find(|old| old.name == publisher.name && old.user == publisher.user);
                same.iter().for_each(|old| publisher.password.clone_from(&old.password));
            }
        }
    }

    /// Whether there is a user with a password.
    // Used only with the feature `users`.
    #[cfg_attr(not(feature = "users"), allow(dead_code))]
    pub(crate) fn can_log_in(&self) -> bool {
        self.users.iter().any(|user| user.password.is_some())
    }

    /// A destination as named in rules.
    pub fn destination(&self, destination: Destination) -> &str {
        match destination {
            Destination::Port(id) => self.name(id),
            Destination::Local => "local",
            Destination::Discard => "discard",
            Destination::NoPath => "nopath",
        }
    }
}

impl Clone for Settings {
    fn clone(&self) -> Self {
        let mut clone = Self::new();
        clone.clone_from(self);
        clone
    }

    /// Copies field by field: the whole is too large for the stack of a small board.
    fn clone_from(&mut self, source: &Self) {
        let Self {
            network,
            mdns,
            syslog,
            ntp,
            certificates,
            publishers,
            ports,
            servers,
            routes,
            devices,
            points,
            slaves,
            users,
        } = source;
        self.network.clone_from(network);
        self.mdns.clone_from(mdns);
        self.ports.clone_from_slice(ports);
        copy_list(&mut self.syslog, syslog);
        copy_list(&mut self.ntp, ntp);
        copy_list(&mut self.certificates, certificates);
        copy_list(&mut self.publishers, publishers);
        copy_list(&mut self.servers, servers);
        copy_list(&mut self.routes, routes);
        copy_list(&mut self.devices, devices);
        copy_list(&mut self.points, points);
        copy_list(&mut self.slaves, slaves);
        copy_list(&mut self.users, users);
    }
}

impl PartialEq for Settings {
    fn eq(&self, other: &Self) -> bool {
        // All of them are named, so that a new one cannot be forgotten.
        let Self {
            network,
            mdns,
            syslog,
            ntp,
            certificates,
            publishers,
            ports,
            servers,
            routes,
            devices,
            points,
            slaves,
            users,
        } = self;
        *network == other.network
            && *mdns == other.mdns
            && *ports == other.ports
            && same_list(syslog, &other.syslog)
            && same_list(ntp, &other.ntp)
            && same_list(certificates, &other.certificates)
            && same_list(publishers, &other.publishers)
            && same_list(servers, &other.servers)
            && same_list(routes, &other.routes)
            && same_list(devices, &other.devices)
            && same_list(points, &other.points)
            && same_list(slaves, &other.slaves)
            && same_list(users, &other.users)
    }
}

/// Copies a list. Code for a list that holds nothing is left out, which the compiler does not see by its length.
fn copy_list<T: Clone, const N: usize>(list: &mut Vec<T, N>, source: &Vec<T, N>) {
    if N > 0 {
        list.clear();
        // The same capacity.
        let _ = list.extend_from_slice(source);
    }
}

/// Whether two lists are the same; as above.
fn same_list<T: PartialEq, const N: usize>(list: &Vec<T, N>, other: &Vec<T, N>) -> bool {
    N == 0 || list == other
}
