//! The words of a port: `serial uart1 rtu client 19200 8E1 timeout 300ms`, `tcp server 502 clients 16`.
//!
//! A [`Draft`] starts from the defaults or from the port as it is, takes word by word in any order, and is checked
//! as a whole at the end of the line. What a port cannot use is refused, so that no setting is taken and ignored.

use super::ethercat::{ETHERCAT_EXPECTED, ETHERCAT_KEYS, set_ethercat};
use super::network_words::{
    TCP_CLIENT_EXPECTED, TCP_CLIENT_KEYS, UDP_SERVER_EXPECTED, UDP_SERVER_KEYS, server, set_tcp_client,
    set_udp_server,
};
use super::port_keys::{
    Key, SERIAL_EXPECTED, SERIAL_KEYS, TCP_SERVER_EXPECTED, TCP_SERVER_KEYS, device, set_serial,
    set_tcp_server,
};
use super::problem::Problem;
use super::unit_words::UnitDraft;
use super::values::{listen, parse_number};
use super::words::{Word, Words, Wrong};
use super::{
    Driver, EthercatSettings, Framing, LineSettings, Port, PortKind, SerialClientSettings,
    SerialServerSettings, SerialSettings, Side, StreamFraming, TcpClientSettings, TcpServerSettings,
    UdpServerSettings,
};
use crate::scanner::POINTS;

/// A port's settings while a line is read.
pub(super) struct Draft<'a> {
    pub(super) kind: PortKind,
    /// The word that names the device or the listening address, or else the line's first: blamed when that is taken.
    pub(super) place: Word<'a>,
    /// What special unit ids mean.
    pub(super) units: UnitDraft<'a>,
    seen: u64,
    /// The words that checks over the whole line blame.
    format: Option<Word<'a>>,
    client_only: Option<Word<'a>>,
    server_only: Option<Word<'a>>,
    driver_only: Option<Word<'a>>,
    reserve: Option<Word<'a>>,
    several: Option<Word<'a>>,
    requests_only: Option<Word<'a>>,
}

/// What a port's bytes travel on.
#[derive(Clone, Copy)]
enum Medium {
    Serial,
    Tcp,
    Udp,
    Scanner,
    Ethercat,
}

const MEDIA: [(&str, Medium); 5] = [
    ("serial", Medium::Serial),
    ("tcp", Medium::Tcp),
    ("udp", Medium::Udp),
    ("scanner", Medium::Scanner),
    ("ethercat", Medium::Ethercat),
];

impl<'a> Draft<'a> {
    fn new(kind: PortKind, place: Word<'a>) -> Self {
        Self {
            kind,
            place,
            units: UnitDraft::default(),
            seen: 0,
            format: None,
            client_only: None,
            server_only: None,
            driver_only: None,
            reserve: None,
            several: None,
            requests_only: None,
        }
    }

    /// Reads a new port up to the end of the line.
    pub(super) fn create(words: &'a Words) -> Result<Self, Wrong> {
        let kind = words.take();
        match kind.keyword(&MEDIA, "serial, tcp, udp, scanner or ethercat")? {
            Medium::Serial => Self::create_serial(words),
            Medium::Tcp => Self::create_tcp(words),
            Medium::Udp => Self::create_udp_server(words),
            Medium::Scanner | Medium::Ethercat if !POINTS => Err(kind.error(Problem::NoPoints)),
            Medium::Scanner => {
                words.end()?;
                Ok(Self::new(PortKind::Scanner, kind))
            }
            Medium::Ethercat => {
                let mut draft = Self::new(PortKind::Ethercat(EthercatSettings::default()), kind);
                draft.read(words)?;
                draft.check()
            }
        }
    }

    fn create_serial(words: &'a Words) -> Result<Self, Wrong> {
        let place = words.take();
        let settings = SerialSettings {
            device: device(place)?,
            framing: Framing::Rtu,
            side: Side::Client,
            line: LineSettings::DEFAULT,
            client: SerialClientSettings::DEFAULT,
            server: SerialServerSettings::DEFAULT,
        };
        let mut draft = Self::new(PortKind::Serial(settings), place);
        draft.once(Key::Device, place)?;
        draft.read(words)?;
        for (key, expected) in
            [(Key::Framing(Framing::Rtu), "rtu or ascii"), (Key::Side(Side::Client), "client or server")]
        {
            if !draft.has(key) {
                return Err(words.take().expected(expected));
            }
        }
        let format_given = draft.has(Key::Format);
        if let PortKind::Serial(settings) = &mut draft.kind
            && settings.framing == Framing::Ascii
            && !format_given
        {
            // Serial Line 2.5.2: ASCII characters have 7 data bits.
            settings.line.data_bits = 7;
        }
        draft.check()
    }

