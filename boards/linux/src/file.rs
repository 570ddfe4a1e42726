//! Text files with a size limit, replaced atomically.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

/// Longest text to read or write; far more than full settings with comments.
pub const TEXT_BYTES_MAX: usize = 256 * 1024;
/// The error for a longer one.
pub const TOO_LONG: &str = "it is longer than 262144 bytes, the most that a settings file may have";
const _: () = assert!(TEXT_BYTES_MAX == 262_144, "TOO_LONG names the number");

/// Permissions of new files.
const NEW_FILE_MODE: u32 = 0o640;
/// Most symbolic links to follow, as in the kernel.
const LINKS_MAX: usize = 40;
/// Suffix of temporary files.
const SAVING: &str = ".saving";

/// Why a file cannot be read or written.
pub type Reason = &'static str;

/// The text of the file at `path`; `None` if it does not exist. Opens regular files only: opening a device may have side effects,
/// and a pipe may never end.
pub fn read(path: &Path) -> Result<Option<Vec<u8>>, Reason> {
    read_up_to(path, TEXT_BYTES_MAX, TOO_LONG)
}

/// Reads a file with another limit; the error says if it is longer.
pub(crate) fn read_up_to(path: &Path, bytes_max: usize, too_long: Reason) -> Result<Option<Vec<u8>>, Reason> {
    let facts = match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        facts => facts.map_err(|error| reason(&error))?,
    };
    check(&facts)?;
    if facts.len() > bytes_max as u64 {
        return Err(too_long);
    }
    let flags = OFlags::NONBLOCK.bits() as i32;
    let file =
        OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(|error| reason(&error))?;
    // The file may have been replaced meanwhile.
    check(&file.metadata().map_err(|error| reason(&error))?)?;
    let mut text = Vec::new();
    file.take(bytes_max as u64 + 1).read_to_end(&mut text).map_err(|error| reason(&error))?;
    if text.len() > bytes_max { Err(too_long) } else { Ok(Some(text)) }
}

fn check(facts: &fs::Metadata) -> Result<(), Reason> {
    let kind = facts.file_type();
    match () {
        () if kind.is_file() => Ok(()),
        () if kind.is_dir() => Err("it is a folder, not a file"),
        () if kind.is_fifo() => Err("it is a pipe, not a file"),
        () if kind.is_socket() => Err("it is a socket, not a file"),
        () => Err("it is a device, not a file"),
    }
}

/// Replaces the file at `path` atomically: readers see either the old or the new text, even after a power cut. The file keeps its
/// mode and owner, and a symbolic link stays one.
pub fn replace(path: &Path, text: &[u8]) -> io::Result<()> {
    replace_like(path, path, text)
}

/// [`replace`], with the mode and the owner of the file at `like`.
pub fn replace_like(path: &Path, like: &Path, text: &[u8]) -> io::Result<()> {
    let path = resolve(path);
    let folder = folder(&path);
    let old = match fs::metadata(like) {
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        facts => Some(facts?),
    };
    // In the same folder, because a rename cannot cross file systems.
    let mut next = tempfile::Builder::new().prefix(&prefix(&path)).suffix(SAVING).tempfile_in(folder)?;
    next.write_all(text)?;
    let own = next.as_file().metadata()?;
    if let Some(old) = old.as_ref().filter(|old| (old.uid(), old.gid()) != (own.uid(), own.gid())) {
        fchown(next.as_file(), Some(old.uid()), Some(old.gid()))?;
    }
    let mode = old.map_or(NEW_FILE_MODE, |old| old.permissions().mode());
    next.as_file().set_permissions(fs::Permissions::from_mode(mode))?;
    next.as_file().sync_all()?;
    next.persist(&path)?;
    File::open(folder)?.sync_all()
}

/// Removes temporary files of an interrupted `replace` of the file at `path`. Those that cannot be removed are harmless.
pub fn sweep(path: &Path) {
    let path = resolve(path);
    let prefix = prefix(&path);
    let prefix = prefix.as_encoded_bytes();
    for entry in fs::read_dir(folder(&path)).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.as_encoded_bytes();
        let is_left = name.starts_with(prefix) && name.ends_with(SAVING.as_bytes());
        if is_left && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            log::info!("{}: removed, left by a save that was interrupted", entry.path().display());
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// Prefix of temporary files for `path`.
fn prefix(path: &Path) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(path.file_name().unwrap_or_default());
    prefix.push(".");
    prefix
}

