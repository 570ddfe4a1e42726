//! Whole sessions, typed at a terminal or piped in, against a gateway whose ports nobody runs.

mod board;
#[cfg(feature = "candidate")] // Only a gateway that was built with one has it.
mod candidate;
mod ends;
mod help;
#[cfg(feature = "users")]
mod network;
#[cfg(feature = "points")]
mod points;
mod saving;
mod store;
mod terminal;
#[cfg(feature = "users")]
mod users;

extern crate std;
use std::boxed::Box;
use std::cell::Cell;
use std::convert::Infallible;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use embassy_futures::block_on;
use embedded_io_async::{ErrorType, Read, Write};

// The clock behind `Instant`.
use mobgate_clock as _;

use self::store::Memory;
use super::*;
use crate::frame::{FramePool, Slot};
use crate::gateway::audit::AuditMemory;
use crate::gateway::{Candidate, Connection, Ports};
use crate::hal::{NetworkState, NoUpdate};
use crate::modbus::Exception;
use crate::scanner::ScannerState;
use crate::settings::{LINE_BYTES_MAX, MQTT, OwnNetwork, PasswordHash, PortId, StaticAddress, TLS, USERS};
use crate::stats::{Event, LogEntry, Outcome};

/// Fits the password of [`Bench`].
const HASH: &str =
    "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";

/// Gives what was typed in pieces of one size, and keeps what is printed.
struct Stream<'t> {
    typed: &'t [u8],
    piece: usize,
    printed: Vec<u8>,
}

impl ErrorType for Stream<'_> {
    type Error = Infallible;
}

impl Read for Stream<'_> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        let count = self.typed.len().min(into.len()).min(self.piece);
        into[..count].copy_from_slice(&self.typed[..count]);
        self.typed = &self.typed[count..];
        Ok(count)
    }
}

impl Write for Stream<'_> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        // Short writes must not lose anything.
        let count = from.len().min(7);
        self.printed.extend_from_slice(&from[..count]);
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[derive(Default)]
struct Bench {
    reboots: Cell<u32>,
    network: Option<NetworkState>,
    lines: &'static [&'static str],
    events: &'static [&'static str],
}

impl System for Bench {
    fn name(&self) -> &str {
        "bench"
    }

    fn network(&self) -> Option<NetworkState> {
        self.network
    }

    fn write_serial_line(&self, n: usize, out: &mut dyn std::fmt::Write) -> Option<std::fmt::Result> {
        self.lines.get(n).map(|line| out.write_str(line))
    }

    fn write_event(&self, n: usize, out: &mut dyn std::fmt::Write) -> Option<std::fmt::Result> {
        self.events.get(n).map(|event| out.write_str(event))
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        hash == Some(HASH) && password == "let me in"
    }

    async fn hash_password(&self, _: &str) -> Option<PasswordHash> {
        HASH.try_into().ok()
    }

    fn reboot(&self) {
        self.reboots.set(self.reboots.get() + 1);
    }
}

/// No new firmware.
fn none() -> NoUpdate {
    NoUpdate("this is a bench")
}

const CONNECTIONS: usize = 40;

/// A gateway of five port places. All that it is made of is there until the tests end.
fn new_gateway() -> Gateway<'static> {
    gateway_with(kept(AuditMemory::new()))
}

/// The same with this memory for the audit trail.
fn gateway_with(audit: &'static AuditMemory) -> Gateway<'static> {
    let slots = kept([const { Slot::new() }; CONNECTIONS + 8]);
    let connections = kept([const { Connection::new() }; CONNECTIONS]);
    let pool = kept(FramePool::new(slots, CONNECTIONS + 5));
    let (scanner, candidate) = (kept(ScannerState::new()), kept(Candidate::new()));
    let gateway = Gateway::new(pool, kept(Ports::<5>::new()), connections).with_scanner(scanner);
    gateway.with_candidate(candidate).with_audit(audit)
}

/// What is there until the tests end.
fn kept<T>(value: T) -> &'static T {
    Box::leak(Box::new(value))
}

/// What a session on `board` prints, and how it ends.
fn session_on(
    gateway: &Gateway<'_>,
    board: &Bench,
    store: &mut Memory,
    mode: Mode,
    (typed, piece): (&[u8], usize),
) -> (String, Ended) {
    let mut stream = Stream { typed, piece, printed: Vec::new() };
    let ended = block_on(run(gateway, &mut stream, store, &mut none(), board, mode)).unwrap();
    (String::from_utf8(stream.printed).unwrap(), ended)
}

fn session(gateway: &Gateway<'_>, store: &mut Memory, mode: Mode, typed: &str, piece: usize) -> String {
    session_on(gateway, &Bench::default(), store, mode, (typed.as_bytes(), piece)).0
}

