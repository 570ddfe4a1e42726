//! The words that set something in a port, with the limits of their values.

use core::ops::RangeInclusive;

use embassy_time::Duration;
use heapless::{String, Vec};

use super::ethercat::ETHERCAT_KEYS;
use super::network_words::{TCP_CLIENT_KEYS, UDP_SERVER_KEYS};
use super::values::{listen, medium, number, prefix, small, time};
use super::words::{Word, Words, Wrong};
use super::{
    Allowed, Driver, Framing, IpPrefix, Parity, RESERVED_MAX, SerialSettings, Side, StreamFraming,
    TcpServerSettings,
};

const BAUD: RangeInclusive<u32> = 1..=10_000_000;
/// A gap above a second would make every line useless; 0 is for lines whose other end needs none.
const GAP: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(1);
const CHAR_TIMEOUT: RangeInclusive<Duration> = Duration::from_micros(100)..=Duration::from_secs(60);
pub(super) const TIMEOUT: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(3_600);
pub(super) const RETRIES: RangeInclusive<u8> = 0..=10;
const TURNAROUND: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(60);
const START_DELAY: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(3_600);
pub(super) const LATE_WINDOW: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(3_600);
pub(super) const DOWN_AFTER: RangeInclusive<u8> = 0..=255;
const ANSWER_WITHIN: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(3_600);
const REPLY_DELAY: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(10);
const DRIVER_DELAY: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(1);
/// A board may have room for fewer.
const CLIENTS: RangeInclusive<u16> = 1..=1_000;
const IDLE: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(86_400);
/// Messaging on TCP/IP 4.4.1.1 (NumberMaxOfServerTransaction): 1 to 16.
pub(super) const PIPELINE: RangeInclusive<u8> = 1..=16;
pub(super) const LIFETIME: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(3_600);

/// What a word of a port line sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    Device,
    Framing(Framing),
    Side(Side),
    Baud,
    Format,
    Gap,
    CharTimeout,
    Driver(Driver),
    DriverBefore,
    DriverAfter,
    Echo(bool),
    AnswerWithin,
    ReplyDelay,
    Timeout,
    Retries,
    Turnaround,
    StartDelay,
    LateWindow,
    DownAfter,
    Listen,
    Clients,
    Idle,
    Pipeline,
    Lifetime,
    Reserve,
    Allow,
    Stream(StreamFraming),
    Server,
    Unit,
    InFlight,
    ConnectTimeout,
    ConnectDelay,
    RequestDelay,
    Requests,
    OnLoss,
    Line,
}

impl Key {
    /// A bit for "this line has set it".
    pub(super) fn bit(self) -> u64 {
        1 << match self {
            Self::Device => 0,
            Self::Framing(_) => 1,
            Self::Side(_) => 2,
            Self::Baud => 3,
            Self::Format => 4,
            Self::Gap => 5,
            Self::CharTimeout => 6,
            Self::Timeout => 7,
            Self::Retries => 8,
            Self::Turnaround => 9,
            Self::StartDelay => 10,
            Self::LateWindow => 11,
            Self::DownAfter => 12,
            Self::Listen => 13,
            Self::Clients => 14,
            Self::Idle => 15,
            Self::Pipeline => 16,
            Self::Lifetime => 17,
            Self::Reserve => 18,
            Self::Driver(_) => 19,
            Self::DriverBefore => 20,
            Self::DriverAfter => 21,
            Self::Echo(_) => 22,
            Self::AnswerWithin => 23,
            Self::ReplyDelay => 24,
            Self::Stream(_) => 25,
            Self::Server => 26,
            Self::Unit => 27,
            Self::InFlight => 28,
            Self::ConnectTimeout => 29,
            Self::ConnectDelay => 30,
            Self::RequestDelay => 31,
            Self::Requests => 32,
            Self::Allow => 33,
            Self::OnLoss => 34,
            Self::Line => 35,
        }
    }
}

