//! The keywords of each kind of port, and those that all server-side ports share.

use crate::settings::{Driver, Framing, Key, Side, StreamFraming, TLS};

/// Keywords with their keys, in printing order.
pub(crate) type Keys = &'static [(&'static str, Key)];

/// Keywords with their keys, in printing order, and their list for errors.
pub(crate) type Keywords = (Keys, &'static str);

/// The keywords for special unit ids, common to all server-side ports: 0, 255, 248 to 254.
pub(crate) const UNIT_KEYS: Keys = &[
    ("broadcast", Key::Broadcast),
    ("confirm-broadcast", Key::Confirm(true)),
    // For `edit`: resets a flag.
    ("no-confirm-broadcast", Key::Confirm(false)),
    ("unit-255", Key::Unit255),
    ("reserved-units", Key::ReservedUnits),
];

/// The keywords of each kind in printing order, with their list for errors. Those for the default are for `edit`, which resets
/// a flag by them: `rs232`, `mbap`, `no-tls`.
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
     driver-before, driver-after, echo, retries, turnaround, start-delay, late-window, down-after, proof, answer-within or reply-delay",
);

pub(super) const TCP_SERVER: Keywords = (
    &[
        ("listen", Key::Listen),
        ("rtu", Key::Stream(StreamFraming::Rtu)),
        ("capture", Key::Stream(StreamFraming::Capture)),
        ("mbap", Key::Stream(StreamFraming::Mbap)),
        #[cfg(feature = "tls")]
        ("tls", Key::Tls(true)),
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
    if TLS {
        "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve, allow, tls, certificate or trust"
    } else {
        "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve or allow"
    },
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

pub(super) const TCP_CLIENT: Keywords = (
    &[
        ("address", Key::Server),
        ("rtu", Key::Stream(StreamFraming::Rtu)),
        ("mbap", Key::Stream(StreamFraming::Mbap)),
        #[cfg(feature = "tls")]
        ("tls", Key::Tls(true)),
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
    if TLS {
        "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
         connect-delay, request-delay, idle, retries, late-window, down-after, proof, tls, certificate or trust"
    } else {
        "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
         connect-delay, request-delay, idle, retries, late-window, down-after or proof"
    },
);

/// A client whose device connects.
// As the settings.
#[cfg(feature = "dial-in")]
pub(super) const TCP_DIAL_IN: Keywords = (
    &[
        ("listen", Key::Listen),
        ("rtu", Key::Stream(StreamFraming::Rtu)),
        ("mbap", Key::Stream(StreamFraming::Mbap)),
        ("allow", Key::Allow),
        ("first", Key::First),
        ("unit", Key::Unit),
        ("in-flight", Key::InFlight),
        ("timeout", Key::Timeout),
        ("connect-delay", Key::ConnectDelay),
        ("request-delay", Key::RequestDelay),
        ("idle", Key::Idle),
        ("retries", Key::Retries),
        ("late-window", Key::LateWindow),
        ("down-after", Key::DownAfter),
        ("proof", Key::Proof),
    ],
    "listen, rtu, allow, first, unit, in-flight, timeout, connect-delay, request-delay, idle, retries, late-window, \
     down-after or proof",
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

#[cfg(feature = "web")]
pub(super) const HTTP: Keywords = (
    &[
        ("listen", Key::Listen),
        ("allow", Key::Allow),
        ("cleartext", Key::Cleartext(true)),
        ("no-cleartext", Key::Cleartext(false)),
        ("metrics", Key::Metrics(true)),
        ("no-metrics", Key::Metrics(false)),
        #[cfg(feature = "tls")]
        ("tls", Key::Tls(true)),
        #[cfg(feature = "tls")]
        ("no-tls", Key::Tls(false)),
        #[cfg(feature = "tls")]
        ("certificate", Key::Certificate),
        #[cfg(feature = "tls")]
        ("trust", Key::Trust),
    ],
    if TLS {
        "listen, allow, cleartext, metrics, tls, certificate or trust"
    } else {
        "listen, allow, cleartext or metrics"
    },
);

pub(super) const NONE: Keywords = (&[], "");
