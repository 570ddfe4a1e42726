//! The keywords of port lines by kind of port, in printing order, with their list for errors.

use super::port_keys::{Key, Keywords};
use crate::scanner::POINTS;
use crate::settings::{Driver, Framing, Side, StreamFraming, TLS};

pub(super) const SERIAL: Keywords = (
    &[
        ("device", Key::Device),
        ("rtu", Key::Framing(Framing::Rtu)),
        ("ascii", Key::Framing(Framing::Ascii)),
        ("client", Key::Side(Side::Client)),
        ("server", Key::Side(Side::Server)),
        ("master", Key::Side(Side::Client)),
        ("slave", Key::Side(Side::Server)),
        ("char-timeout", Key::CharTimeout),
        ("gap", Key::Gap),
        ("rs485", Key::Driver(Driver::Rs485)),
        ("rts", Key::Driver(Driver::Rts)),
        // For `edit`: resets a flag.
        ("rs232", Key::Driver(Driver::Automatic)),
        ("driver-before", Key::DriverBefore),
        ("driver-after", Key::DriverAfter),
        ("echo", Key::Echo(true)),
        ("no-echo", Key::Echo(false)),
        ("answer-within", Key::AnswerWithin),
        ("reply-delay", Key::ReplyDelay),
        ("timeout", Key::Timeout),
        ("retries", Key::Retries),
        ("turnaround", Key::Turnaround),
        ("start-delay", Key::StartDelay),
        ("late-window", Key::LateWindow),
        ("down-after", Key::DownAfter),
        ("proof", Key::Proof),
    ],
    "rtu, ascii, client, server, a baud rate, a format (8E1), device, timeout, char-timeout, gap, rs485, rts, \
     driver-before, driver-after, echo, retries, turnaround, start-delay, late-window, \
     down-after, proof, answer-within or reply-delay",
);

const TCP_SERVER_EXPECTED: &str = if TLS {
    "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve, allow, tls, certificate or trust"
} else {
    "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve or allow"
};

pub(super) const TCP_SERVER: Keywords = (
    &[
        ("listen", Key::Listen),
        ("rtu", Key::Stream(StreamFraming::Rtu)),
        ("capture", Key::Stream(StreamFraming::Capture)),
        // For `edit`: resets a flag.
        ("mbap", Key::Stream(StreamFraming::Mbap)),
        // Images without TLS have no word of it; also below.
        #[cfg(feature = "tls")]
        ("tls", Key::Tls(true)),
        // For `edit`: resets a flag.
        #[cfg(feature = "tls")]
        ("no-tls", Key::Tls(false)),
        #[cfg(feature = "tls")]
        ("certificate", Key::Certificate),
        #[cfg(feature = "tls")]
        ("trust", Key::Trust),
        ("clients", Key::Clients),
        ("idle", Key::Idle),
        ("pipeline", Key::Pipeline),
        ("lifetime", Key::Lifetime),
        ("full", Key::Full),
        ("reserve", Key::Reserve),
        ("allow", Key::Allow),
    ],
    TCP_SERVER_EXPECTED,
);

pub(super) const SSH_SERVER: Keywords = (
    &[
        ("listen", Key::Listen),
        ("clients", Key::Clients),
        ("full", Key::Full),
        ("reserve", Key::Reserve),
        ("allow", Key::Allow),
    ],
    "listen, clients, full, reserve or allow",
);

const TCP_CLIENT_EXPECTED: &str = if TLS {
    "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
     connect-delay, request-delay, idle, retries, late-window, down-after, proof, tls, certificate or trust"
} else {
    "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
     connect-delay, request-delay, idle, retries, late-window, down-after or proof"
};

pub(super) const TCP_CLIENT: Keywords = (
    &[
        ("address", Key::Server),
        ("rtu", Key::Stream(StreamFraming::Rtu)),
        // For `edit`: resets a flag.
        ("mbap", Key::Stream(StreamFraming::Mbap)),
        // Images without TLS have no word of it; also below.
        #[cfg(feature = "tls")]
        ("tls", Key::Tls(true)),
        // For `edit`: resets a flag.
        #[cfg(feature = "tls")]
        ("no-tls", Key::Tls(false)),
        #[cfg(feature = "tls")]
        ("certificate", Key::Certificate),
        #[cfg(feature = "tls")]
        ("trust", Key::Trust),
        ("sockets", Key::Sockets),
        ("unit", Key::Unit),
        ("in-flight", Key::InFlight),
        ("timeout", Key::Timeout),
        ("connect-timeout", Key::ConnectTimeout),
        ("connect-delay", Key::ConnectDelay),
        ("request-delay", Key::RequestDelay),
        ("idle", Key::Idle),
        ("retries", Key::Retries),
        ("late-window", Key::LateWindow),
        ("down-after", Key::DownAfter),
        ("proof", Key::Proof),
    ],
    TCP_CLIENT_EXPECTED,
);

pub(super) const UDP_SERVER: Keywords = (
    &[
        ("listen", Key::Listen),
        ("pipeline", Key::Pipeline),
        ("requests", Key::Requests),
        ("lifetime", Key::Lifetime),
        ("allow", Key::Allow),
    ],
    "listen, pipeline, requests, lifetime or allow",
);

// As above.
#[cfg(feature = "web")]
pub(super) const HTTP: Keywords = (
    &[
        ("listen", Key::Listen),
        ("allow", Key::Allow),
        ("cleartext", Key::Cleartext(true)),
        // For `edit`: resets a flag.
        ("no-cleartext", Key::Cleartext(false)),
    ],
    "listen, allow or cleartext",
);

pub(super) const NONE: Keywords = (&[], "");
pub(super) const ETHERCAT: Keywords = if POINTS { WITH_CONTROLLER } else { NONE };
const WITH_CONTROLLER: Keywords = (
    &[
        ("interface", Key::Interface),
        ("line", Key::Line),
        ("on-loss", Key::OnLoss),
        ("id", Key::Id),
        ("modules", Key::Modules(true)),
        // For `edit`: resets a flag.
        ("no-modules", Key::Modules(false)),
        ("emergencies", Key::Emergencies(true)),
        // For `edit`: resets a flag.
        ("no-emergencies", Key::Emergencies(false)),
        ("prove-outputs", Key::ProveOutputs(true)),
        // For `edit`: resets a flag.
        ("no-prove-outputs", Key::ProveOutputs(false)),
    ],
    "interface, line, on-loss, id, modules, emergencies or prove-outputs",
);