    fn create_tcp(words: &'a Words) -> Result<Self, Wrong> {
        let sides = [
            ("server", Side::Server),
            ("slave", Side::Server),
            ("client", Side::Client),
            ("master", Side::Client),
        ];
        match words.take().keyword(&sides, "server or client")? {
            Side::Server => Self::create_tcp_server(words),
            Side::Client => Self::create_tcp_client(words),
        }
    }

    fn create_udp_server(words: &'a Words) -> Result<Self, Wrong> {
        words.take().keyword(&[("server", ()), ("slave", ())], "server")?;
        let place = words.take();
        let settings = UdpServerSettings::new(listen(place)?);
        let mut draft = Self::new(PortKind::UdpServer(settings), place);
        draft.once(Key::Listen, place)?;
        draft.read(words)?;
        draft.check()
    }

    fn create_tcp_client(words: &'a Words) -> Result<Self, Wrong> {
        let place = words.take();
        let mut draft = Self::new(PortKind::TcpClient(TcpClientSettings::new(server(place)?)), place);
        draft.once(Key::Server, place)?;
        draft.read(words)?;
        draft.check()
    }

    fn create_tcp_server(words: &'a Words) -> Result<Self, Wrong> {
        let place = words.take();
        let listen = listen(place)?;
        let mut settings = TcpServerSettings::new(listen.port);
        settings.listen = listen;
        let mut draft = Self::new(PortKind::TcpServer(settings), place);
        draft.once(Key::Listen, place)?;
        draft.read(words)?;
        let clients_given = draft.has(Key::Clients);
        if let PortKind::TcpServer(settings) = &mut draft.kind
            && !clients_given
        {
            settings.clients = settings.clients_of(settings.framing);
        }
        draft.check()
    }

    /// Reads changes of a port as it is, up to the end of the line.
    pub(super) fn edit(port: &Port, words: &'a Words) -> Result<Self, Wrong> {
        let mut draft = Self::new(port.kind.clone(), words.peek());
        draft.units = UnitDraft::new(port.units);
        // An edit without words is a line that was not finished.
        draft.word(words)?;
        draft.read(words)?;
        draft.check()
    }

    fn read(&mut self, words: &'a Words) -> Result<(), Wrong> {
        while !words.peek().is_end() {
            self.word(words)?;
        }
        Ok(())
    }

    fn has(&self, key: Key) -> bool {
        self.seen & key.bit() != 0
    }

    fn once(&mut self, key: Key, word: Word) -> Result<(), Wrong> {
        if self.has(key) {
            return Err(word.error(Problem::Twice));
        }
        self.seen |= key.bit();
        Ok(())
    }

