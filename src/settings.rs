//! The settings as plain values: ports, rules, points, slaves, the network; with limits and defaults.

mod address;
mod ethercat;
mod field;
mod functions;
// As its port.
#[cfg(feature = "web")]
mod http;
mod lane;
mod limits;
mod lookup;
mod mdns;
mod network;
mod own_network;
mod points;
mod policy;
mod port;
mod port_fields;
mod port_limits;
mod proof;
mod publisher;
mod rule;
mod rules;
mod serial;
mod servers;
mod side;
mod slaves;
mod special_units;
mod syslog;
mod time;
mod tls;
mod users;
mod whole;

pub(crate) use self::address::{Address, Endpoint, IPV6, canonical};
pub use self::address::{Allowed, IpPrefix, Prefixes};
#[cfg(any(feature = "files", test))] // As the word; tests make settings of any kind.
pub(crate) use self::ethercat::FileRights;
pub(crate) use self::ethercat::INTERFACE_BYTES_MAX;
pub use self::ethercat::{EthercatSettings, InterfaceName, OnLoss};
pub(crate) use self::field::{Count, Field};
pub use self::functions::Functions;
// As its port.
#[cfg(feature = "web")]
pub use self::http::HttpSettings;
pub use self::lane::Lane;
pub(crate) use self::limits::{DEVICE_BYTES_MAX, PATHS, RESERVED_MAX};
pub use self::limits::{LINE_BYTES_MAX, NAME_BYTES_MAX, Name, PORTS_MAX, PortId, ROUTES_MAX};
// As the devices that connect; also below.
#[cfg(feature = "dial-in")]
pub(crate) use self::lookup::Whose;
pub use self::mdns::Mdns;
pub(crate) use self::network::{DIAL_IN_WAITING_MAX, MODBUS_TCP_PORT, UDP_REQUESTS_MAX};
#[cfg(feature = "dial-in")]
pub(crate) use self::network::{DialIn, FIRST_BYTES_MAX, FirstBytes};
pub use self::network::{StreamFraming, TcpClientSettings, TcpListen, TcpServerSettings, UdpServerSettings};
pub use self::own_network::{HOST_NAME_BYTES_MAX, HostName, OwnNetwork, StaticAddress};
pub use self::points::{DeviceSettings, Label, PointAt, PointName, PointSettings};
pub(crate) use self::points::{LABEL_BYTES_MAX, POINTS_MAX};
pub use self::policy::{AddressRange, Cut, Forbidden, Merge, Policy, Priority, Sharing};
pub(crate) use self::port::Key;
pub use self::port::{Port, PortKind};
// Only the web interface tells limits.
#[cfg(feature = "web")]
pub(crate) use self::port_limits::BAUD;
pub(crate) use self::proof::PROOFS_MAX;
pub use self::proof::{Proof, Proofs};
pub(crate) use self::publisher::{MQTT, PUBLISHERS_MAX, Publishers};
// As what uses it.
#[cfg(feature = "mqtt")]
pub(crate) use self::publisher::TopicPrefix;
#[cfg(all(feature = "mqtt", feature = "tls"))]
pub(crate) use self::publisher::publisher_id;
#[cfg(any(feature = "mqtt", test))] // Tests make settings of any kind.
pub(crate) use self::publisher::{Format, Publisher};
pub use self::rule::{Destination, Route, Tag, UnitRange};
pub use self::rules::Rules;
pub use self::serial::{
    Driver, Framing, LineSettings, Parity, SerialClientSettings, SerialServerSettings, SerialSettings,
};
pub use self::servers::{Host, SOCKETS_MAX, ServerAddress, ServerName, ServerSettings};
pub(crate) use self::servers::{PORT_SERVERS_MAX, SERVERS, SERVERS_MAX};
pub use self::side::Side;
pub use self::slaves::{Cells, OnSilence, SlaveSettings};
pub(crate) use self::slaves::{POLLING_MS, SLAVES_MAX};
pub use self::special_units::{Special, UnitPolicy};
pub(crate) use self::syslog::{AUDIT, NtpServers, Syslogs};
pub use self::syslog::{Syslog, Transport};
pub use self::time::Time;
pub(crate) use self::tls::{CERTIFICATES_MAX, Certificates, TLS};
pub use self::tls::{Certificate, ClientRole, FileName, Purpose, TlsSettings};
pub use self::users::PasswordHash;
pub(crate) use self::users::{
    PUBLIC_KEY_BYTES, PublicKey, Role, SSH, USER_KEYS_MAX, USERS, USERS_MAX, User, Users,
};
pub use self::whole::Settings;
