//! Any port.

use core::net::IpAddr;
use std::format;

use embassy_time::Duration;
use proptest::prelude::*;

use super::super::std;
use crate::scanner::{Kind, POINTS};
use crate::settings::UnitRange;
use crate::settings::*;

pub(super) fn duration(us: core::ops::RangeInclusive<u64>) -> impl Strategy<Value = Duration> {
    let (low, high) = (*us.start(), *us.end());
    let any = us.prop_map(Duration::from_micros);
    let round = (low.div_ceil(1_000)..=high / 1_000).prop_map(Duration::from_millis);
    prop_oneof![any, round]
}

pub(super) fn any_prefix() -> impl Strategy<Value = IpPrefix> {
    let v4 = (any::<u32>(), 0..=32_u8).prop_map(|(bits, length)| {
        let mask = u32::MAX.checked_shl(32 - u32::from(length)).unwrap_or(0);
        IpPrefix::new(IpAddr::V4((bits & mask).into()), length).unwrap()
    });
    let v6 = (any::<u128>(), 0..=128_u8).prop_map(|(bits, length)| {
        let mask = u128::MAX.checked_shl(128 - u32::from(length)).unwrap_or(0);
        IpPrefix::new(IpAddr::V6((bits & mask).into()), length).unwrap()
    });
    prop_oneof![v4, v6]
}