/// What a session on `board` with piped input prints.
fn pipe_on(gateway: &Gateway<'_>, board: &Bench, typed: &[u8]) -> String {
    session_on(gateway, board, &mut Memory::default(), Mode::Plain, (typed, 64)).0
}

/// What a session with piped input prints.
fn pipe(gateway: &Gateway<'_>, text: &str) -> String {
    session(gateway, &mut Memory::default(), Mode::Plain, text, 50)
}

/// What a session at a terminal prints, without the redrawing of lines.
fn typed(gateway: &Gateway<'_>, keys: &str) -> String {
    session(gateway, &mut Memory::default(), Mode::Echo, keys, 3)
}

const SETTINGS: &str = "\
port P1   serial /dev/ttyUSB0 rtu client 9600 8N1 timeout 300ms
port P2   serial uart2 rtu server 19200 8E1
port P502 tcp server 502 clients 16
route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high
route P502 1-64    * * P1
route P1   1-64    * * P502
";

#[test]
fn piped_settings_are_applied_without_a_word_and_shown_as_lines_that_make_them() {
    let gateway = &new_gateway();
    assert_eq!(pipe(gateway, SETTINGS), "");
    let shown = pipe(gateway, "show config\n");
    assert_eq!(
        shown,
        "port P1   serial /dev/ttyUSB0 rtu client 9600 8N1 timeout 300ms\n\
         port P2   serial uart2 rtu server 19200 8E1\n\
         port P502 tcp server 502\n\
         route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high\n\
         route P502 1-64    * * P1\n\
         route P1   1-64    * * P502\n"
    );
    assert_eq!(pipe(gateway, "delete routes\ndelete port P1\ndelete port P2\ndelete port P502"), "");
    assert_eq!(pipe(gateway, &shown), "");
    assert_eq!(pipe(gateway, "show config"), shown);
}

#[test]
fn an_error_in_piped_input_names_its_line_and_the_rest_goes_on() {
    let gateway = &new_gateway();
    let printed = pipe(
        gateway,
        "# settings\r\nprot P1\r\nport P1 serial uart1 rtu client 81E\nport P1 serial uart1 rtu client\n\
         shwo ports\nshow prots\nshow ports now\n",
    );
    let audit = if USERS { "audit, " } else { "" };
    let certificates = if TLS { "certificates, " } else { "" };
    let publishers = if MQTT { "publishers, " } else { "" };
    let candidate = if cfg!(feature = "candidate") { "candidate, " } else { "" };
    let expected = format!(
        "error: line 2, column 1: \"prot\": expected a command (see help); did you mean port?\n\
         error: line 3, column 33: \"81E\": expected a format such as 8E1, 7E1, 8N1 or 8N2\n\
         error: line 5, column 1: \"shwo\": expected a command (see help); did you mean show?\n\
         error: line 6, column 6: \"prots\": expected ports, servers, routes, units, clients, stats, points, \
         devices, registers, users, {audit}{certificates}{publishers}config, {candidate}network, lines, image, log, frames, version or update; did you mean ports?\n\
         error: line 7, column 12: \"now\": expected the end of the line\n"
    );
    assert_eq!(printed, expected);
    assert_eq!(pipe(gateway, "show config"), "port P1 serial uart1 rtu client 19200 8E1\n");
}

#[test]
fn ports_and_rules_are_shown_as_tables_with_a_header() {
    let gateway = &new_gateway();
    pipe(gateway, SETTINGS);
    assert_eq!(
        pipe(gateway, "show ports"),
        "PORT            ROLE         WHERE        LINE         STATUS\n\
         P1              rtu client   /dev/ttyUSB0 9600 8N1     off\n\
         P2              rtu server   uart2        19200 8E1    off\n\
         P502            tcp server   502                       off\n"
    );
    let rows = pipe(gateway, "show routes");
    let rows: Vec<&str> = rows.lines().collect();
    assert_eq!(rows.len(), 4);
    assert_eq!(rows[0], " NO SOURCE          UNITS   IP                 TAG  DESTINATION     KIND    POLICY");
    assert_eq!(
        rows[1],
        "  1 P502            101-132 192.168.1.0/24     -100 P1              rule    readonly priority high"
    );
    assert_eq!(rows[3], "  3 P1              1-64    *                  *    P502            implied all");
}

/// Logs that unit 7 did not respond.
fn push_exception(gateway: &Gateway<'_>, at: embassy_time::Instant) {
    gateway.log().push(LogEntry {
        at,
        source: PortId(2),
        destination: Some(PortId(0)),
        unit: 107,
        target: 7,
        function: 3,
        outcome: Outcome::Exception(Exception::GATEWAY_NO_RESPONSE),
        took_us: 300_500,
    });
}