    /// Takes one word, with its value if it has one.
    fn word(&mut self, words: &'a Words) -> Result<(), Wrong> {
        let word = words.take();
        if self.kind == PortKind::Scanner {
            return Err(word.error(Problem::NothingToSet));
        }
        if self.units.take(word, words)? {
            return Ok(());
        }
        let key = match &self.kind {
            PortKind::Serial(_) if word.text.starts_with(|first: char| first.is_ascii_digit()) => {
                if parse_number(word.text).is_some() {
                    Key::Baud
                } else {
                    Key::Format
                }
            }
            PortKind::Serial(_) => word.keyword(SERIAL_KEYS, SERIAL_EXPECTED)?,
            PortKind::TcpServer(_) => word.keyword(TCP_SERVER_KEYS, TCP_SERVER_EXPECTED)?,
            PortKind::TcpClient(_) => word.keyword(TCP_CLIENT_KEYS, TCP_CLIENT_EXPECTED)?,
            PortKind::UdpServer(_) => word.keyword(UDP_SERVER_KEYS, UDP_SERVER_EXPECTED)?,
            PortKind::Ethercat(_) => word.keyword(ETHERCAT_KEYS, ETHERCAT_EXPECTED)?,
            PortKind::Scanner => return Err(word.error(Problem::NothingToSet)),
        };
        self.once(key, word)?;
        if matches!(key, Key::InFlight | Key::Pipeline) {
            self.several = Some(word);
        }
        if matches!(key, Key::Device | Key::Listen | Key::Server) {
            self.place = words.peek();
        }
        match &mut self.kind {
            PortKind::Serial(settings) => {
                match key {
                    Key::Format | Key::Framing(_) => self.format = Some(word),
                    Key::Timeout | Key::Retries | Key::Turnaround => self.client_only = Some(word),
                    Key::StartDelay | Key::LateWindow | Key::DownAfter => self.client_only = Some(word),
                    Key::AnswerWithin | Key::ReplyDelay => self.server_only = Some(word),
                    Key::DriverBefore | Key::DriverAfter => self.driver_only = Some(word),
                    _ => {}
                }
                set_serial(settings, key, word, words)
            }
            PortKind::TcpServer(settings) => {
                if matches!(key, Key::Reserve | Key::Clients) {
                    self.reserve = Some(words.peek());
                }
                if matches!(key, Key::Idle | Key::Pipeline | Key::Lifetime) {
                    self.requests_only = Some(word);
                }
                set_tcp_server(settings, key, words)
            }
            PortKind::TcpClient(settings) => set_tcp_client(settings, key, words),
            PortKind::UdpServer(settings) => set_udp_server(settings, key, words),
            PortKind::Ethercat(settings) => set_ethercat(settings, key, words),
            PortKind::Scanner => Ok(()),
        }
    }

    /// Checks, behind the last word, what words say about each other.
    fn check(mut self) -> Result<Self, Wrong> {
        if self.kind.side() == Side::Client {
            if let Some(word) = self.units.word {
                return Err(word.error(Problem::ServerOnly));
            }
            self.units = UnitDraft::default();
        }
        match &mut self.kind {
            PortKind::Serial(settings) => {
                if settings.framing == Framing::Rtu && settings.line.data_bits != 8 {
                    return Err(self.format.unwrap_or(self.place).error(Problem::RtuDataBits));
                }
                // What the port as it is now cannot use is refused, and what it no longer can use is forgotten.
                let (other_side, problem) = match settings.side {
                    Side::Server => (self.client_only, Problem::ClientOnly),
                    Side::Client => (self.server_only, Problem::ServerOnly),
                };
                if let Some(word) = other_side {
                    return Err(word.error(problem));
                }
                match settings.side {
                    Side::Server => settings.client = SerialClientSettings::DEFAULT,
                    Side::Client => settings.server = SerialServerSettings::DEFAULT,
                }
                if settings.line.driver == Driver::Automatic {
                    if let Some(word) = self.driver_only {
                        return Err(word.error(Problem::DriverOnly));
                    }
                    let LineSettings { driver_before, driver_after, .. } = LineSettings::DEFAULT;
                    settings.line = LineSettings { driver_before, driver_after, ..settings.line };
                }
            }
            PortKind::TcpServer(settings) => {
                if settings.reserved > settings.clients {
                    let word = self.reserve.unwrap_or(self.place);
                    return Err(word.error(Problem::ReservedTooMany(settings.clients)));
                }
                if settings.framing == StreamFraming::Capture {
                    if let Some(word) = self.requests_only.or(self.units.word) {
                        return Err(word.error(Problem::NoRequests));
                    }
                    let TcpServerSettings { idle, pipeline, lifetime, .. } = TcpServerSettings::new(1);
                    (settings.idle, settings.pipeline, settings.lifetime) = (idle, pipeline, lifetime);
                    self.units = UnitDraft::default();
                }
                let several = &mut settings.pipeline;
                one_at_a_time(settings.framing, self.several, several, TcpServerSettings::new(1).pipeline)?;
            }
            PortKind::TcpClient(settings) => {
                one_at_a_time(settings.framing, self.several, &mut settings.in_flight, 1)?;
            }
            PortKind::UdpServer(_) | PortKind::Scanner | PortKind::Ethercat(_) => {}
        }
        Ok(self)
    }
}

/// RTU over TCP has no transaction ids: how many requests may be open is no setting there, and stays as it is by `default`.
fn one_at_a_time(
    framing: StreamFraming,
    word: Option<Word>,
    several: &mut u8,
    default: u8,
) -> Result<(), Wrong> {
    if framing == StreamFraming::Rtu {
        if let Some(word) = word {
            return Err(word.error(Problem::OneAtATime));
        }
        *several = default;
    }
    Ok(())
}
