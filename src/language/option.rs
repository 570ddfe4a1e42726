//! Printing options: a keyword with its value, and lists of prefixes.

use core::fmt::{self, Display};

use crate::settings::IpPrefix;

pub(crate) fn list(f: &mut fmt::Formatter<'_>, first: &str, prefixes: &[IpPrefix]) -> fmt::Result {
    for (nth, prefix) in prefixes.iter().enumerate() {
        write!(f, "{}{prefix}", if nth == 0 { first } else { "," })?;
    }
    Ok(())
}

pub(crate) fn option(
    f: &mut fmt::Formatter<'_>,
    keyword: &str,
    value: &dyn Display,
    print: bool,
) -> fmt::Result {
    if print { write!(f, " {keyword} {value}") } else { Ok(()) }
}
