//! The fields that the keywords of each kind of port set, with their limits.

use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::field::{Count, Field};
use super::port_keys::Key;
use crate::scanner::POINTS;
use crate::settings::{
    PortKind, SOCKETS_MAX, SerialSettings, TcpClientSettings, TcpServerSettings, UDP_REQUESTS_MAX,
    UdpServerSettings, UnitPolicy,
};

/// A time of at most this many seconds.
const fn up_to(seconds: u64) -> RangeInclusive<Duration> {
    Duration::from_ticks(0)..=Duration::from_secs(seconds)
}

type Times = RangeInclusive<Duration>;

const BAUD: RangeInclusive<u32> = 1..=10_000_000;

/// A gap above a second would make any line useless; 0 is for lines that need none.
const SECOND: Times = up_to(1);

const TEN_SECONDS: Times = up_to(10);

const MINUTE: Times = up_to(60);

const HOUR: Times = up_to(3_600);

const CHAR_TIMEOUT: Times = Duration::from_micros(100)..=Duration::from_secs(60);

const TIMEOUT: Times = Duration::from_millis(1)..=Duration::from_secs(3_600);

/// For queued requests, and for responses.
const LIFETIME: Times = Duration::from_millis(10)..=Duration::from_secs(3_600);

const IDLE: Times = Duration::from_secs(1)..=Duration::from_secs(86_400);

const RETRIES: Count = Count("retries", 0..=10);

const DOWN_AFTER: Count = Count("time-outs in a row", 0..=255);

/// Boards may have fewer.
const CLIENTS: Count = Count("connections", 1..=1_000);

const RESERVED: Count = Count("places", 0..=1_000);

/// Messaging on TCP/IP 4.4.1.1 (NumberMaxOfServerTransaction): 1 to 16.
const PIPELINE: Count = Count("requests", 1..=16);

const REQUESTS: Count = Count("requests", 1..=UDP_REQUESTS_MAX as u32);

/// Boards have few.
const SOCKETS: Count = Count("connections", 1..=SOCKETS_MAX as u32);

/// 0 would mean none (ETG.1020).
const ID: Count = Count("alias, or an id", 1..=u16::MAX as u32);

const UNIT: Count = Count("auto, or a unit id", 0..=255);

impl PortKind {
    /// The field that `key` sets; none if this kind of port has no such setting.
    pub(crate) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        match self {
            Self::Serial(settings) => settings.field(key),
            Self::TcpServer(settings) => settings.field(key),
            Self::TcpClient(settings) => settings.field(key),
            Self::UdpServer(settings) => settings.field(key),
            Self::Scanner => None,
            Self::Ethercat(_) if !POINTS => None,
            Self::Ethercat(settings) => match key {
                Key::Interface => Some(Field::Interface(&mut settings.interface)),
                Key::Line => Some(Field::Line(&mut settings.line)),
                Key::OnLoss => Some(Field::OnLoss(&mut settings.on_loss)),
                Key::ProveOutputs(prove) => Some(Field::Flag(&mut settings.prove_outputs, prove)),
                Key::Emergencies(sent) => Some(Field::Flag(&mut settings.emergencies, sent)),
                Key::Modules(modules) => Some(Field::Flag(&mut settings.modules, modules)),
                Key::Id => Some(Field::Id(&mut settings.id, &ID)),
                _ => None,
            },
        }
    }
}

