//! The last saved texts with author and time, in one file beside that of the settings.
//!
//! Each text has a header line with its length and a checksum, so that a corrupt version is skipped without affecting others. The file
//! is replaced as a whole, like that of the settings.

use std::collections::HashMap;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};

use crc::{CRC_32_ISO_HDLC, Crc};
use jiff::Timestamp;

use crate::file::{self, Reason, TEXT_BYTES_MAX};

/// Versions that are kept.
const VERSIONS_MAX: usize = 10;
/// Longest header line.
const HEAD_BYTES_MAX: usize = 256;
/// Longest file.
const FILE_BYTES_MAX: usize = VERSIONS_MAX * (HEAD_BYTES_MAX + TEXT_BYTES_MAX);
const TOO_LONG: Reason = "it is longer than all versions together can be";

/// What a header line begins with.
const HEAD: &str = "#@ saved ";
/// The author, in the audit trail, of edits made outside this program.
const BY_OTHERS: &str = "system";

const CHECK: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A text that was saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Version {
    /// When, how many lines it added and took away, and who; with tabs between.
    pub(crate) what: String,
    pub(crate) text: Vec<u8>,
}

/// The versions, from the last one on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Versions(Vec<Version>);

impl Versions {
    /// Those of the settings in the file at `settings`. What is corrupt is named in the log, and skipped.
    pub(crate) fn read(settings: &Path) -> Self {
        let path = place(settings);
        let (versions, is_corrupt) = match file::read_up_to(&path, FILE_BYTES_MAX, TOO_LONG) {
            Ok(text) => Self::parse(&text.unwrap_or_default()),
            Err(reason) => {
                log::warn!("{}: {reason}; no version of the settings is known", path.display());
                return Self::default();
            }
        };
        if is_corrupt {
            log::warn!("{}: it is corrupt; the versions that are not are there", path.display());
        }
        versions
    }

    /// The version `nth` from the last one.
    pub(crate) fn get(&self, nth: usize) -> Option<&Version> {
        self.0.get(nth)
    }

    /// Keeps the text `old`, which is about to be replaced in the file at `settings`, if somebody has edited it since the last save.
    pub(crate) fn note(&mut self, settings: &Path, old: &[u8]) {
        if !old.is_empty() && self.get(0).is_none_or(|last| last.text != old) {
            let at = settings.metadata().and_then(|facts| facts.modified()).ok();
            let at = at.and_then(|at| Timestamp::try_from(at).ok()).unwrap_or_else(Timestamp::now);
            self.add(settings, at, BY_OTHERS, old);
        }
    }

    /// Adds `text`, saved by `who`. The settings are good without it: a failure is only logged.
    pub(crate) fn add(&mut self, settings: &Path, at: Timestamp, who: &str, text: &[u8]) {
        if self.get(0).is_some_and(|last| last.text == text) {
            return;
        }
        let (more, fewer) = changed(self.get(0).map_or(b"", |last| &last.text), text);
        let what = format!("{at:.0}\t+{more} -{fewer}\t{who}");
        self.0.insert(0, Version { what, text: text.to_owned() });
        self.0.truncate(VERSIONS_MAX);
        let path = place(settings);
        if let Err(error) = file::replace_like(&path, settings, &self.print()) {
            log::warn!("{}: {error}; this version is not kept", path.display());
        }
    }

    fn print(&self) -> Vec<u8> {
        let print = |version: &Version| [version.head().as_bytes(), &version.text].concat();
        self.0.iter().flat_map(print).collect()
    }

    /// The versions in `file`, and whether there is something else.
    fn parse(file: &[u8]) -> (Self, bool) {
        let (mut rest, mut versions, mut is_corrupt) = (file, Vec::new(), false);
        while !rest.is_empty() {
            match Version::parse(rest) {
                Some((version, behind)) => {
                    versions.push(version);
                    rest = behind;
                }
                None => {
                    is_corrupt = true;
                    let next = rest.windows(HEAD.len()).skip(1).position(|at| at == HEAD.as_bytes());
                    rest = next.map_or(b"", |next| &rest[next + 1..]);
                }
            }
        }
        versions.truncate(VERSIONS_MAX);
        (Self(versions), is_corrupt)
    }
}

impl Version {
    /// The header line.
    fn head(&self) -> String {
        let Self { what, text } = self;
        let mut head = format!("{HEAD}{what}\t{}\t", text.len());
        let mut sum = CHECK.digest();
        sum.update(head.as_bytes());
        sum.update(text);
        // Writing to a `String` cannot fail.
        let _ = writeln!(head, "{:08x}", sum.finalize());
        head
    }

