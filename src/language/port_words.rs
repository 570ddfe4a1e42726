//! The line of a port: `serial uart1 rtu client 19200 8E1 timeout 300ms`, `tcp server 502 clients 16`.
//!
//! A [`Draft`] starts from the defaults or from the existing port, reads keywords in any order, and is checked at the end of the
//! line. A setting that the port cannot use is refused rather than accepted and ignored.

use super::point_problem::PointProblem;
use super::port_keys::UNIT_KEYS;
use super::port_kinds::new_port;
use super::problem::Problem;
use super::values::parse_number;
use super::words::{Word, Words, Wrong};
// As what uses it.
#[cfg(feature = "tls")]
use crate::settings::TlsSettings;
use crate::settings::{
    Driver, Field, Framing, Key, LineSettings, Port, PortKind, Proofs, SerialClientSettings,
    SerialServerSettings, SerialSettings, Side, StreamFraming, TLS, TcpClientSettings, TcpServerSettings,
    UnitPolicy,
};

/// A port's settings while its line is parsed.
pub(crate) struct Draft<'a> {
    pub(crate) kind: PortKind,
    /// The meaning of special unit ids.
    pub(crate) units: UnitPolicy,
    /// The word with the device or the listening address, or else the first of the line: reported if that is taken.
    pub(crate) endpoint: Word<'a>,
    /// Bits of [`Key`].
    seen: u64,
    blamed: Blamed<'a>,
}

/// The last word of each sort, for errors of checks over the whole line.
#[derive(Default)]
struct Blamed<'a>([Option<Word<'a>>; SORTS]);

/// Settings that only make sense in combination with others.
#[derive(Clone, Copy)]
enum Sort {
    Format,
    OfClient,
    OfServer,
    OfDriver,
    Places,
    OfRequests,
    Several,
    OfOneServer,
    OfServers,
    Units,
    OfRtu,
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    OfTls,
}

const SORTS: usize = Sort::OfRtu as usize + 1 + TLS as usize;

impl Sort {
    const fn of(key: Key) -> Option<Self> {
        Some(match key {
            Key::Format | Key::Framing(_) => Self::Format,
            Key::Timeout | Key::Retries | Key::Turnaround => Self::OfClient,
            Key::StartDelay | Key::LateWindow | Key::DownAfter => Self::OfClient,
            Key::Proof => Self::OfRtu,
            Key::AnswerWithin | Key::ReplyDelay => Self::OfServer,
            Key::DriverBefore | Key::DriverAfter => Self::OfDriver,
            Key::Reserve | Key::Clients => Self::Places,
            Key::Idle | Key::Lifetime => Self::OfRequests,
            Key::InFlight | Key::Pipeline => Self::Several,
            #[cfg(feature = "tls")]
            Key::Certificate | Key::Trust => Self::OfTls,
            Key::Unit => Self::OfOneServer,
            Key::Sockets => Self::OfServers,
            Key::Broadcast | Key::Confirm(_) | Key::Unit255 | Key::ReservedUnits => Self::Units,
            _ => return None,
        })
    }
}

impl<'a> Blamed<'a> {
    fn get(&self, sort: Sort) -> Option<Word<'a>> {
        self.0.get(sort as usize).copied().flatten()
    }

    /// Fails if the line has a word of this sort.
    fn refuse(&self, sort: Sort, problem: Problem) -> Result<(), Wrong> {
        self.get(sort).map_or(Ok(()), |word| Err(word.error(problem)))
    }
}

