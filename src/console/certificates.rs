//! `show certificates`: subjects and expiry dates.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::table::{Source, titled};
use crate::hal::System;

const HEAD: &str = "NAME\tFOR\tVALID-UNTIL\tSUBJECT\tISSUER\tSTATE";
/// The widths of the columns.
pub(super) const COLUMNS: Columns = &[15, 7, 11, 24, 24];

/// The row at `place`; the board supplies the certificate's details.
pub(super) fn row(
    source: &Source<'_, '_>,
    system: &dyn System,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    titled(HEAD, place, out, |nth, out| {
        let certificate = source.settings.certificates().get(nth)?;
        let begun = write!(out, "{}\t{}\t", certificate.name, certificate.purpose);
        Some(begun.and_then(|()| system.write_certificate(certificate, out).unwrap_or(Ok(()))))
    })
}
