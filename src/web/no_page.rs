//! In place of the page, in images without it.

/// A file of the page; there are none.
pub(super) struct File {
    pub(super) path: &'static str,
    pub(super) kind: &'static str,
    pub(super) tag: &'static str,
    pub(super) bytes: &'static [u8],
}

/// The file at a path.
pub(super) fn find(_: &str) -> Option<&'static File> {
    None
}