impl<'a> Draft<'a> {
    /// Parses a new port up to the end of the line.
    pub(crate) fn create(words: &'a Words) -> Result<Self, Wrong> {
        let (kind, endpoint) = new_port(words)?;
        let mut seen = Key::Device.bit() | Key::Listen.bit() | Key::Server.bit();
        if matches!(&kind, PortKind::TcpClient(client) if client.has_lines()) {
            seen &= !Key::Server.bit();
        }
        let mut draft = Self::read(kind, UnitPolicy::default(), endpoint, seen, words)?;
        let end = words.take();
        let (has_clients, has_format) = (draft.has(Key::Clients), draft.has(Key::Format));
        let (has_framing, has_side) =
            (draft.has(Key::Framing(Framing::Rtu)), draft.has(Key::Side(Side::Client)));
        match &mut draft.kind {
            PortKind::Serial(_) if !has_framing => return Err(end.expected("rtu or ascii")),
            PortKind::Serial(_) if !has_side => return Err(end.expected("client or server")),
            // Serial Line 2.5.2: ASCII characters have 7 data bits.
            PortKind::Serial(settings) if settings.framing == Framing::Ascii && !has_format => {
                settings.line.data_bits = 7;
            }
            PortKind::TcpServer(settings) if !has_clients => {
                settings.clients = settings.clients_of(settings.framing);
            }
            _ => {}
        }
        draft.check()?;
        Ok(draft)
    }

    /// Parses changes of an existing port up to the end of the line.
    pub(crate) fn edit(port: &Port, words: &'a Words) -> Result<Self, Wrong> {
        let mut draft = Self::read(port.kind.clone(), port.units, words.peek(), 0, words)?;
        draft.check()?;
        Ok(draft)
    }

    /// Parses the rest of the line. A line without settings is incomplete.
    fn read(
        kind: PortKind,
        units: UnitPolicy,
        endpoint: Word<'a>,
        seen: u64,
        words: &'a Words,
    ) -> Result<Self, Wrong> {
        let mut draft = Self { kind, units, endpoint, seen, blamed: Blamed::default() };
        while draft.seen == 0 || !words.peek().is_end() {
            draft.word(words)?;
        }
        Ok(draft)
    }

    fn has(&self, key: Key) -> bool {
        self.seen & key.bit() != 0
    }

    /// Parses one keyword, with its value if it has one.
    fn word(&mut self, words: &'a Words) -> Result<(), Wrong> {
        let word = words.take();
        let key = self.key(word)?;
        if self.has(key) {
            return Err(word.error(Problem::Twice));
        }
        self.seen |= key.bit();
        if matches!(key, Key::Device | Key::Listen | Key::Server) {
            self.endpoint = words.peek();
        }
        if let Some(sort) = Sort::of(key)
            && let Some(blamed) = self.blamed.0.get_mut(sort as usize)
        {
            *blamed = Some(if matches!(sort, Sort::Places) { words.peek() } else { word });
        }
        let field = self.kind.field(key).or_else(|| self.units.field(key));
        field.map_or(Ok(()), |field: Field| field.read(word, words))
    }

    fn key(&self, word: Word) -> Result<Key, Wrong> {
        match &self.kind {
            PortKind::Scanner => return Err(word.error(Problem::Points(PointProblem::NothingToSet))),
            PortKind::Serial(_) if word.begins_with_digit() => {
                return Ok(if parse_number(word.text).is_some() { Key::Baud } else { Key::Format });
            }
            _ => {}
        }
        if !TLS && word.is("tls") {
            return Err(word.error(Problem::NoTls));
        }
        let (keys, expected) = self.kind.words();
        // As these ports.
        #[cfg(feature = "dial-in")]
        if matches!(&self.kind, PortKind::TcpClient(client) if client.listens().is_some()) && word.is("tls") {
            return Err(word.error(Problem::DialInWithTls));
        }
        let of_units = word.lookup(UNIT_KEYS).filter(|_| self.kind.has_units());
        of_units.map_or_else(|| word.keyword(keys, expected), Ok)
    }

