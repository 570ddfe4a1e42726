//! Verbs: the first words of lines, with their help and completion.
//!
//! A verb is declared once, in a table: [`VERBS`] contains those of the settings; the console has its own table.

use super::changes::{self, Change, option_words};
// As its verb.
use super::{mdns, own_network, point_words, servers, slaves, users};
#[cfg(feature = "audit")]
use super::{ntp, syslog};
use crate::scanner::POINTS;
use crate::settings::{Role, SERVERS, SSH, USERS};

/// A verb of the language, and the `Run` that executes its lines.
#[derive(Clone, Copy)]
pub(crate) struct Verb<Run> {
    /// The text of `help VERB`, at most 80 columns wide; its first line is also the line in `help`. A tab separates the syntax
    /// from its meaning.
    pub(crate) help: &'static str,
    /// Completions for the word after the verb.
    pub(crate) second: &'static [Offer],
    /// Completions for later words.
    pub(crate) later: &'static [Offer],
    /// The feature missing from the image, if any; the verb is then refused.
    pub(crate) lacks: Option<Lack>,
    /// Whether the audit trail has the lines that begin with it as they were typed. Not for those of settings, nor for lines with secrets.
    pub(crate) audited: bool,
    /// The least role that may run it.
    pub(crate) role: Role,
    pub(crate) run: Run,
}

/// Verbs by name, in the order of `help`.
pub(crate) type Verbs<Run> = &'static [(&'static str, Verb<Run>)];