/// The file beside the one at `path`: its name, links followed, and `suffix`.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = resolve(path).into_os_string();
    name.push(suffix);
    name.into()
}

/// The target of `path` without links, `.` and `..`, even if it does not exist.
pub fn resolve(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..LINKS_MAX {
        if let Ok(path) = fs::canonicalize(&path) {
            return path;
        }
        match fs::read_link(&path) {
            Ok(target) => path = folder(&path).join(target),
            Err(_) => break,
        }
    }
    match (fs::canonicalize(folder(&path)), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}

/// Maps a system error to a message for the user.
pub fn reason(error: &io::Error) -> Reason {
    match error.kind() {
        ErrorKind::PermissionDenied => {
            "permission denied: this user may not read it, write its folder, or leave it to its owner"
        }
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only",
        ErrorKind::StorageFull => "the disk is full",
        ErrorKind::QuotaExceeded => "the disk quota is used up",
        ErrorKind::FileTooLarge => "it would be longer than the system lets this program write",
        ErrorKind::NotFound => "there is no such folder",
        ErrorKind::NotADirectory => "what should be its folder is none",
        ErrorKind::InvalidFilename => "its name is too long",
        _ => "the system refuses, the log says why",
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn the_files_mode_and_owner_and_a_link_to_it_survive() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("real.conf"), folder.path().join("link.conf"));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        // Only root can change a file's owner.
        let given = std::os::unix::fs::chown(&file, Some(1234), Some(5678)).is_ok();
        symlink("real.conf", &link).unwrap();
        replace(&link, b"new").unwrap();
        let facts = fs::metadata(&file).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert!(link.is_symlink());
        assert_eq!(facts.permissions().mode() & 0o777, 0o640);
        if given {
            assert_eq!((facts.uid(), facts.gid()), (1234, 5678));
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "a temporary file was left");
    }

    #[test]
    fn a_link_whose_target_is_not_there_yet_leads_to_the_new_file() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target.conf"), folder.path().join("link.conf"));
        symlink("target.conf", &link).unwrap();
        replace(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&target).unwrap(), b"new");
    }

    #[test]
    fn leftovers_of_this_file_go_and_nothing_else_does() {
        let folder = tempfile::tempdir().unwrap();
        let names =
            ["mobgate.conf", ".mobgate.conf.aB3dE9.saving", ".other.conf.aB3dE9.saving", ".mobgate.conf.swp"];
        names.iter().for_each(|name| fs::write(folder.path().join(name), "text").unwrap());
        sweep(&folder.path().join("mobgate.conf"));
        let left = names.map(|name| folder.path().join(name).exists());
        assert_eq!(left, [true, false, true, true]);
    }

    #[test]
    fn nothing_but_a_regular_file_of_bounded_length_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        let made = std::process::Command::new("mkfifo").arg(&fifo).status().unwrap();
        assert!(made.success());
        assert_eq!(read(&fifo), Err("it is a pipe, not a file"));
        assert_eq!(read(folder.path()), Err("it is a folder, not a file"));
        assert_eq!(read(Path::new("/dev/zero")), Err("it is a device, not a file"));
        let file = folder.path().join("long");
        for (length, good) in [(TEXT_BYTES_MAX, true), (TEXT_BYTES_MAX + 1, false)] {
            fs::write(&file, vec![b'\n'; length]).unwrap();
            assert_eq!(read(&file).err(), (!good).then_some(TOO_LONG), "{length} bytes");
        }
        assert_eq!(read(&folder.path().join("none")), Ok(None));
    }

    #[test]
    fn a_path_is_resolved_as_far_as_it_leads() {
        let folder = tempfile::tempdir().unwrap();
        let folder = fs::canonicalize(folder.path()).unwrap();
        symlink("b", folder.join("a")).unwrap();
        let resolved = |name: &str| resolve(&folder.join(name));
        assert_eq!(resolved("a"), folder.join("b"));
        assert_eq!(resolved(".//c"), folder.join("c"));
        symlink("self", folder.join("self")).unwrap();
        assert_eq!(resolved("self"), folder.join("self"));
    }
}