pub(super) fn any_line(framing: Framing) -> impl Strategy<Value = LineSettings> {
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

pub(super) fn any_driver() -> impl Strategy<Value = (Driver, Duration, Duration)> {
    let none = Duration::from_ticks(0);
    let switched = (any::<bool>(), duration(0..=1_000_000), duration(0..=1_000_000))
        .prop_map(|(rts, before, after)| (if rts { Driver::Rts } else { Driver::Rs485 }, before, after));
    prop_oneof![Just((Driver::Automatic, none, none)), switched]
}

pub(super) fn any_server() -> impl Strategy<Value = SerialServerSettings> {
    (duration(10_000..=3_600_000_000), duration(0..=10_000_000))
        .prop_map(|(answer_within, reply_delay)| SerialServerSettings { answer_within, reply_delay })
}

pub(super) fn any_proofs() -> impl Strategy<Value = Proofs> {
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

pub(super) fn any_client() -> impl Strategy<Value = SerialClientSettings> {
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

pub(super) fn any_serial(n: usize) -> impl Strategy<Value = PortKind> {
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

pub(super) fn any_tcp_server(n: usize) -> impl Strategy<Value = PortKind> {
    let address = prop::option::of(prop_oneof![
        any::<u32>().prop_map(|bits| IpAddr::V4(bits.into())),
        any::<u128>().prop_map(|bits| IpAddr::V6(bits.into())),
    ]);
    let idle = prop_oneof![Just(Duration::from_ticks(0)), duration(1_000_000..=86_400_000_000)];
    let reserved_for = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    // Where there is no SSH, nobody has such a server.
    let no_requests = if SSH { StreamFraming::Ssh } else { StreamFraming::Capture };
    (
        (address, prop_oneof![any_stream(), Just(StreamFraming::Capture), Just(no_requests)]),
        (1..=1_000_u16, any::<bool>()),
        idle,
        1..=16_u8,
        duration(10_000..=3_600_000_000),
        1..=1_000_u16,
        (reserved_for, allowed, any_tls(1)),
    )
        .prop_map(
            move |(
                (address, framing),
                (clients, refuses),
                idle,
                pipeline,
                lifetime,
                reserved,
                (reserved_for, allowed, _tls),
            )| {
                let allowed = Allowed(allowed.into_iter().collect());
                let reserved = if reserved_for.is_empty() { 0 } else { reserved.min(clients) };
                let reserved_for = reserved_for.into_iter().collect();
                let listen = TcpListen { address, port: 502 + n as u16 };
                let pipeline = if framing == StreamFraming::Mbap { pipeline } else { 16 };
                let (idle, lifetime) = match framing {
                    StreamFraming::Capture | StreamFraming::Ssh => {
                        (Duration::from_secs(60), Duration::from_secs(5))
                    }
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
                    // As the field.
                    #[cfg(feature = "tls")]
                    tls: if framing == StreamFraming::Ssh { TlsSettings::OFF } else { _tls },
                })
            },
        )
}

/// With the certificates of [`any_settings`](super::any::any_settings), of which the one with the number `trust` is for this side.
#[cfg(feature = "tls")] // Left out of images without TLS; also below.
fn any_tls(trust: usize) -> impl Strategy<Value = TlsSettings> {
    let name = |nth: usize| Name::try_from(format!("user.{nth}").as_str()).unwrap();
    (any::<bool>(), any::<bool>(), any::<bool>()).prop_map(move |(on, certificate, trusts)| TlsSettings {
        on,
        certificate: (on && certificate).then(|| name(0)),
        trust: (on && trusts).then(|| name(trust)),
    })
}

#[cfg(not(feature = "tls"))]
fn any_tls(_: usize) -> impl Strategy<Value = ()> {
    Just(())
}

pub(super) fn any_address() -> impl Strategy<Value = ServerAddress> {
    let host = prop_oneof![
        4 => (1..=u32::MAX).prop_map(|bits| Host::Address(IpAddr::V4(bits.into()))),
        4 => (1..=u128::MAX).prop_map(|bits| Host::Address(IpAddr::V6(bits.into()))),
        u32::from(SERVERS) => "([a-z0-9]([a-z0-9_-]{0,9}[a-z0-9])?[.]){0,3}meter[a-z0-9]{0,5}"
            .prop_map(|name| Host::Name(name.as_str().try_into().unwrap())),
    ];
    (host, 1..=u16::MAX).prop_map(|(host, port)| ServerAddress { host, port })
}

/// With an address of its own, or for several servers.
pub(super) fn any_tcp_client() -> impl Strategy<Value = PortKind> {
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
    let health = (late_window, any::<u8>(), any_proofs(), any_tls(2));
    (place, duration(1_000..=hour), duration(1_000..=hour), delays, idle, 0..=10_u8, health).prop_map(
        |(place, timeout, connect_timeout, delays, idle, retries, health)| {
            let ((server, sockets), framing, unit, in_flight) = place;
            let (late_window, down_after, proofs, _tls) = health;
            let (connect_delay, request_delay) = delays;
            PortKind::TcpClient(TcpClientSettings {
                unit: unit.filter(|_| server.is_some()),
                server,
                // As the field.
                #[cfg(feature = "dial-in")]
                dial_in: None,
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
                // As the field.
                #[cfg(feature = "tls")]
                tls: _tls,
            })
        },
    )
}

/// A client whose device connects, where the image has it.
#[cfg(feature = "dial-in")]
pub(super) fn any_dial_in(n: usize) -> impl Strategy<Value = PortKind> {
    let text = "[ -~]{1,32}".prop_map(|text| text.replace('"', "'").into_bytes());
    let bytes = prop_oneof![
        Just(std::vec::Vec::new()),
        text,
        "0x[ -~]{0,30}".prop_map(|text| text.into_bytes()),
        prop::collection::vec(any::<u8>(), 1..=FIRST_BYTES_MAX)
    ];
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    let address = prop::option::of((1..=u32::MAX).prop_map(|bits| IpAddr::V4(bits.into())));
    (any_tcp_client(), any::<Option<u8>>(), address, allowed, bytes).prop_map(
        move |(kind, unit, address, allowed, first)| {
            let listen = TcpListen { address, port: 502 + n as u16 };
            let PortKind::TcpClient(client) = kind else { return kind };
            let dial_in = DialIn {
                listen,
                allowed: Allowed(allowed.into_iter().collect()),
                first: first.into_iter().collect(),
            };
            let TcpClientSettings { sockets, connect_timeout, .. } = TcpClientSettings::new(None);
            PortKind::TcpClient(TcpClientSettings {
                server: None,
                dial_in: Some(dial_in),
                unit,
                sockets,
                connect_timeout,
                // As the field.
                #[cfg(feature = "tls")]
                tls: TlsSettings::OFF,
                ..client
            })
        },
    )
}

/// Other images have another port instead.
#[cfg(not(feature = "dial-in"))]
pub(super) fn any_dial_in(_: usize) -> impl Strategy<Value = PortKind> {
    any_tcp_client()
}

pub(super) fn any_units() -> impl Strategy<Value = UnitPolicy> {
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

pub(super) fn any_udp_server(n: usize) -> impl Strategy<Value = PortKind> {
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    (1..=16_u8, 1..=32_u8, duration(10_000..=3_600_000_000), allowed).prop_map(
        move |(pipeline, requests, lifetime, allowed)| {
            let listen = TcpListen { address: None, port: 502 + n as u16 };
            let allowed = Allowed(allowed.into_iter().collect());
            PortKind::UdpServer(UdpServerSettings { listen, pipeline, requests, lifetime, allowed })
        },
    )
}

/// There can be one, where the image has it.
// As the variant.
#[cfg(feature = "web")]
pub(super) fn any_http(_: usize) -> impl Strategy<Value = PortKind> {
    let allowed = prop::collection::vec(any_prefix(), 0..=RESERVED_MAX);
    let address = prop::option::of((1..=u32::MAX).prop_map(|bits| IpAddr::V4(bits.into())));
    let flags = (any::<bool>(), any::<bool>(), any_tls(1));
    (address, allowed, flags).prop_map(|(address, allowed, (cleartext, metrics, _tls))| {
        PortKind::Http(HttpSettings {
            allowed: Allowed(allowed.into_iter().collect()),
            cleartext,
            metrics,
            #[cfg(feature = "tls")]
            tls: _tls,
            ..HttpSettings::new(TcpListen { address, port: 80 })
        })
    })
}

/// Images without a web interface have another port instead.
#[cfg(not(feature = "web"))]
pub(super) fn any_http(n: usize) -> impl Strategy<Value = PortKind> {
    any_udp_server(n)
}

pub(super) fn any_stream() -> impl Strategy<Value = StreamFraming> {
    prop_oneof![Just(StreamFraming::Mbap), Just(StreamFraming::Rtu)]
}

/// There can be one.
pub(super) fn any_ethercat() -> impl Strategy<Value = PortKind> {
    let on_loss = prop_oneof![Just(OnLoss::Hold), Just(OnLoss::Clear), Just(OnLoss::Stop)];
    let line = prop::option::of("[A-Za-z][A-Za-z0-9.-]{0,9}_1");
    let interface = prop::option::of("[A-Za-z0-9_.:@-]{1,15}");
    let id = prop::option::of(1..=u16::MAX);
    let files = prop_oneof![Just(FileRights::Off), Just(FileRights::Read), Just(FileRights::Write)]
        .prop_map(|files| if cfg!(feature = "files") { files } else { FileRights::Off });
    let interfaces = [interface.clone(), interface];
    (interfaces, on_loss, line, any::<bool>(), id, any::<bool>(), any::<bool>(), files).prop_map(
        |(interfaces, on_loss, line, prove_outputs, id, emergencies, modules, files)| {
            let [interface, _ethernet] =
                interfaces.map(|name| name.map(|name| name.as_str().try_into().unwrap()));
            let line = line.map(|name| Name::try_from(name.as_str()).unwrap());
            PortKind::Ethercat(EthercatSettings {
                interface,
                on_loss,
                line,
                prove_outputs,
                id,
                emergencies,
                modules,
                files,
                #[cfg(feature = "eoe")] // As its word.
                ethernet: _ethernet,
                // Only asked for with points.
                ..EthercatSettings::new().unwrap()
            })
        },
    )
}

pub(super) fn any_port(n: usize) -> impl Strategy<Value = Port> {
    let kind = prop_oneof![
        any_serial(n).boxed(),
        any_tcp_server(n).boxed(),
        any_tcp_client().boxed(),
        any_dial_in(n).boxed(),
        any_udp_server(n).boxed(),
        if n == 0 && POINTS { any_ethercat().boxed() } else { any_udp_server(n).boxed() },
        if n == 1 { any_http(n).boxed() } else { any_udp_server(n).boxed() },
    ];
    ("[A-Za-z][A-Za-z0-9.-]{0,11}", kind, any_units()).prop_map(move |(name, kind, units)| {
        // The number keeps names apart, also from the reserved ones.
        let captures =
            matches!(&kind, PortKind::TcpServer(server) if server.framing == StreamFraming::Capture);
        let asked = kind.side() == Side::Server && !captures && kind.has_units();
        let units = if asked { units } else { UnitPolicy::default() };
        Port { name: Name::try_from(format!("{name}_{n}").as_str()).unwrap(), kind, units }
    })
}
