//! Verbs: the first words of lines, with their help and completion.
//!
//! A verb is declared once, in a table: [`VERBS`] contains those of the settings; the console has its own table.

use super::changes::{self, Change, option_words};
// As its verb.
#[cfg(feature = "tls")]
use super::certificates;
// As its verb.
#[cfg(feature = "mqtt")]
use super::publish;
use super::{mdns, own_network, point_words, servers, slaves, users, verb_help};
// As its verb.
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
    // Images without TLS have none.
    #[cfg(feature = "tls")]
    Certificates,
    // As their verb.
    #[cfg(feature = "mqtt")]
    Publishers,
}

/// A part of the gateway that some images lack.
#[derive(Clone, Copy)]
pub(crate) enum Lack {
    Points,
    Servers,
    Users,
    // Those with TLS do not lack it.
    #[cfg_attr(feature = "tls", allow(dead_code))]
    Tls,
    // Likewise.
    #[cfg_attr(feature = "mqtt", allow(dead_code))]
    Mqtt,
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

    /// Replaces the verb by `absent` in images without users.
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

/// A verb of the settings, which engineers change.
const fn verb(help: &'static str, run: Change) -> Verb<Change> {
    Verb::new(Role::Engineer, help, run)
}

/// The verbs of the settings.
pub(crate) const VERBS: Verbs<Change> = &[
    ("port", verb(verb_help::PORT, changes::port).then(PORTS, PORTS_AND_OPTIONS)),
    ("server", SERVER),
    ("route", verb(verb_help::ROUTE, changes::add_route).then(PORTS, PORTS_AND_OPTIONS)),
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
        verb(verb_help::POINT, point_words::point)
            .then(POINTS_AND_OPTIONS, POINTS_AND_OPTIONS)
            .of_points(changes::absent),
    ),
    ("slave", verb(verb_help::SLAVE, slaves::slave).of_points(changes::absent)),
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
    ("delete", verb(verb_help::DELETE, changes::delete).then(THINGS, PORTS_AND_OPTIONS)),
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
    // Not `of_users`: its refusal would take flash in images without the feature.
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
    ("certificate", CERTIFICATE),
    ("publish", PUBLISH),
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

#[cfg(not(feature = "tls"))] // Its lines are refused.
const CERTIFICATE: Verb<Change> =
    Verb { lacks: Some(Lack::Tls), ..verb("this board has no TLS", changes::absent) };
#[cfg(feature = "tls")]
const CERTIFICATE: Verb<Change> = verb(
    "certificate NAME own|clients|servers FILE ...\tcertificates of ports with tls
certificate NAME own FILE key FILE\tthe gateway's own, and its private key
certificate NAME clients FILE [revoked FILE]\tauthorities of clients
certificate NAME servers FILE [revoked FILE]\tauthorities of servers, or the
\tcertificate of a server itself
  The files are PEM, with paths from the root; revoked: a CRL. They are read
  again when they change. show certificates: whose they are, and until when.
  certificate gateway own /etc/mobgate/tls/gw.pem key /etc/mobgate/tls/gw.key
  certificate plant clients /etc/mobgate/tls/plant.pem
  port secure tcp server 802 tls",
    certificates::certificate,
)
.then(&[Offer::Certificates], &[Offer::Each(|each| certificates::keywords().for_each(each))]);

#[cfg(not(feature = "mqtt"))] // Its lines are refused.
const PUBLISH: Verb<Change> =
    Verb { lacks: Some(Lack::Mqtt), ..verb("this board publishes nothing", changes::absent) };
#[cfg(feature = "mqtt")]
const PUBLISH: Verb<Change> = verb(verb_help::PUBLISH, publish::publish)
    .then(&[Offer::Publishers], &[Offer::Each(|each| publish::keywords().for_each(each))]);

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