impl SerialSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        let Self { line, client, server, .. } = self;
        Some(match key {
            Key::Device => Field::Device(&mut self.device),
            Key::Framing(framing) => Field::Framing(&mut self.framing, framing),
            Key::Side(side) => Field::Side(&mut self.side, side),
            Key::Baud => Field::Baud(&mut line.baud, &BAUD),
            Key::Format => Field::Format(line),
            Key::Gap => Field::AutoTime(&mut line.gap, &SECOND),
            Key::CharTimeout => Field::AutoTime(&mut line.char_timeout, &CHAR_TIMEOUT),
            Key::Driver(driver) => Field::Driver(&mut line.driver, driver),
            Key::DriverBefore => Field::Time(&mut line.driver_before, &SECOND),
            Key::DriverAfter => Field::Time(&mut line.driver_after, &SECOND),
            Key::Echo(echo) => Field::Flag(&mut line.echo, echo),
            Key::AnswerWithin => Field::Time(&mut server.answer_within, &LIFETIME),
            Key::ReplyDelay => Field::Time(&mut server.reply_delay, &TEN_SECONDS),
            Key::Timeout => Field::Time(&mut client.timeout, &TIMEOUT),
            Key::Retries => Field::Small(&mut client.retries, &RETRIES),
            Key::Turnaround => Field::Time(&mut client.turnaround, &MINUTE),
            Key::StartDelay => Field::Time(&mut client.start_delay, &HOUR),
            Key::LateWindow => Field::AutoTime(&mut client.late_window, &HOUR),
            Key::DownAfter => Field::Small(&mut client.down_after, &DOWN_AFTER),
            Key::Proof => Field::Proofs(&mut client.proofs),
            _ => return None,
        })
    }
}

impl TcpServerSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Listen => Field::Listen(&mut self.listen),
            Key::Stream(framing) => Field::Stream(&mut self.framing, framing),
            Key::Clients => Field::Medium(&mut self.clients, &CLIENTS),
            Key::Idle => Field::Idle(&mut self.idle, &IDLE),
            Key::Pipeline => Field::Small(&mut self.pipeline, &PIPELINE),
            Key::Lifetime => Field::Time(&mut self.lifetime, &LIFETIME),
            Key::Full => Field::Full(&mut self.refuses),
            Key::Reserve => Field::Reserve(&mut self.reserved, &mut self.reserved_for, &RESERVED),
            Key::Allow => Field::Allow(&mut self.allowed),
            _ => return None,
        })
    }
}

impl TcpClientSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Server => Field::Server(&mut self.server),
            Key::Stream(framing) => Field::Stream(&mut self.framing, framing),
            Key::Unit => Field::Unit(&mut self.unit, &UNIT),
            Key::Sockets => Field::Small(&mut self.sockets, &SOCKETS),
            Key::InFlight => Field::Small(&mut self.in_flight, &PIPELINE),
            Key::Timeout => Field::Time(&mut self.timeout, &TIMEOUT),
            Key::ConnectTimeout => Field::Time(&mut self.connect_timeout, &TIMEOUT),
            Key::ConnectDelay => Field::Time(&mut self.connect_delay, &MINUTE),
            Key::RequestDelay => Field::Time(&mut self.request_delay, &MINUTE),
            Key::Idle => Field::Idle(&mut self.idle, &IDLE),
            Key::Retries => Field::Small(&mut self.retries, &RETRIES),
            Key::LateWindow => Field::AutoTime(&mut self.late_window, &HOUR),
            Key::DownAfter => Field::Small(&mut self.down_after, &DOWN_AFTER),
            Key::Proof => Field::Proofs(&mut self.proofs),
            _ => return None,
        })
    }
}

impl UdpServerSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Listen => Field::Listen(&mut self.listen),
            Key::Pipeline => Field::Small(&mut self.pipeline, &PIPELINE),
            Key::Requests => Field::Small(&mut self.requests, &REQUESTS),
            Key::Lifetime => Field::Time(&mut self.lifetime, &LIFETIME),
            Key::Allow => Field::Allow(&mut self.allowed),
            _ => return None,
        })
    }
}

impl UnitPolicy {
    /// See [`PortKind::field`].
    pub(crate) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Broadcast => Field::Special(&mut self.broadcast, true),
            Key::Confirm(confirm) => Field::Flag(&mut self.confirm, confirm),
            Key::Unit255 => Field::Special(&mut self.unit_255, false),
            Key::ReservedUnits => Field::Special(&mut self.reserved, false),
            _ => return None,
        })
    }
}