pub(super) const SERIAL_KEYS: &[(&str, Key)] = &[
    ("device", Key::Device),
    ("rtu", Key::Framing(Framing::Rtu)),
    ("ascii", Key::Framing(Framing::Ascii)),
    ("client", Key::Side(Side::Client)),
    ("server", Key::Side(Side::Server)),
    ("master", Key::Side(Side::Client)),
    ("slave", Key::Side(Side::Server)),
    ("gap", Key::Gap),
    ("char-timeout", Key::CharTimeout),
    ("rs485", Key::Driver(Driver::Rs485)),
    ("rts", Key::Driver(Driver::Rts)),
    // For `edit`: a flag has no value that could say so.
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
];

pub(super) const TCP_SERVER_KEYS: &[(&str, Key)] = &[
    ("listen", Key::Listen),
    ("clients", Key::Clients),
    ("idle", Key::Idle),
    ("pipeline", Key::Pipeline),
    ("lifetime", Key::Lifetime),
    ("reserve", Key::Reserve),
    ("allow", Key::Allow),
    ("rtu", Key::Stream(StreamFraming::Rtu)),
    ("capture", Key::Stream(StreamFraming::Capture)),
    // For `edit`: the flag has no value that could say so.
    ("mbap", Key::Stream(StreamFraming::Mbap)),
];

/// The words that set something.
pub(super) fn keywords() -> impl Iterator<Item = &'static str> {
    let tables = [SERIAL_KEYS, TCP_SERVER_KEYS, TCP_CLIENT_KEYS, UDP_SERVER_KEYS, ETHERCAT_KEYS];
    // Several ports have a `timeout`: it is one word.
    tables.into_iter().enumerate().flat_map(move |(nth, table)| {
        let new = move |keyword: &str| {
            !tables.iter().take(nth).any(|earlier| earlier.iter().any(|(known, _)| *known == keyword))
        };
        table.iter().map(|&(keyword, _)| keyword).filter(move |keyword| new(keyword))
    })
}

pub(super) const SERIAL_EXPECTED: &str = "rtu, ascii, client, server, a baud rate, a format (8E1), device, timeout, \
     char-timeout, gap, rs485, rts, driver-before, driver-after, echo, retries, turnaround, start-delay, late-window, \
     down-after, answer-within or reply-delay";
pub(super) const TCP_SERVER_EXPECTED: &str =
    "listen, rtu, capture, clients, idle, pipeline, lifetime, reserve or allow";

/// Sets in a serial port what `key` says; its value is `word` itself or the next word.
pub(super) fn set_serial(
    settings: &mut SerialSettings,
    key: Key,
    word: Word,
    words: &Words,
) -> Result<(), Wrong> {
    let SerialSettings { line, client, server, .. } = settings;
    match key {
        Key::Device => settings.device = device(words.take())?,
        Key::Framing(framing) => settings.framing = framing,
        Key::Side(side) => settings.side = side,
        Key::Baud => line.baud = number(word, "a baud rate", BAUD)?,
        Key::Format => (line.data_bits, line.parity, line.stop_bits) = format(word)?,
        Key::Gap => line.gap = auto_or_time(words.take(), GAP)?,
        Key::CharTimeout => line.char_timeout = auto_or_time(words.take(), CHAR_TIMEOUT)?,
        Key::Driver(driver) => line.driver = driver,
        Key::DriverBefore => line.driver_before = time(words.take(), DRIVER_DELAY)?,
        Key::DriverAfter => line.driver_after = time(words.take(), DRIVER_DELAY)?,
        Key::Echo(echo) => line.echo = echo,
        Key::AnswerWithin => server.answer_within = time(words.take(), ANSWER_WITHIN)?,
        Key::ReplyDelay => server.reply_delay = time(words.take(), REPLY_DELAY)?,
        Key::Timeout => client.timeout = time(words.take(), TIMEOUT)?,
        Key::Retries => client.retries = small(words.take(), "retries", RETRIES)?,
        Key::Turnaround => client.turnaround = time(words.take(), TURNAROUND)?,
        Key::StartDelay => client.start_delay = time(words.take(), START_DELAY)?,
        Key::LateWindow => client.late_window = auto_or_time(words.take(), LATE_WINDOW)?,
        Key::DownAfter => client.down_after = small(words.take(), "time-outs in a row", DOWN_AFTER)?,
        _ => return Err(word.expected(SERIAL_EXPECTED)),
    }
    Ok(())
}

