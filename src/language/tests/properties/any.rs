//! Any settings.

use std::boxed::Box;
use std::vec::Vec;

use proptest::prelude::*;

use super::super::std;
use super::any_port::*;
use crate::language::*;
use crate::scanner::{ByteOrder, Kind, ValueType};
use crate::settings::*;
use crate::settings::{
    AddressRange, Cut, Destination, Forbidden, Functions, Merge, Policy, Priority, Route, Sharing, Tag,
    UnitRange,
};

pub(super) fn any_route(ports: Vec<Port>) -> impl Strategy<Value = Route> {
    let count = ports.len() as u8;
    let destination = prop_oneof![
        4 => (0..count).prop_map(|id| Destination::Port(PortId(id))),
        1 => Just(Destination::Local),
        1 => Just(Destination::Discard),
        1 => Just(Destination::NoPath),
    ];
    let tag = (any::<u8>(), any::<u8>(), 0..3_u8, any::<u8>());
    let role = prop::option::of("[!$-+\\--~][!#-+\\--~]{0,30}");
    (0..count, tag, prop::option::of(any_prefix()), role, destination, any_policy()).prop_map(
        move |(source, (a, b, kind, value), peer, role, destination, policy)| {
            let units = UnitRange { first: a.min(b), last: a.max(b) };
            let tag = match kind {
                0 => Tag::Set(value),
                1 if value > units.first => Tag::Add(value - units.first),
                1 if value < units.first => Tag::Subtract(units.first - value),
                _ => Tag::Keep,
            };
            let is_good = (units.first..=units.last).all(|unit| tag.apply(unit).is_some());
            let tag = if is_good { tag } else { Tag::Keep };
            let has_roles = ports[source as usize].kind.has_roles();
            let role = role.filter(|_| has_roles).and_then(|role| ClientRole::new(&role));
            let role = role.unwrap_or(ClientRole::NONE);
            let has_peers = ports[source as usize].kind.has_peers();
            let source = PortId(source);
            let destination =
                if destination == Destination::Port(source) { Destination::Local } else { destination };
            Route { source, units, peer: peer.filter(|_| has_peers), role, tag, destination, policy }
        },
    )
}

fn any_policy() -> impl Strategy<Value = Policy> {
    let functions = prop_oneof![
        Just(Functions::ALL),
        Just(Functions::READ_ONLY),
        prop::collection::vec(1..=127_u8, 1..40)
            .prop_map(|codes| codes.into_iter().fold(Functions::NONE, Functions::with)),
        prop::collection::vec(1..=127_u8, 0..40).prop_map(|codes| {
            codes.into_iter().fold(Functions::NONE.with_identification(), Functions::with)
        }),
    ];
    let forbidden = prop_oneof![Just(Forbidden::Refuse), Just(Forbidden::Ignore)];
    let priority = prop_oneof![Just(Priority::High), Just(Priority::Normal), Just(Priority::Low)];
    let range = prop_oneof![
        Just(AddressRange::ALL),
        any::<(u16, u16)>().prop_map(|(a, b)| AddressRange { first: a.min(b), last: a.max(b) }),
    ];
    let urgent = prop::collection::vec(1..=127_u8, 0..5)
        .prop_map(|codes| codes.into_iter().fold(Functions::NONE, Functions::with));
    let cache = prop_oneof![Just(0), 0..=60_000_u16];
    let merge = prop_oneof![Just(Merge::Off), Just(Merge::Identical), any::<u8>().prop_map(Merge::Near)];
    let sharing = (merge, cache).prop_map(|(merge, cache_ms)| Sharing { merge, cache_ms });
    let cut = prop_oneof![Just(Cut::Auto), Just(Cut::On), Just(Cut::Off)];
    (functions, range.clone(), range, forbidden, priority, urgent, sharing, cut).prop_map(
        |(functions, addresses, writes, forbidden, priority, urgent, sharing, cut)| Policy {
            functions,
            addresses,
            writes,
            forbidden,
            priority,
            urgent,
            sharing,
            cut,
        },
    )
}

