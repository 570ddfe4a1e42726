//! The page: its files, compressed when the program was built (build.rs). Anybody may have them; they show nothing before a log-in.

/// A file of the page.
pub(super) struct File {
    pub(super) path: &'static str,
    pub(super) kind: &'static str,
    /// Its version, for a browser that has it.
    pub(super) tag: &'static str,
    /// Compressed by gzip, which every browser takes.
    pub(super) bytes: &'static [u8],
}

const FILES: &[File] = include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// The file at a path.
pub(super) fn find(path: &str) -> Option<&'static File> {
    FILES.iter().find(|file| file.path == path)
}
