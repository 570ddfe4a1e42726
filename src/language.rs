//! The configuration language: a line changes the settings, or changes nothing and reports the wrong word.
//!
//! [`apply`] executes a line from the console or a configuration file; [`write_line`] prints the lines that recreate the
//! settings.

mod apply;
// Images without TLS have no certificates.
#[cfg(feature = "tls")]
mod certificates;
mod changed;
mod changes;
mod ethercat;
mod field;
// Other images do not tell devices apart by them.
#[cfg(feature = "dial-in")]
mod first_bytes;
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) mod forms;
// Only the web interface and publishers write JSON.
#[cfg(any(feature = "web", feature = "mqtt"))]
pub(crate) mod json;
mod line;
pub(crate) mod listed;
mod loader;
// Replaced by a stub in images without longer types, scales and periodic writes.
#[cfg_attr(not(feature = "long-values"), path = "language/no_long_words.rs")]
mod long_words;
mod mdns;
// Only images with an audit trail need the time.
#[cfg(feature = "audit")]
mod ntp;
mod option;
mod own_network;
mod point_checks;
mod point_options;
mod point_problem;
mod point_words;
mod points;
mod port_keys;
mod port_kinds;
mod port_values;
mod port_words;
mod print;
mod problem;
mod proof;
// Only images with publishers have their lines.
#[cfg(feature = "mqtt")]
mod publish;
mod review;
mod route_words;
mod servers;
#[cfg(feature = "web")] // As `forms`.
mod shape;
mod slaves;
mod syslog;
mod users;
mod values;
mod verb_help;
mod verbs;
mod words;

#[cfg(test)]
pub(crate) mod tests;

pub use self::apply::{Applied, apply};
pub use self::line::LineBuffer;
pub(crate) use self::loader::Observer;
pub use self::loader::{LoadError, Loader};
pub(crate) use self::long_words::value_type;
#[cfg(feature = "points")] // The console needs it for its commands of points.
pub(crate) use self::point_problem::PointProblem;
pub(crate) use self::point_words::{KINDS, ORDERS, ORDERS_EXPECTED};
pub use self::print::write_line;
pub(crate) use self::print::{Shown, write_shown_line};
pub(crate) use self::problem::Problem;
pub use self::problem::{LineError, WORD_BYTES_MAX, Warning};
#[cfg(feature = "web")]
pub(crate) use self::route_words::client_role;
pub(crate) use self::route_words::units as parse_units;
pub(crate) use self::users::{WithoutSecrets, user_name};
#[cfg(feature = "web")]
pub(crate) use self::values::parse_address;
pub(crate) use self::values::{medium, number, parse_number, small, time};
pub(crate) use self::verbs::{Offer, VERBS, Verb, Verbs};
pub(crate) use self::words::{Word, Words, Wrong, find_word, is_separator};
