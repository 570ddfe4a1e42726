//! What holds for all settings and all lines: printing recreates, and nothing panics.

use core::net::IpAddr;
use std::format;
use std::string::String;
use std::vec::Vec;

use embassy_time::Duration;
use proptest::prelude::*;

use super::{PORTS, load, print, std};
use crate::language::*;
use crate::scanner::{ByteOrder, Kind, POINTS, ValueType};
use crate::settings::*;
use crate::settings::{
    AddressRange, Cut, Destination, Forbidden, Functions, Merge, Policy, Priority, Route, Sharing, Tag,
    UnitRange,
};

fn duration(us: core::ops::RangeInclusive<u64>) -> impl Strategy<Value = Duration> {
    let (low, high) = (*us.start(), *us.end());
    let any = us.prop_map(Duration::from_micros);
    let round = (low.div_ceil(1_000)..=high / 1_000).prop_map(Duration::from_millis);
    prop_oneof![any, round]
}

fn any_prefix() -> impl Strategy<Value = IpPrefix> {
    let v4 = (any::<u32>(), 0..=32_u8).prop_map(|(bits, length)| {
        let mask = u32::MAX.checked_shl(32 - u32::from(length)).unwrap_or(0);
        IpPrefix { address: IpAddr::V4((bits & mask).into()), length }
    });
    let v6 = (any::<u128>(), 0..=128_u8).prop_map(|(bits, length)| {
        let mask = u128::MAX.checked_shl(128 - u32::from(length)).unwrap_or(0);
        IpPrefix { address: IpAddr::V6((bits & mask).into()), length }
    });
    prop_oneof![v4, v6]
}

fn any_line(framing: Framing) -> impl Strategy<Value = LineSettings> {
    let data_bits = if framing == Framing::Rtu { 8..=8_u8 } else { 7..=8_u8 };
    let parity = prop_oneof![Just(Parity::None), Just(Parity::Even), Just(Parity::Odd)];
    let gap = prop::option::of(duration(0..=1_000_000));
    let char_timeout = prop::option::of(duration(100..=60_000_000));
    let line =
        (1..=10_000_000_u32, data_bits, parity, 1..=2_u8, gap, char_timeout, any_driver(), any::<bool>());
    line.prop_map(|(baud, data_bits, parity, stop_bits, gap, char_timeout, driver, echo)| {
        let (driver, driver_before, driver_after) = driver;
        LineSettings {
            baud,
            data_bits,
            parity,
            stop_bits,
            gap,
            char_timeout,
            driver,
            driver_before,
            driver_after,
            echo,
        }
    })
}

fn any_driver() -> impl Strategy<Value = (Driver, Duration, Duration)> {
    let none = Duration::from_ticks(0);
    let switched = (any::<bool>(), duration(0..=1_000_000), duration(0..=1_000_000))
        .prop_map(|(rts, before, after)| (if rts { Driver::Rts } else { Driver::Rs485 }, before, after));
    prop_oneof![Just((Driver::Automatic, none, none)), switched]
}

fn any_server() -> impl Strategy<Value = SerialServerSettings> {
    (duration(10_000..=3_600_000_000), duration(0..=10_000_000))
        .prop_map(|(answer_within, reply_delay)| SerialServerSettings { answer_within, reply_delay })
}

fn any_proofs() -> impl Strategy<Value = Proofs> {
    let kinds = prop::sample::select(Kind::ALL.to_vec());
    let read = (kinds, any::<u16>(), 1..=125_u16);
    let proof = || {
        let read = read.clone().prop_map(|(kind, address, count)| Proof::Read { kind, address, count });
        prop_oneof![Just(Proof::Auto), Just(Proof::Diagnostic), read, Just(Proof::None)]
    };
    let units = (any::<u8>(), any::<u8>()).prop_map(|(a, b)| UnitRange { first: a.min(b), last: a.max(b) });
    (proof(), prop::collection::vec((units, proof()), 0..=PROOFS_MAX)).prop_map(|(all, some)| {
        let mut of_units = [None; PROOFS_MAX];
        of_units.iter_mut().zip(some).for_each(|(place, proof)| *place = Some(proof));
        Proofs { all, of_units }
    })
}

fn any_client() -> impl Strategy<Value = SerialClientSettings> {
    let hour = 3_600_000_000;
    let late_window = prop::option::of(duration(0..=hour));
    (
        duration(1_000..=hour),
        0..=10_u8,
        duration(0..=60_000_000),
        duration(0..=hour),
        late_window,
        (any::<u8>(), any_proofs()),
    )
        .prop_map(|(timeout, retries, turnaround, start_delay, late_window, (down_after, proofs))| {
            SerialClientSettings {
                timeout,
                retries,
                turnaround,
                start_delay,
                late_window,
                down_after,
                proofs,
            }
        })
}

