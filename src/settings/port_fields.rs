//! The field that each key sets, by kind of port.

// As its port.
#[cfg(feature = "web")]
use crate::settings::HttpSettings;
// As what uses it.
#[cfg(feature = "tls")]
use crate::settings::TlsSettings;
use crate::settings::port_limits::{
    BAUD, CHAR_TIMEOUT, CLIENTS, DOWN_AFTER, HOUR, ID, IDLE, LIFETIME, MINUTE, PIPELINE, REQUESTS, RESERVED,
    RETRIES, SECOND, SOCKETS, TEN_SECONDS, TIMEOUT, UNIT,
};
use crate::settings::{
    EthercatSettings, Field, Key, SerialSettings, TcpClientSettings, TcpServerSettings, UdpServerSettings,
    UnitPolicy,
};

impl SerialSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
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
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
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
            // Left out of images without TLS.
            #[cfg(feature = "tls")]
            key => return self.tls.field(key),
            #[cfg(not(feature = "tls"))]
            _ => return None,
        })
    }
}

#[cfg(feature = "tls")]
impl TlsSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Tls(on) => Field::Flag(&mut self.on, on),
            Key::Certificate => Field::Certificate(&mut self.certificate),
            Key::Trust => Field::Certificate(&mut self.trust),
            _ => return None,
        })
    }
}

impl TcpClientSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        // Other images have no such devices.
        #[cfg(feature = "dial-in")]
        if let Some(dial_in) = &mut self.dial_in {
            match key {
                Key::Listen => return Some(Field::Listen(&mut dial_in.listen)),
                Key::Allow => return Some(Field::Allow(&mut dial_in.allowed)),
                Key::First => return Some(Field::First(&mut dial_in.first)),
                _ => {}
            }
        }
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
            #[cfg(feature = "tls")]
            key => return self.tls.field(key),
            #[cfg(not(feature = "tls"))]
            _ => return None,
        })
    }
}

// Images without a web interface have none.
#[cfg(feature = "web")]
impl HttpSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Listen => Field::Listen(&mut self.listen),
            Key::Allow => Field::Allow(&mut self.allowed),
            Key::Cleartext(is_clear) => Field::Flag(&mut self.cleartext, is_clear),
            Key::Metrics(is_open) => Field::Flag(&mut self.metrics, is_open),
            #[cfg(feature = "tls")]
            key => return self.tls.field(key),
            #[cfg(not(feature = "tls"))]
            _ => return None,
        })
    }
}

impl UdpServerSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
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

impl EthercatSettings {
    pub(super) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Interface => Field::Interface(&mut self.interface),
            Key::Line => Field::Line(&mut self.line),
            Key::OnLoss => Field::OnLoss(&mut self.on_loss),
            Key::ProveOutputs(prove) => Field::Flag(&mut self.prove_outputs, prove),
            Key::Emergencies(sent) => Field::Flag(&mut self.emergencies, sent),
            Key::Modules(modules) => Field::Flag(&mut self.modules, modules),
            Key::Id => Field::Id(&mut self.id, &ID),
            #[cfg(feature = "files")]
            Key::Files => Field::Files(&mut self.files),
            #[cfg(feature = "eoe")]
            Key::Ethernet => Field::Interface(&mut self.ethernet),
            _ => return None,
        })
    }
}

impl UnitPolicy {
    /// The field that `key` sets, if it is one of these.
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