/// Servers of the ports that have several, whose units do not meet.
pub(super) fn any_servers(ports: &[Port]) -> impl Strategy<Value = Vec<ServerSettings>> + use<> {
    let has_several = |port: &Port| matches!(&port.kind, PortKind::TcpClient(client) if client.has_lines());
    let several: Vec<u8> =
        (0..ports.len() as u8).filter(|at| has_several(&ports[usize::from(*at)])).collect();
    let most = if several.is_empty() { 0 } else { 20 };
    prop::collection::vec((any::<prop::sample::Index>(), any_address(), 0..4_u8, 0..4_u8), 0..=most).prop_map(
        move |servers| {
            let server = |(nth, (port, at, length, shift)): (usize, (prop::sample::Index, _, u8, u8))| {
                let first = 10 * nth as u8 + 1;
                let units = UnitRange { first, last: first + length };
                let tag = match shift {
                    0 => Tag::Keep,
                    1 if length == 0 => Tag::Set(255),
                    by => Tag::Add(by),
                };
                ServerSettings { port: PortId(several[port.index(several.len())]), units, at, tag }
            };
            servers.into_iter().enumerate().map(server).collect()
        },
    )
}

pub(super) fn any_network() -> impl Strategy<Value = Option<OwnNetwork>> {
    let name = "([a-zA-Z0-9][-a-zA-Z0-9]{0,31})?";
    let dhcp = name.prop_map(|name| OwnNetwork::Dhcp { name: name.as_str().try_into().unwrap() });
    // Hosts 1 and 2 are in every network.
    let set = (any::<u16>(), 16..=30_u8, any::<bool>()).prop_map(|(net, prefix, gateway)| {
        let net = (0x0a00_0000 | u32::from(net) << 2) & !(u32::MAX >> prefix);
        let gateway = gateway.then_some((net | 2).into());
        let dns = (SERVERS && prefix % 2 == 0).then_some([9, 9, 9, 9].into());
        OwnNetwork::Static(StaticAddress { address: (net | 1).into(), prefix, gateway, dns })
    });
    prop::option::of(prop_oneof![Just(OwnNetwork::DEFAULT), dhcp, set])
}

pub(super) fn any_mdns() -> impl Strategy<Value = Mdns> {
    let name = "([a-zA-Z0-9][-a-zA-Z0-9]{0,31})?";
    let on = name.prop_map(|name| Mdns::On { name: name.as_str().try_into().unwrap() });
    prop_oneof![Just(Mdns::DEFAULT), Just(Mdns::Off), on]
}

/// What a line can say: a table is there with cells, and the value that substitutes when it does.
pub(super) fn any_slave() -> impl Strategy<Value = SlaveSettings> {
    let cells = prop::option::of((1..=65_535_u16).prop_flat_map(|count| {
        let last = (65_536 - u32::from(count)) as u16;
        (0..=last).prop_map(move |address| Cells { count, address })
    }));
    let cells = [cells.clone(), cells.clone(), cells.clone(), cells];
    let on_silence = prop_oneof![
        Just((OnSilence::Hold, 0)),
        Just((OnSilence::Clear, 0)),
        any::<u16>().prop_map(|value| (OnSilence::Substitute, value))
    ];
    let types = [any_value_type(), any_value_type()];
    (1..=247_u8, any::<bool>(), on_silence, 1..=3_600_000_u32, cells, types, any_order()).prop_map(
        |(unit, check, (on_silence, substitute), polling_ms, cells, types, order)| {
            let mut cells = cells.map(Option::unwrap_or_default);
            let mut slave =
                SlaveSettings { unit, check, on_silence, substitute, polling_ms, cells, types, order };
            // What has no cells has no type, and whole values only.
            for (place, (kind, cells)) in Kind::ALL.into_iter().zip(&mut cells).enumerate() {
                cells.count -= cells.count % slave.value_type(kind).registers();
                if cells.count == 0 {
                    *cells = Cells::default();
                    if let Some(nth) = place.checked_sub(2) {
                        slave.types[nth] = ValueType::U16;
                    }
                }
            }
            SlaveSettings { cells, ..slave }
        },
    )
}

fn any_users() -> impl Strategy<Value = Vec<User>> {
    let role = prop_oneof![Just(Role::Viewer), Just(Role::Operator), Just(Role::Engineer)];
    let hash = "\\$argon2id\\$v=19\\$m=(8|19456|262144),t=([1-9]|1[0-6]),p=[1-4]\\$[A-Za-z0-9+/]{22}\\$[A-Za-z0-9+/]{43}";
    let password = prop::option::of(hash.prop_map(|text| PasswordHash::try_from(text.as_str()).unwrap()));
    let key = "AAAAC3NzaC1lZDI1NTE5AAAAI[A-Za-z0-9+/]{43}";
    let keys = prop::collection::btree_set(key, 0..=USER_KEYS_MAX);
    prop::collection::vec((role, password, keys), 0..=USERS_MAX).prop_map(|users| {
        users
            .into_iter()
            .enumerate()
            .map(|(nth, (role, password, keys))| {
                let keys = keys.iter().map(|key| PublicKey::try_from(key.as_str()).unwrap()).collect();
                User { name: any_name(nth), role, password, keys }
            })
            .collect()
    })
}

