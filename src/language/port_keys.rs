//! The keywords that all server-side ports share, and what a table of keywords is.

use crate::settings::Key;

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