/// Sets in a TCP server what `key` says.
pub(super) fn set_tcp_server(settings: &mut TcpServerSettings, key: Key, words: &Words) -> Result<(), Wrong> {
    if key == Key::Allow {
        settings.allowed = allowed(words)?;
        return Ok(());
    }
    if let Key::Stream(framing) = key {
        settings.framing = framing;
        return Ok(());
    }
    let value = words.take();
    match key {
        Key::Listen => settings.listen = listen(value)?,
        Key::Clients => settings.clients = medium(value, "connections", CLIENTS)?,
        Key::Idle => settings.idle = idle(value)?,
        Key::Pipeline => settings.pipeline = small(value, "requests", PIPELINE)?,
        Key::Lifetime => settings.lifetime = time(value, LIFETIME)?,
        Key::Reserve => {
            settings.reserved = medium(value, "places", 0..=*CLIENTS.end())?;
            settings.reserved_for = Vec::new();
            if settings.reserved > 0 {
                settings.reserved_for = reserved_for(words)?;
            }
        }
        _ => return Err(value.expected(TCP_SERVER_EXPECTED)),
    }
    Ok(())
}

/// `for 192.168.1.0/24,10.0.0.7`: what stands behind the number of reserved places.
fn reserved_for(words: &Words) -> Result<Vec<IpPrefix, RESERVED_MAX>, Wrong> {
    words.take().keyword(&[("for", ())], "for and the addresses that the places are kept for")?;
    prefixes(words)
}

/// What stands behind `allow`: prefixes, or `*` for everybody.
pub(super) fn allowed(words: &Words) -> Result<Allowed, Wrong> {
    if words.peek().is("*") {
        words.take();
        return Ok(Allowed::everybody());
    }
    prefixes(words).map(Allowed)
}

/// `192.168.1.0/24,10.0.0.7`
fn prefixes(words: &Words) -> Result<Vec<IpPrefix, RESERVED_MAX>, Wrong> {
    let mut prefixes = Vec::new();
    loop {
        let word = words.take();
        if prefixes.push(prefix(word)?).is_err() {
            return Err(word.expected("at most 4 prefixes"));
        }
        let next = words.peek();
        if next.is_end() || !next.listed {
            return Ok(prefixes);
        }
    }
}

const _: () = assert!(RESERVED_MAX == 4, "the error text of `prefixes` names the number");

/// A time after which a connection without requests is closed; 0 is never.
pub(super) fn idle(word: Word) -> Result<Duration, Wrong> {
    if word.text == "0" { Ok(Duration::from_ticks(0)) } else { time(word, IDLE) }
}

/// `auto` gives the setting back to the specification's rule.
pub(super) fn auto_or_time(word: Word, range: RangeInclusive<Duration>) -> Result<Option<Duration>, Wrong> {
    if word.is("auto") { Ok(None) } else { time(word, range).map(Some) }
}

/// Names the limit as a number.
const DEVICE_EXPECTED: &str = match super::DEVICE_BYTES_MAX {
    96 => "a serial device such as uart1 or /dev/ttyUSB0, at most 96 characters",
    15 => "a serial device such as uart1, at most 15 characters",
    _ => panic!("another text is needed"),
};

/// The device name that `word` is.
pub(super) fn device<const N: usize>(word: Word) -> Result<String<N>, Wrong> {
    let good = !word.is_end() && word.text.bytes().all(|byte| byte.is_ascii_graphic());
    let name = if good { String::try_from(word.text).ok() } else { None };
    name.ok_or_else(|| word.expected(DEVICE_EXPECTED))
}

/// Data bits, parity, stop bits: `8E1`.
fn format(word: Word) -> Result<(u8, Parity, u8), Wrong> {
    let parsed = match word.text.as_bytes() {
        &[data @ b'7'..=b'8', parity, stop @ b'1'..=b'2'] => {
            let parity = match parity.to_ascii_uppercase() {
                b'N' => Some(Parity::None),
                b'E' => Some(Parity::Even),
                b'O' => Some(Parity::Odd),
                _ => None,
            };
            parity.map(|parity| (data - b'0', parity, stop - b'0'))
        }
        _ => None,
    };
    parsed.ok_or_else(|| word.expected("a format such as 8E1, 7E1, 8N1 or 8N2"))
}