    /// Checks combinations after the last word: a setting that the port cannot use is refused if it is in this line, and reset if
    /// it was set before.
    fn check(&mut self) -> Result<(), Wrong> {
        let Self { kind, units, blamed, .. } = self;
        if kind.side() == Side::Client {
            blamed.refuse(Sort::Units, Problem::ServerOnly)?;
            *units = UnitPolicy::default();
        }
        match kind {
            PortKind::Serial(settings) => {
                if settings.framing == Framing::Rtu && settings.line.data_bits != 8 {
                    return Err(blamed
                        .get(Sort::Format)
                        .unwrap_or(self.endpoint)
                        .error(Problem::RtuDataBits));
                }
                check_serial(settings, blamed)
            }
            PortKind::TcpServer(settings) => {
                #[cfg(feature = "tls")]
                check_tls(&mut settings.tls, blamed)?;
                if settings.reserved > settings.clients {
                    let word = blamed.get(Sort::Places).unwrap_or(self.endpoint);
                    return Err(word.error(Problem::ReservedTooMany(settings.clients)));
                }
                let TcpServerSettings { idle, pipeline, lifetime, .. } = TcpServerSettings::new(1);
                if settings.framing == StreamFraming::Capture {
                    for sort in [Sort::OfRequests, Sort::Several, Sort::Units] {
                        blamed.refuse(sort, Problem::NoRequests)?;
                    }
                    (settings.idle, settings.pipeline, settings.lifetime) = (idle, pipeline, lifetime);
                    *units = UnitPolicy::default();
                }
                one_at_a_time(settings.framing, blamed, &mut settings.pipeline, pipeline)
            }
            PortKind::TcpClient(settings) => {
                #[cfg(feature = "tls")]
                check_tls(&mut settings.tls, blamed)?;
                if settings.framing != StreamFraming::Rtu {
                    blamed.refuse(Sort::OfRtu, Problem::RtuOnly)?;
                    settings.proofs = Proofs::default();
                }
                let TcpClientSettings { sockets, .. } = TcpClientSettings::new(None);
                match settings.has_lines() {
                    false => {
                        blamed.refuse(Sort::OfServers, Problem::HasOneServer)?;
                        settings.sockets = sockets;
                    }
                    true => {
                        blamed.refuse(Sort::OfOneServer, Problem::HasManyServers)?;
                        settings.unit = None;
                    }
                }
                one_at_a_time(settings.framing, blamed, &mut settings.in_flight, 1)
            }
            // Left out of images without one of both.
            #[cfg(all(feature = "web", feature = "tls"))]
            PortKind::Http(settings) => check_tls(&mut settings.tls, blamed),
            _ => Ok(()),
        }
    }
}

/// Certificates are for TLS.
#[cfg(feature = "tls")]
fn check_tls(tls: &mut TlsSettings, blamed: &Blamed) -> Result<(), Wrong> {
    if !tls.on {
        blamed.refuse(Sort::OfTls, Problem::TlsOnly)?;
        *tls = TlsSettings::OFF;
    }
    Ok(())
}

fn check_serial(settings: &mut SerialSettings, blamed: &Blamed) -> Result<(), Wrong> {
    match settings.side {
        Side::Server => {
            blamed.refuse(Sort::OfClient, Problem::ClientOnly)?;
            blamed.refuse(Sort::OfRtu, Problem::ClientOnly)?;
            settings.client = SerialClientSettings::DEFAULT;
        }
        Side::Client => {
            blamed.refuse(Sort::OfServer, Problem::ServerOnly)?;
            settings.server = SerialServerSettings::DEFAULT;
        }
    }
    if settings.line.driver == Driver::Automatic {
        blamed.refuse(Sort::OfDriver, Problem::DriverOnly)?;
        let LineSettings { driver_before, driver_after, .. } = LineSettings::DEFAULT;
        settings.line = LineSettings { driver_before, driver_after, ..settings.line };
    }
    Ok(())
}

/// RTU over TCP has no transaction ids, so the number of requests in flight is fixed.
fn one_at_a_time(
    framing: StreamFraming,
    blamed: &Blamed,
    several: &mut u8,
    default: u8,
) -> Result<(), Wrong> {
    if framing == StreamFraming::Rtu {
        blamed.refuse(Sort::Several, Problem::OneAtATime)?;
        *several = default;
    }
    Ok(())
}