fn any_serial(n: usize) -> impl Strategy<Value = PortKind> {
    (prop_oneof![Just(Framing::Rtu), Just(Framing::Ascii)], any::<bool>())
        .prop_flat_map(|(framing, is_server)| {
            (Just(framing), Just(is_server), any_line(framing), any_client(), any_server())
        })
        .prop_map(move |(framing, is_server, line, client, server)| {
            let device = heapless::String::try_from(format!("/dev/tty#{n}").as_str()).unwrap();
            let (side, client, server) = match is_server {
                true => (Side::Server, SerialClientSettings::DEFAULT, server),
                false => (Side::Client, client, SerialServerSettings::DEFAULT),
            };
            PortKind::Serial(SerialSettings { device, framing, side, line, client, server })
        })
}

fn any_tcp_server(n: usize) -> impl Strategy<Value = PortKind> {
    let address = prop::option::of(prop_oneof![
        any::<u32>().prop_map(|bits| IpAddr::V4(bits.into())),
        any::<u128>().prop_map(|bits| IpAddr::V6(bits.into())),
    ]);
    let idle = prop_oneof![Just(Duration::from_ticks(0)), duration(1_000_000..=86_400_000_000)];
    let reserved_for = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    (
        (address, prop_oneof![any_stream(), Just(StreamFraming::Capture)]),
        (1..=1_000_u16, any::<bool>()),
        idle,
        1..=16_u8,
        duration(10_000..=3_600_000_000),
        1..=1_000_u16,
        (reserved_for, allowed),
    )
        .prop_map(
            move |(
                (address, framing),
                (clients, refuses),
                idle,
                pipeline,
                lifetime,
                reserved,
                (reserved_for, allowed),
            )| {
                let allowed = Allowed(allowed.into_iter().collect());
                let reserved = if reserved_for.is_empty() { 0 } else { reserved.min(clients) };
                let reserved_for = reserved_for.into_iter().collect();
                let listen = TcpListen { address, port: 502 + n as u16 };
                let pipeline = if framing == StreamFraming::Mbap { pipeline } else { 16 };
                let (idle, lifetime) = match framing {
                    StreamFraming::Capture => (Duration::from_secs(60), Duration::from_secs(5)),
                    StreamFraming::Mbap | StreamFraming::Rtu => (idle, lifetime),
                };
                PortKind::TcpServer(TcpServerSettings {
                    listen,
                    framing,
                    clients,
                    idle,
                    pipeline,
                    lifetime,
                    reserved,
                    refuses,
                    reserved_for,
                    allowed,
                })
            },
        )
}

fn any_address() -> impl Strategy<Value = ServerAddress> {
    let host = prop_oneof![
        4 => (1..=u32::MAX).prop_map(|bits| Host::Address(IpAddr::V4(bits.into()))),
        4 => (1..=u128::MAX).prop_map(|bits| Host::Address(IpAddr::V6(bits.into()))),
        u32::from(SERVERS) => "([a-z0-9]([a-z0-9_-]{0,9}[a-z0-9])?[.]){0,3}meter[a-z0-9]{0,5}"
            .prop_map(|name| Host::Name(name.as_str().try_into().unwrap())),
    ];
    (host, 1..=u16::MAX).prop_map(|(host, port)| ServerAddress { host, port })
}

/// With an address of its own, or for several servers.
fn any_tcp_client() -> impl Strategy<Value = PortKind> {
    let zero = Just(Duration::from_ticks(0));
    let address = prop_oneof![
        3 => any_address().prop_map(|address| (Some(address), TcpClientSettings::new(None).sockets)),
        u32::from(SERVERS) => (1..=SOCKETS_MAX as u8).prop_map(|sockets| (None, sockets)),
    ];
    let hour = 3_600_000_000;
    let place = (address, any_stream(), prop::option::of(any::<u8>()), 1..=16_u8);
    let delays = (duration(0..=60_000_000), duration(0..=60_000_000));
    let idle = prop_oneof![zero, duration(1_000_000..=86_400_000_000)];
    let late_window = prop::option::of(duration(0..=hour));
    let health = (late_window, any::<u8>(), any_proofs());
    (place, duration(1_000..=hour), duration(1_000..=hour), delays, idle, 0..=10_u8, health).prop_map(
        |(place, timeout, connect_timeout, delays, idle, retries, health)| {
            let ((server, sockets), framing, unit, in_flight) = place;
            let (late_window, down_after, proofs) = health;
            let (connect_delay, request_delay) = delays;
            PortKind::TcpClient(TcpClientSettings {
                unit: unit.filter(|_| server.is_some()),
                server,
                sockets,
                framing,
                in_flight: if framing == StreamFraming::Rtu { 1 } else { in_flight },
                timeout,
                connect_timeout,
                connect_delay,
                request_delay,
                idle,
                retries,
                late_window,
                down_after,
                proofs: if framing == StreamFraming::Rtu { proofs } else { Proofs::default() },
            })
        },
    )
}