    /// The version at the beginning of `file`, and the rest.
    fn parse(file: &[u8]) -> Option<(Self, &[u8])> {
        let end = file.iter().take(HEAD_BYTES_MAX).position(|byte| *byte == b'\n')?;
        let head = std::str::from_utf8(&file[..=end]).ok()?;
        let (what, rest) = head.strip_prefix(HEAD)?.rsplit_once('\t')?.0.rsplit_once('\t')?;
        let (text, behind) = file[end + 1..].split_at_checked(rest.parse().ok()?)?;
        let version = Self { what: what.to_owned(), text: text.to_owned() };
        (version.head() == head).then_some((version, behind))
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)
    }
}

/// The file of the versions of `settings`.
fn place(settings: &Path) -> PathBuf {
    file::beside(settings, ".versions")
}

/// How many lines `new` adds to `old` and removes from it; alignment blanks do not count.
fn changed(old: &[u8], new: &[u8]) -> (i64, i64) {
    let (old, new) = (String::from_utf8_lossy(old), String::from_utf8_lossy(new));
    let mut counts = HashMap::<Vec<&str>, i64>::new();
    for (text, step) in [(&old, -1), (&new, 1)] {
        let lines = text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        lines.filter(|line| !line.is_empty()).for_each(|line| *counts.entry(line).or_default() += step);
    }
    let sum = |sign: i64| counts.values().map(|count| (count * sign).max(0)).sum::<i64>();
    (sum(1), sum(-1))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A folder, and the path of settings in it that were saved `count` times.
    fn saved(count: usize) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mobgate.conf");
        fs::write(&path, "").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        for n in 1..=count {
            let text = format!("port P1 tcp server {n}\n# {HEAD}of a user\n{HEAD}forged\t3\t0\n\n");
            Versions::read(&path).add(&path, Timestamp::UNIX_EPOCH, &format!("anna{n}@::1"), text.as_bytes());
        }
        (folder, path)
    }

    fn names(versions: &Versions) -> Vec<String> {
        let whole = versions.0.iter().map(ToString::to_string);
        whole.map(|what| what.rsplit_once('\t').unwrap().1.to_owned()).collect()
    }

    #[test]
    fn the_last_ten_are_kept_with_who_and_when_as_secret_as_the_settings() {
        let (_folder, path) = saved(12);
        let versions = Versions::read(&path);
        let expected: Vec<_> = (3..=12).rev().map(|n| format!("anna{n}@::1")).collect();
        assert_eq!(names(&versions), expected);
        assert_eq!(versions.get(0).unwrap().what, "1970-01-01T00:00:00Z\t+1 -1\tanna12@::1");
        assert!(versions.get(9).unwrap().text.starts_with(b"port P1 tcp server 3\n"));
        assert_eq!(fs::metadata(place(&path)).unwrap().permissions().mode() & 0o777, 0o600);
    }

    #[test]
    fn a_text_that_others_wrote_is_noted_before_it_is_replaced_and_the_same_text_once() {
        let (_folder, path) = saved(1);
        let mut versions = Versions::read(&path);
        versions.note(&path, b"# by hand\n");
        versions.note(&path, b"# by hand\n");
        versions.add(&path, Timestamp::UNIX_EPOCH, "bert", b"# by hand\n");
        assert_eq!(names(&Versions::read(&path)), ["system", "anna1@::1"]);
    }

    #[test]
    fn a_corrupt_byte_costs_one_version_at_most() {
        let (_folder, path) = saved(3);
        let whole = Versions::read(&path);
        let file = fs::read(place(&path)).unwrap();
        for at in 0..file.len() {
            for flip in [1, 0x80, file[at] ^ b'\n'] {
                let mut file = file.clone();
                file[at] ^= flip;
                let (versions, is_corrupt) = Versions::parse(&file);
                assert!(flip == 0 || is_corrupt, "byte {at}");
                assert!(versions.0.len() >= 2, "byte {at}: {versions:?}");
                assert!(versions.0.iter().all(|version| whole.0.contains(version)), "byte {at}");
            }
        }
        for length in 0..file.len() {
            let (versions, _) = Versions::parse(&file[..length]);
            assert_eq!(versions.0, whole.0[..versions.0.len()], "cut at {length}");
        }
    }

    #[test]
    fn what_is_no_file_of_versions_is_none_and_the_next_save_replaces_it() {
        let (_folder, path) = saved(0);
        for wrong in [&b"\0\xff"[..], b"", b"port P1 tcp server 502\n", &[b'\n'; FILE_BYTES_MAX + 1]] {
            fs::write(place(&path), wrong).unwrap();
            assert_eq!(Versions::read(&path), Versions::default());
        }
        Versions::read(&path).add(&path, Timestamp::UNIX_EPOCH, "anna", b"# good\n");
        assert_eq!(names(&Versions::read(&path)), ["anna"]);
        fs::remove_file(place(&path)).unwrap();
        fs::create_dir(place(&path)).unwrap();
        let mut versions = Versions::read(&path);
        versions.add(&path, Timestamp::UNIX_EPOCH, "anna", b"# good\n");
        assert_eq!(Versions::read(&path), Versions::default(), "a folder stays what it is");
    }
}