/// Completions for a word.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Offer {
    /// These words.
    Words(&'static [&'static str]),
    /// The words passed on by this function.
    Each(fn(&mut dyn FnMut(&'static str))),
    /// All verbs.
    Verbs,
    /// Names in the settings.
    Ports,
    Devices,
    Points,
    Users,
}

/// A part of the gateway that some images lack.
#[derive(Clone, Copy)]
pub(crate) enum Lack {
    Points,
    Servers,
    Users,
}

impl<Run: Copy> Verb<Run> {
    /// A verb without completion.
    pub(crate) const fn new(role: Role, help: &'static str, run: Run) -> Self {
        Self { help, second: &[], later: &[], lacks: None, audited: false, role, run }
    }

    /// Has its lines in the audit trail.
    pub(crate) const fn audited(self) -> Self {
        Self { audited: true, ..self }
    }

    /// Adds completions.
    pub(crate) const fn then(self, second: &'static [Offer], later: &'static [Offer]) -> Self {
        Self { second, later, ..self }
    }

    /// Replaces the verb by `absent` in images without data points, so that its text and code are left out.
    pub(crate) const fn of_points(self, absent: Run) -> Self {
        match POINTS {
            true => self,
            false => Self {
                lacks: Some(Lack::Points),
                ..Self::new(self.role, "this board has no data points", absent)
            },
        }
    }

    /// The same in images without users.
    pub(crate) const fn of_users(self, absent: Run) -> Self {
        match USERS {
            true => self,
            false => {
                Self { lacks: Some(Lack::Users), ..Self::new(self.role, "this board has no users", absent) }
            }
        }
    }
}

const PORTS: &[Offer] = &[Offer::Ports];
const PORTS_AND_OPTIONS: &[Offer] = &[Offer::Ports, Offer::Each(option_words)];
const POINTS_AND_OPTIONS: &[Offer] =
    &[Offer::Devices, Offer::Points, Offer::Words(&["local"]), Offer::Each(option_words)];
const ROUTE: &[Offer] = &[Offer::Words(&["route"])];
const NETWORK: &[Offer] = &[Offer::Each(|each| own_network::keywords().for_each(each))];
const MDNS: &[Offer] = &[Offer::Each(|each| mdns::keywords().for_each(each))];
// As its verb.
#[cfg(feature = "audit")]
const SYSLOG: &[Offer] = &[Offer::Each(|each| syslog::keywords().for_each(each))];
const USERS_OFFERED: &[Offer] = &[Offer::Users];
const ROLES_OFFERED: &[Offer] = &[Offer::Words(if SSH {
    &["role", "viewer", "operator", "engineer", "key", "ssh-ed25519"]
} else {
    &["role", "viewer", "operator", "engineer"]
})];
const THINGS: &[Offer] = &[Offer::Each(|each| changes::things().for_each(each))];

/// The text of a line of help, if the image has the feature: others have no word of it.
macro_rules! help_with {
    ($feature:literal, $name:ident: $text:literal) => {
        #[cfg(feature = $feature)]
        macro_rules! $name {
            () => {
                $text
            };
        }
        // As above.
        #[cfg(not(feature = $feature))]
        macro_rules! $name {
            () => {
                ""
            };
        }
    };
}
help_with!("web", http_help: "port NAME http server [ADDRESS:]PORT [OPTION]...\tthe web interface\n");
help_with!("web", http_options: "  http server: allow PREFIX,...|*, cleartext: log in from other machines\n");
help_with!("ssh", ssh_help: "port NAME ssh server [ADDRESS:]PORT [OPTION]...\tthe console by SSH\n");

const PORT: &str = concat!(
    "port NAME KIND ...\tadds a port, or replaces the one of that name
port NAME serial DEVICE rtu|ascii client|server [BAUD] [FORMAT] [OPTION]...
port NAME tcp|udp server [ADDRESS:]PORT [OPTION]...
port NAME tcp client ADDRESS[:PORT] [OPTION]...\tone server
port NAME tcp client [OPTION]...\tmany servers: see help server
",
    http_help!(),
    ssh_help!(),
    "port NAME scanner\tpolls the devices of data points, by the
\trules for its name
port NAME ethercat [OPTION]...\tthe gateway as an EtherCAT SubDevice
  serial:     19200 8E1 (ascii 7E1), gap T|auto, char-timeout T|auto,
              echo|no-echo, rs232|rs485|rts;
              with rs485 or rts: driver-before T, driver-after T
    client:   timeout T, retries N, turnaround T, start-delay T,
              late-window T|auto, down-after N, proof ...
    server:   answer-within T, reply-delay T
  tcp client: rtu, in-flight N, timeout T, connect-timeout T, connect-delay T,
              request-delay T, idle T, retries N, late-window T|auto,
              down-after N; one server: unit N;
              many servers: sockets N (connections at a time)
  tcp server: rtu, clients N, idle T, pipeline N, lifetime T,
              full displace|refuse, reserve N for PREFIX[,PREFIX]...,
              allow PREFIX,...|*; capture: frames for Wireshark
  udp server: pipeline N, requests N, lifetime T, allow PREFIX,...|*
  servers:    broadcast|unit-255|reserved-units rules|off|local|replace N,
              broadcast all, confirm-broadcast
",
    http_options!(),
    "  ethercat:   interface NAME (on Linux: where a MainDevice is),
              line PORT, on-loss hold|clear|stop, id N|alias,
              modules|no-modules, emergencies|no-emergencies,
              prove-outputs|no-prove-outputs
  A time T has its unit: 750us, 1.75ms, 300ms, 1s, 2m.
  port P1 serial uart1 rtu client 19200 8E1 timeout 300ms"
);

/// A verb of the settings, which engineers change.
const fn verb(help: &'static str, run: Change) -> Verb<Change> {
    Verb::new(Role::Engineer, help, run)
}

/// The verbs of the settings.
pub(crate) const VERBS: Verbs<Change> = &[
    ("port", verb(PORT, changes::port).then(PORTS, PORTS_AND_OPTIONS)),
    ("server", SERVER),
    (
        "route",
        verb(
            "route SOURCE UNITS IP TAG ...\tadds a rule; the first that matches decides
route SOURCE UNITS IP TAG DESTINATION [OPTION]...
  SOURCE: a port       UNITS: 7, 1-64 or *       IP: address, prefix or *
  TAG: * keeps the unit id, +N or -N shifts it, =N sets it
  DESTINATION: a port, local, discard (no response) or nopath (exception 0A)
  OPTION: readonly|all|functions LIST, addresses RANGE, writes RANGE,
          forbidden refuse|ignore, priority high|normal|low, urgent LIST,
          merge on|off|adjacent|near N, cache T, cut auto|on|off
  LIST: 3,4,16 or 1-6; 43/14 is the device identification alone.
  addresses refuses what names no addresses, writes refuses what may write
  anywhere (8, 21, 43, unknown); ignore answers 5, 6, 15, 16 as if done.
  merge on: identical reads that wait are one transaction; adjacent: also
  those that touch; near N: also those at most N addresses apart.
  route P502 101-132 192.168.1.0/24 -100 P3 readonly priority high",
            changes::add_route,
        )
        .then(PORTS, PORTS_AND_OPTIONS),
    ),
    (
        "device",
        verb(
            "device NAME unit N [OPTION]...\ta device that the scanner polls
  OPTION: order 0123|2301|1032|3210: of the bytes of 32-bit values;
          check: a function 8 goes before each poll; label \"TEXT\"",
            point_words::device,
        )
        .then(POINTS_AND_OPTIONS, POINTS_AND_OPTIONS)
        .of_points(changes::absent),
    ),
    (
        "point",
        verb(
            "point NAME DEVICE|local ...\tties registers or coils to a variable
point NAME DEVICE coil|discrete|input|holding ADDRESS [OPTION]...
  OPTION: count N, as u16|i16|u32|i32|f32, bit N, label \"TEXT\",
          read low|normal|high|manual|T, write auto|change|manual, multiple
point NAME local coil|discrete|input|holding ADDRESS [OPTION]...
  OPTION: count N, as TYPE, of POINT, quality ADDRESS
  ADDRESS: as it is on the wire, or Modicon's: 40001 is holding 0.
  as, of coils and discrete inputs: 16 or 32 of them are a number, the first
  its lowest bit; count is that of the bits.
  bit: one bit of a register, from 0; written by function 22, or read,
  changed and written where the device does not know that.
  read: every 5s, 1s, 200ms, or T; write auto: whenever the variable is
  written, change: when its value changes.
  of: shows the variable of another point; quality: input registers with its
  status word and age in 0.1s.
  point lamps meter coil 16 count 16 as u16
  point run meter holding 40 bit 3 write change
  point power meter holding 0 count 2 as f32 read high label \"Power\"",
            point_words::point,
        )
        .then(POINTS_AND_OPTIONS, POINTS_AND_OPTIONS)
        .of_points(changes::absent),
    ),
    (
        "slave",
        verb(
            "slave N unit U ...\ta device in the EtherCAT process image
slave N unit U [coil|discrete ADDRESS [count N]]... [OPTION]...
slave N unit U [input|holding ADDRESS [count N] [as TYPE]]... [OPTION]...
  N: from 0, in the order of their values. A MainDevice configures it, too.
  TYPE: u16, i16, u32, i32 or f32
  OPTION: order 0123|2301|1032|3210, read T (else every 1s),
          check: a function 8 goes before each poll,
          on-silence hold|clear|substitute VALUE: what its inputs become
          when it does not respond any more: they stay, are 0, or each
          register is VALUE and each bit its lowest one
  slave 0 unit 232 coil 10 count 18 holding 40010 count 4 on-silence clear",
            slaves::slave,
        )
        .of_points(changes::absent),
    ),
    (
        "edit",
        verb(
            "edit port NAME WORD...\tchanges what the words name; the rest stays
edit route N ...\tputs another rule in place of rule N",
            changes::edit,
        )
        .then(&[Offer::Words(&["port", "route"])], PORTS_AND_OPTIONS),
    ),
    (
        "insert",
        verb("insert route N ...\tputs a rule before rule N, words as in route", changes::insert_route)
            .then(ROUTE, PORTS_AND_OPTIONS),
    ),
    ("move", verb("move route N M\tmakes rule N the rule M", changes::move_route).then(ROUTE, &[])),
    (
        "delete",
        verb(
            "delete port NAME\tremoves a line of the settings
delete port NAME\ta port that no rule names
delete server PORT unit UNITS
delete route N
delete routes\tall rules
delete device NAME
delete point NAME
delete slave N
delete slaves\tall of them
delete user NAME",
            changes::delete,
        )
        .then(THINGS, PORTS_AND_OPTIONS),
    ),
    (
        "network",
        verb(
            "network dhcp|address ...\tthe board's own IP address; acts at once
network dhcp [name NAME]\ta DHCP server gives it
network address ADDRESS/PREFIX [gateway ADDRESS] [dns ADDRESS]
\tdns: looks up the names of servers
  network address 192.168.1.5/24",
            changes::network,
        )
        .then(NETWORK, NETWORK),
    ),
    (
        "mdns",
        verb(
            "mdns on [name NAME]\tannounces the TCP servers on the network
\t(multicast DNS, _modbus._tcp), under NAME or
\tthe name of network dhcp or of the machine
mdns off\tannounces nothing",
            changes::mdns_line,
        )
        .then(MDNS, MDNS),
    ),
    // Not `of_users`, whose refusal takes room in images without it.
    #[cfg(feature = "audit")]
    (
        "syslog",
        verb(
            "syslog [udp|tcp] ADDRESS[:PORT]\tsends the audit trail to a syslog server
\t(RFC 5424), by UDP and to port 514 unless given;
\tADDRESS may be a name
syslog off\tsends it nowhere
  syslog tcp 192.168.1.9:601",
            syslog::syslog,
        )
        .then(SYSLOG, &[]),
    ),
    // As above.
    #[cfg(feature = "audit")]
    (
        "ntp",
        verb(
            "ntp ADDRESS[:PORT]\tasks an NTP server for the time (SNTP),
\twhich `show version` and the audit trail tell
ntp off\tasks nobody
  ntp 192.168.1.1",
            ntp::ntp,
        )
        .then(&[Offer::Words(&["off"])], &[]),
    ),
    ("user", verb(USER_HELP, users::user).then(USERS_OFFERED, ROLES_OFFERED).of_users(changes::absent)),
];

const USER_HELP: &str = if SSH {
    "user NAME role viewer|operator|engineer\twho may log in
user NAME key ssh-ed25519 KEY\ta public key for SSH; delete user NAME key ...
  viewer: shows; operator: also reads and writes devices; engineer: all.
  The command password NAME sets the password; until then NAME can log in
  with a key only.
  The local console needs none, and its users are engineers.
  user anna role operator"
} else {
    "user NAME role viewer|operator|engineer\twho may log in
  viewer: shows; operator: also reads and writes devices; engineer: all.
  The command password NAME sets the password; until then NAME cannot log in.
  The local console needs none, and its users are engineers.
  user anna role operator"
};

const SERVER: Verb<Change> = match SERVERS {
    true => verb(
        "server PORT unit UNITS ...\ta server behind a tcp client without address
server PORT unit UNITS at ADDRESS[:PORT] [tag TAG]
  UNITS: 7 or 1-5, for which it is asked. A unit belongs to one server of a
  port; one of no server gets 0A.
  ADDRESS: 192.168.1.20, or a name, which is looked up whenever a connection
  is opened. PORT: 502 unless given.
  TAG: the unit id at the server: =1, or +N or -N for several, as in route.
  server plant unit 1-5 at 192.168.1.20:502
  server plant unit 7 at meter.example tag =1",
        servers::server,
    ),
    false => Verb {
        lacks: Some(Lack::Servers),
        ..verb("on this board a tcp client has one server", changes::absent)
    },
}
.then(PORTS, PORTS_AND_OPTIONS);