fn any_units() -> impl Strategy<Value = UnitPolicy> {
    let meaning = prop_oneof![
        Just(Special::Rules),
        Just(Special::Off),
        Just(Special::Local),
        (1..=247_u8).prop_map(Special::Replace),
    ];
    let broadcast = prop_oneof![meaning.clone(), Just(Special::AllLines)];
    (broadcast, any::<bool>(), meaning.clone(), meaning).prop_map(
        |(broadcast, confirm, unit_255, reserved)| UnitPolicy { broadcast, confirm, unit_255, reserved },
    )
}

fn any_udp_server(n: usize) -> impl Strategy<Value = PortKind> {
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    (1..=16_u8, 1..=32_u8, duration(10_000..=3_600_000_000), allowed).prop_map(
        move |(pipeline, requests, lifetime, allowed)| {
            let listen = TcpListen { address: None, port: 502 + n as u16 };
            let allowed = Allowed(allowed.into_iter().collect());
            PortKind::UdpServer(UdpServerSettings { listen, pipeline, requests, lifetime, allowed })
        },
    )
}

fn any_stream() -> impl Strategy<Value = StreamFraming> {
    prop_oneof![Just(StreamFraming::Mbap), Just(StreamFraming::Rtu)]
}

/// There can be one.
fn any_ethercat() -> impl Strategy<Value = PortKind> {
    let on_loss = prop_oneof![Just(OnLoss::Hold), Just(OnLoss::Clear), Just(OnLoss::Stop)];
    let line = prop::option::of("[A-Za-z][A-Za-z0-9.-]{0,9}_1");
    let interface = prop::option::of("[A-Za-z0-9_.:@-]{1,15}");
    let id = prop::option::of(1..=u16::MAX);
    (interface, on_loss, line, any::<bool>(), id, any::<bool>(), any::<bool>()).prop_map(
        |(interface, on_loss, line, prove_outputs, id, emergencies, modules)| {
            let interface = interface.map(|name| name.as_str().try_into().unwrap());
            let line = line.map(|name| Name::try_from(name.as_str()).unwrap());
            PortKind::Ethercat(EthercatSettings {
                interface,
                on_loss,
                line,
                prove_outputs,
                id,
                emergencies,
                modules,
            })
        },
    )
}

fn any_port(n: usize) -> impl Strategy<Value = Port> {
    let kind = prop_oneof![
        any_serial(n).boxed(),
        any_tcp_server(n).boxed(),
        any_tcp_client().boxed(),
        any_udp_server(n).boxed(),
        if n == 0 && POINTS { any_ethercat().boxed() } else { any_udp_server(n).boxed() }
    ];
    ("[A-Za-z][A-Za-z0-9.-]{0,11}", kind, any_units()).prop_map(move |(name, kind, units)| {
        // The number keeps names apart, also from the reserved ones.
        let captures =
            matches!(&kind, PortKind::TcpServer(server) if server.framing == StreamFraming::Capture);
        let asked = kind.side() == Side::Server && !captures;
        let units = if asked { units } else { UnitPolicy::default() };
        Port { name: Name::try_from(format!("{name}_{n}").as_str()).unwrap(), kind, units }
    })
}

fn any_route(ports: Vec<Port>) -> impl Strategy<Value = Route> {
    let count = ports.len() as u8;
    let destination = prop_oneof![
        4 => (0..count).prop_map(|id| Destination::Port(PortId(id))),
        1 => Just(Destination::Local),
        1 => Just(Destination::Discard),
        1 => Just(Destination::NoPath),
    ];
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
    let tag = (any::<u8>(), any::<u8>(), 0..3_u8, any::<u8>());
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
    let policy = (functions, range.clone(), range, forbidden, priority, urgent, sharing, cut).prop_map(
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
    );
    (0..count, tag, prop::option::of(any_prefix()), destination, policy).prop_map(
        move |(source, (a, b, kind, value), peer, destination, policy)| {
            let units = UnitRange { first: a.min(b), last: a.max(b) };
            let tag = match kind {
                0 => Tag::Set(value),
                1 if value > units.first => Tag::Add(value - units.first),
                1 if value < units.first => Tag::Subtract(units.first - value),
                _ => Tag::Keep,
            };
            let is_good = (units.first..=units.last).all(|unit| tag.apply(unit).is_some());
            let tag = if is_good { tag } else { Tag::Keep };
            let has_peers = ports[source as usize].kind.has_peers();
            let source = PortId(source);
            let destination =
                if destination == Destination::Port(source) { Destination::Local } else { destination };
            Route { source, units, peer: peer.filter(|_| has_peers), tag, destination, policy }
        },
    )
}