#[test]
fn counters_units_and_transactions_are_shown_and_cleared() {
    let gateway = &new_gateway();
    pipe(gateway, SETTINGS);
    let state = gateway.port_state(PortId(0)).unwrap();
    state.stats.count(Event::Request);
    state.stats.count(Event::Timeout);
    let now = embassy_time::Instant::now();
    state.units(|units| units.asked(7));
    state.units(|units| units.timed_out(7, now, 3));
    push_exception(gateway, now);
    let stats = pipe(gateway, "show stats");
    assert!(stats.starts_with("PORT            EVENT               COUNT PER-MINUTE\n"), "{stats}");
    assert!(stats.contains("P1              requests                1 "), "{stats}");
    assert!(stats.contains("P1              timeouts                1 "), "{stats}");
    let free = format!("-               frames-free    {:>10}\n", CONNECTIONS + 8);
    assert!(stats.contains(&free), "{stats}");
    let units = pipe(gateway, "show units");
    assert_eq!(
        units.lines().nth(1),
        Some(
            "P1                 7 up                   1          0          0          1         -         -         - \
             1 silent"
        )
    );
    let log = pipe(gateway, "show log");
    assert_eq!(
        log.lines().nth(1),
        Some(
            "       0s P502             107 P1                   7        3    300.5ms \
             gateway target device failed to respond (0Bh)"
        )
    );
    assert_eq!(pipe(gateway, "clear log\nclear stats\n"), "");
    assert_eq!(pipe(gateway, "show log").lines().count(), 1);
    assert!(!pipe(gateway, "show stats").contains("timeouts"));
    assert!(!pipe(gateway, "show units").contains("silent"));
}

#[test]
fn saved_settings_come_back_and_a_fault_in_them_changes_nothing() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut pipe = |text| session(gateway, &mut store, Mode::Plain, text, 11);
    assert_eq!(pipe("load"), "error: line 1, nothing is saved\n");
    assert_eq!(pipe(SETTINGS), "");
    assert_eq!(pipe("save\ndelete routes\nload\n"), "saved\nloaded\n");
    assert_eq!(pipe("show config").lines().count(), 6);
    store.saved.extend_from_slice(b"route P9 * * * P1\n");
    let mut pipe = |text| session(gateway, &mut store, Mode::Plain, text, 11);
    assert_eq!(
        pipe("delete routes\nload\n"),
        "error: line 2, saved settings: line 7, column 7: \"P9\": there is no port of this name\n"
    );
    assert_eq!(pipe("show config").lines().count(), 3);
    store.absent = true;
    let printed = session(gateway, &mut store, Mode::Plain, "save", 11);
    assert_eq!(printed, "error: line 1, there is no place to save settings: start with --config FILE\n");
}

#[test]
fn a_warning_is_said_and_the_line_applies() {
    let gateway = &new_gateway();
    let printed = pipe(gateway, "port P1 serial uart1 rtu client 9600 gap 1ms\nshow config\n");
    assert_eq!(
        printed,
        "warning: port P1: gap 1ms is below the specification's 4.011ms\n\
         port P1 serial uart1 rtu client 9600 8E1 gap 1ms\n"
    );
}

#[test]
fn lines_that_are_too_long_or_no_text_are_refused_as_a_whole() {
    let gateway = &new_gateway();
    let long = "delete ".to_string() + &"x".repeat(10_000) + "\nshow version\n";
    let printed = pipe(gateway, &long);
    let error =
        format!("column {}: end of line: the line is longer than {LINE_BYTES_MAX} bytes", LINE_BYTES_MAX + 1);
    assert!(printed.starts_with(&format!("error: line 1, {error}\nmobgate ")), "{printed}");
    let printed = typed(gateway, &long);
    assert!(printed.contains(&format!("\r\nerror: {error}")), "{printed}");
    let printed = pipe_on(gateway, &Bench::default(), b"show \xff\n");
    assert_eq!(printed, "error: line 1, column 6: end of line: the line is not text (UTF-8)\n");
}

proptest::proptest! {
    #[test]
    fn random_bytes_never_panic_in_either_mode(
        bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..600)
    ) {
        let gateway = &new_gateway();
        for mode in [Mode::Echo, Mode::Plain] {
            let mut stream = Stream { typed: &bytes, piece: 64, printed: Vec::new() };
            block_on(run(gateway, &mut stream, &mut Memory::default(), &mut none(), &Bench::default(), mode)).unwrap();
        }
    }
}

#[test]
fn a_session_fits_into_twenty_five_kilobytes() {
    let gateway = &new_gateway();
    let mut stream = Stream { typed: b"", piece: 1, printed: Vec::new() };
    let mut store = Memory::default();
    let system = Bench::default();
    let mut update = none();
    let future = run(gateway, &mut stream, &mut store, &mut update, &system, Mode::Echo);
    let bytes = size_of_val(&future);
    assert!(bytes < 25 * 1024, "{bytes}");
}