/// Those that ports with TLS need.
fn any_certificates() -> impl Iterator<Item = Certificate> {
    let purposes = [Purpose::Own, Purpose::Clients, Purpose::Servers];
    let certificate = |(nth, purpose): (usize, Purpose)| {
        let file = |ending: &str| FileName::try_from(std::format!("/tls/{nth}.{ending}").as_str()).unwrap();
        let second = (nth != 1).then(|| file("2"));
        Certificate { name: any_name(nth), purpose, file: file("pem"), second }
    };
    purposes.into_iter().enumerate().filter(|_| TLS).map(certificate)
}

fn any_publishers() -> impl Strategy<Value = Vec<Publisher>> {
    let tls =
        (any::<bool>(), any::<bool>(), any::<bool>()).prop_map(|(on, certificate, trust)| TlsSettings {
            on: on && TLS,
            certificate: (on && TLS && certificate).then(|| any_name(0)),
            trust: (on && TLS && trust).then(|| any_name(2)),
        });
    let user = prop::option::of(("[!$-~][!-~]{0,62}", prop::option::of("[ !#-~é]{1,60}")));
    let version = prop_oneof![Just(crate::mqtt::Version::V3), Just(crate::mqtt::Version::V5)];
    let format = prop_oneof![Just(Format::Json), Just(Format::HomeAssistant), Just(Format::Sparkplug)];
    let topic = "[a-zA-Z0-9._-]{1,15}(/[a-zA-Z0-9._-]{1,15})?";
    let publisher = (any_address(), version, tls, user, topic, 1..=86_400_u64, format, any::<bool>());
    prop::collection::vec(publisher, 0..=PUBLISHERS_MAX).prop_map(|publishers| {
        let made = publishers.into_iter().enumerate();
        made.map(|(nth, (broker, version, tls, user, topic, every, format, commands))| {
            let (user, password) = user.unwrap_or_default();
            // A group is one level, and an edge node sends what changes.
            let (topic, every) = match format {
                Format::Sparkplug => (topic.replace('/', "-"), 60),
                Format::Json | Format::HomeAssistant => (topic, every),
            };
            Publisher {
                name: any_name(nth),
                broker,
                version,
                tls,
                user: user.replace([',', '"'], "_").as_str().try_into().unwrap(),
                password: password.unwrap_or_default().as_str().try_into().unwrap(),
                topic: topic.as_str().try_into().unwrap(),
                every: embassy_time::Duration::from_secs(every),
                format,
                commands,
            }
        })
        .collect()
    })
}

/// A name that no other has.
fn any_name(nth: usize) -> Name {
    Name::try_from(std::format!("user.{nth}").as_str()).unwrap()
}

pub(crate) fn any_settings() -> impl Strategy<Value = Box<Settings>> {
    (1..=PORTS_MAX)
        .prop_flat_map(|count| (0..count).map(any_port).collect::<Vec<_>>())
        .prop_flat_map(|ports| {
            let asks = |port: &Port| matches!(port.kind, PortKind::Ethercat(_));
            let most = if ports.iter().any(asks) { SLAVES_MAX } else { 0 };
            let slaves = prop::collection::vec(any_slave(), 0..=most);
            let routes = prop::collection::vec(any_route(ports.clone()), 0..=ROUTES_MAX);
            let servers = any_servers(&ports);
            (any_network(), any_mdns(), Just(ports), servers, routes, slaves, any_users(), any_publishers())
        })
        .prop_map(|(network, mdns, ports, servers, routes, slaves, users, publishers)| {
            let mut settings = Box::new(Settings { network, mdns, ..Settings::new() });
            for (slot, port) in settings.ports.iter_mut().zip(ports) {
                *slot = Some(port);
            }
            settings.servers.extend(servers);
            for route in routes {
                if !settings.routes.contains(&route) {
                    settings.routes.push(route).unwrap();
                }
            }
            settings.slaves.extend(slaves);
            settings.users.extend(users);
            settings.publishers.extend(publishers);
            settings.certificates.extend(any_certificates());
            settings
        })
}

pub(super) fn any_value_type() -> impl Strategy<Value = ValueType> {
    prop::sample::select(ValueType::NUMBERS.to_vec())
}

pub(super) fn any_order() -> impl Strategy<Value = ByteOrder> {
    prop::sample::select(ORDERS.iter().map(|(_, order)| *order).collect::<Vec<_>>())
}