/// Servers of the ports that have several, whose units do not meet.
fn any_servers(ports: &[Port]) -> impl Strategy<Value = Vec<ServerSettings>> + use<> {
    let has_several =
        |port: &Port| matches!(&port.kind, PortKind::TcpClient(client) if client.server.is_none());
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

fn any_network() -> impl Strategy<Value = Option<OwnNetwork>> {
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

fn any_mdns() -> impl Strategy<Value = Mdns> {
    let name = "([a-zA-Z0-9][-a-zA-Z0-9]{0,31})?";
    let on = name.prop_map(|name| Mdns::On { name: name.as_str().try_into().unwrap() });
    prop_oneof![Just(Mdns::DEFAULT), Just(Mdns::Off), on]
}

/// What a line can say: a table is there with cells, and the value that substitutes when it does.
fn any_slave() -> impl Strategy<Value = SlaveSettings> {
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

fn any_settings() -> impl Strategy<Value = Settings> {
    (1..=PORTS_MAX)
        .prop_flat_map(|count| (0..count).map(any_port).collect::<Vec<_>>())
        .prop_flat_map(|ports| {
            let asks = |port: &Port| matches!(port.kind, PortKind::Ethercat(_));
            let most = if ports.iter().any(asks) { SLAVES_MAX } else { 0 };
            let slaves = prop::collection::vec(any_slave(), 0..=most);
            let routes = prop::collection::vec(any_route(ports.clone()), 0..=ROUTES_MAX);
            let servers = any_servers(&ports);
            (any_network(), any_mdns(), Just(ports), servers, routes, slaves)
        })
        .prop_map(|(network, mdns, ports, servers, routes, slaves)| {
            let mut settings = Settings { network, mdns, ..Settings::new() };
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
            settings
        })
}

proptest! {
    #[test]
    fn what_is_printed_recreates_the_settings(settings in any_settings()) {
        prop_assert_eq!(load(&print(&settings)), settings);
    }

    #[test]
    fn random_text_is_refused_without_a_panic_and_without_a_change(line in "\\PC{0,80}") {
        let mut settings = load(PORTS);
        let before = settings.clone();
        if !apply(&mut settings, &line).is_ok_and(|applied| applied.changed) {
            prop_assert_eq!(settings, before);
        }
    }

    #[test]
    fn random_words_of_the_language_never_panic_and_keep_the_settings_printable(
        lines in prop::collection::vec(random_line(), 1..20)
    ) {
        let mut settings = load(PORTS);
        for line in lines {
            let before = settings.clone();
            if apply(&mut settings, &line).is_err() {
                prop_assert_eq!(&settings, &before);
            }
        }
        // Places of deleted ports are not kept, so the text is compared and not the value.
        let text = print(&settings);
        prop_assert_eq!(print(&load(&text)), text);
    }
}

fn random_line() -> impl Strategy<Value = String> {
    const VERBS: &[&str] =
        &["port", "route", "edit port", "edit route 1", "insert route 1", "move route", "delete port"];
    const WORDS: &[&str] = &[
        "P1",
        "P2",
        "P3",
        "P502",
        "502",
        "serial",
        "tcp",
        "uart1",
        "rtu",
        "ascii",
        "client",
        "server",
        "9600",
        "8E1",
        "7E1",
        "timeout",
        "300ms",
        "gap",
        "0",
        "1",
        "2",
        "reserve",
        "for",
        "10.0.0.0/8,",
        "::1",
        "*",
        "-1",
        "=7",
        "1-64",
        "local",
        "readonly",
        "functions",
        "3,4",
        "priority",
        "high",
        ",",
        "#",
    ];
    let route = (0..3_usize, 0..9_u8, 0..3_usize).prop_map(|(from, unit, to)| {
        format!("route {} {unit} * * {}", ["P502", "P2", "P5"][from], ["P1", "P4", "local"][to])
    });
    let any = (prop::sample::select(VERBS), prop::collection::vec(prop::sample::select(WORDS), 0..9))
        .prop_map(|(verb, words)| format!("{verb} {}", words.join(" ")));
    let verbs: Vec<&'static str> = Vec::from(["delete route 1", "move route 1 2", "edit port P1 retries 3"]);
    prop_oneof![route, any, prop::sample::select(verbs).prop_map(String::from)]
}

fn any_value_type() -> impl Strategy<Value = ValueType> {
    prop::sample::select(TYPES.iter().map(|(_, value_type)| *value_type).collect::<Vec<_>>())
}

fn any_order() -> impl Strategy<Value = ByteOrder> {
    prop::sample::select(ORDERS.iter().map(|(_, order)| *order).collect::<Vec<_>>())
}
