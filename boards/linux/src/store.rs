//! The settings' text in a file; saving keeps its comments and order.

use std::cell::RefCell;
use std::fmt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use jiff::Timestamp;
use mobgate::hal::{Store, StoreError};

use crate::file::{self, TEXT_BYTES_MAX};
use crate::merge::merge;
use crate::versions::Versions;
use crate::worker;

/// The configuration file; `None` if the program was started without one. Clones share the file.
#[derive(Debug, Clone)]
pub struct FileStore {
    path: Option<PathBuf>,
    /// The text read last.
    read: Vec<u8>,
    /// The version being written.
    next: String,
    /// Overwrite the file even if it was edited.
    whatever: bool,
    /// The author of that version.
    who: String,
    /// The versions as they were when the first one was asked for, and the text of one.
    versions: Versions,
    version: Vec<u8>,
    /// The file's text when last applied or saved; any other text is an outside edit.
    known: Rc<RefCell<Option<Vec<u8>>>>,
}

impl FileStore {
    /// Stores the settings in the file at `path`. Removes temporary files of an interrupted save.
    pub fn new(path: Option<PathBuf>) -> Self {
        if let Some(path) = &path {
            file::sweep(path);
        }
        Self::untouched(path)
    }

    /// Opens the file at `path` for reading only.
    pub fn untouched(path: Option<PathBuf>) -> Self {
        Self {
            path,
            read: Vec::new(),
            next: String::new(),
            whatever: false,
            who: String::new(),
            versions: Versions::default(),
            version: Vec::new(),
            known: Rc::default(),
        }
    }

    /// The path of the file.
    pub fn path(&self) -> Result<&Path, StoreError> {
        self.path.as_deref().ok_or(StoreError::Absent("start with --config FILE"))
    }

    /// Writes the settings in `text` to a file beside this one, merged into the text last applied or saved, as a save would do.
    /// Returns its path.
    pub fn keep_aside(&self, text: &str) -> Result<PathBuf, String> {
        let path = self.path().map_err(|error| error.to_string())?;
        let aside = file::beside(path, ".unsaved");
        let known = self.known.borrow().clone().unwrap_or_default();
        let text = merge(&String::from_utf8_lossy(&known), text);
        let kept = file::replace_like(&aside, path, text.as_bytes());
        kept.map_err(|error| format!("{}: {error}", aside.display())).map(|()| aside)
    }
}

impl Store for FileStore {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        if offset == 0 {
            let text = file::read(self.path()?).map_err(StoreError::Refused)?;
            self.read = text.unwrap_or_default();
        }
        let rest = self.read.get(offset..).unwrap_or_default();
        Ok(copy(rest, into))
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        self.path()?;
        if self.next.len() + text.len() > TEXT_BYTES_MAX {
            self.next.clear();
            return Err(StoreError::Full(TEXT_BYTES_MAX));
        }
        self.next.push_str(&String::from_utf8_lossy(text));
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        let path = self.path()?.to_owned();
        let (text, whatever) = (std::mem::take(&mut self.next), std::mem::take(&mut self.whatever));
        let known = self.known.borrow().clone();
        let is_known = move |old: &[u8]| whatever || known.is_some_and(|known| known == old);
        // fsync may be slow, and the executor must keep serving the lines.
        let who = std::mem::take(&mut self.who);
        let written = worker::once(move || write(&path, &text, &who, is_known)).await;
        let written = written.map_err(|error| StoreError::Refused(file::reason(&error)))??;
        *self.known.borrow_mut() = Some(written);
        Ok(())
    }

    fn taken_over(&mut self) {
        *self.known.borrow_mut() = Some(self.read.clone());
    }

    fn overwrite(&mut self, whatever: bool) {
        self.whatever = whatever;
        self.next.clear();
    }

    /// The time is that of the machine's clock when it is committed.
    fn sign(&mut self, who: &dyn fmt::Display, _: impl FnOnce() -> Option<u64>) {
        self.who = who.to_string();
    }

    fn write_version(&mut self, nth: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        if nth == 0 {
            self.versions = Versions::read(self.path().ok()?);
        }
        Some(write!(out, "{}", self.versions.get(nth)?))
    }

    async fn read_version(
        &mut self,
        nth: usize,
        offset: usize,
        into: &mut [u8],
    ) -> Result<usize, StoreError> {
        if offset == 0 {
            let versions = Versions::read(self.path()?);
            self.version = versions.get(nth).map(|version| version.text.clone()).unwrap_or_default();
        }
        Ok(copy(self.version.get(offset..).unwrap_or_default(), into))
    }
}

/// Copies what fits of `from` and returns how much that is.
fn copy(from: &[u8], into: &mut [u8]) -> usize {
    let count = from.len().min(into.len());
    into[..count].copy_from_slice(&from[..count]);
    count
}

/// Merges the settings in `new` into the file at `path`, if its text `is_known`; returns the text written. It is kept as a version
/// by `who`.
fn write(
    path: &Path,
    new: &str,
    who: &str,
    is_known: impl FnOnce(&[u8]) -> bool,
) -> Result<Vec<u8>, StoreError> {
    file::sweep(path);
    let old = match file::read(path).map_err(StoreError::Refused)? {
        Some(old) if !is_known(&old) => return Err(StoreError::Edited),
        old => old.unwrap_or_default(),
    };
    let text = merge(&String::from_utf8_lossy(&old), new).into_bytes();
    if text.len() > TEXT_BYTES_MAX {
        return Err(StoreError::Full(TEXT_BYTES_MAX));
    }
    let mut versions = Versions::read(path);
    versions.note(path, &old);
    file::replace(path, &text).map_err(|error| {
        log::error!("{}: {error}", path.display());
        StoreError::Refused(file::reason(&error))
    })?;
    versions.add(path, Timestamp::now(), who, &text);
    Ok(text)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use mobgate::hal::{Store, StoreError};

    use super::FileStore;
    use crate::file::TEXT_BYTES_MAX;
    use crate::reactor::block_on;

    const OLD: &str = "# the boiler\nport P1 serial uart1 rtu client # old\n";
    const NEW: &str = "port P1 serial uart1 rtu client 9600 8E1\n";

    fn save(store: &mut FileStore, text: &str) -> Result<(), StoreError> {
        block_on(async {
            store.append(text.as_bytes()).await?;
            store.commit().await
        })
    }

    fn read(store: &mut FileStore) -> Result<String, StoreError> {
        let mut text = [0; 256];
        let count = block_on(store.read(0, &mut text))?;
        Ok(String::from_utf8_lossy(&text[..count]).into_owned())
    }

    /// A folder, its file with the old text, and a store for it.
    fn store() -> (tempfile::TempDir, std::path::PathBuf, FileStore) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mobgate.conf");
        fs::write(&path, OLD).unwrap();
        let store = FileStore::new(Some(path.clone()));
        (folder, path, store)
    }

    #[test]
    fn what_is_committed_is_read_back_and_appended_text_alone_changes_nothing() {
        let (_folder, path, mut store) = store();
        fs::remove_file(&path).unwrap();
        assert_eq!(read(&mut store).unwrap(), "");
        save(&mut store, NEW).unwrap();
        block_on(store.append(b"port P2 tcp server 502\n")).unwrap();
        assert_eq!(read(&mut store).unwrap(), NEW);
    }

    #[test]
    fn comments_stay_and_a_text_that_was_taken_over_is_replaced() {
        let (_folder, path, mut store) = store();
        read(&mut store).unwrap();
        store.taken_over();
        save(&mut store, NEW).unwrap();
        let expected = format!("# the boiler\n{} # old\n", NEW.trim_end());
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        save(&mut store, "port P1 tcp server 502\n").unwrap();
    }

    #[test]
    fn what_somebody_else_has_written_is_replaced_only_by_force_or_after_it_was_taken_over() {
        let (_folder, path, mut store) = store();
        read(&mut store).unwrap();
        store.taken_over();
        fs::write(&path, "# edited\n").unwrap();
        assert_eq!(save(&mut store, NEW), Err(StoreError::Edited));
        // Reading an invalid text does not make it known.
        read(&mut store).unwrap();
        assert_eq!(save(&mut store.clone(), NEW), Err(StoreError::Edited));
        assert_eq!(fs::read_to_string(&path).unwrap(), "# edited\n");
        store.overwrite(true);
        save(&mut store, NEW).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), format!("# edited\n{NEW}"));
        fs::write(&path, "# edited again\n").unwrap();
        assert_eq!(save(&mut store, NEW), Err(StoreError::Edited), "force is for once");
        // Another session's store of the same file applies it.
        let mut other = store.clone();
        read(&mut other).unwrap();
        other.taken_over();
        save(&mut store, NEW).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_written_leaves_a_reason() {
        let mut store = FileStore::new(Some("/does/not/exist/mobgate.conf".into()));
        assert_eq!(save(&mut store, NEW), Err(StoreError::Refused("there is no such folder")));
    }

    #[test]
    fn without_a_file_the_user_is_told_how_to_have_one() {
        let refused = block_on(FileStore::new(None).append(b"text"));
        assert_eq!(refused, Err(StoreError::Absent("start with --config FILE")));
    }

    #[test]
    fn text_without_end_is_refused_and_forgotten() {
        let (_folder, _path, mut store) = store();
        let line = [b' '; 64 * 1024];
        let refused = (0..8).find_map(|_| block_on(store.append(&line)).err());
        assert_eq!(refused, Some(StoreError::Full(TEXT_BYTES_MAX)));
        store.overwrite(true);
        save(&mut store, NEW).unwrap();
    }

    #[test]
    fn versions_tell_who_and_are_read_back_one_by_one() {
        let (_folder, path, mut store) = store();
        read(&mut store).unwrap();
        store.taken_over();
        for (who, port) in [("anna@::1", 1502), ("local console", 1503)] {
            store.sign(&who, || None);
            save(&mut store, &format!("port P1 tcp server {port}\n")).unwrap();
        }
        // Another session's store sees them, too.
        let mut other = FileStore::new(Some(path));
        let mut told = |nth| {
            let mut told = String::new();
            other.write_version(nth, &mut told).map(|_| told.split_once('\t').unwrap().1.to_owned())
        };
        assert_eq!(
            [0, 1, 2, 3].map(&mut told).map(Option::unwrap_or_default),
            ["+1 -1\tlocal console", "+1 -1\tanna@::1", "+2 -0\tsystem", ""]
        );
        let mut text = [0; 256];
        let count = block_on(other.read_version(2, 0, &mut text)).unwrap();
        assert_eq!(String::from_utf8_lossy(&text[..count]), OLD);
        assert_eq!(block_on(other.read_version(3, 0, &mut text)), Ok(0));
    }

    #[test]
    fn what_is_kept_aside_is_what_a_save_would_have_made() {
        let (_folder, path, mut store) = store();
        read(&mut store).unwrap();
        store.taken_over();
        fs::write(&path, "# edited\n").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        let aside = store.keep_aside(NEW).unwrap();
        assert_eq!(fs::metadata(&aside).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(aside.file_name().unwrap(), "mobgate.conf.unsaved");
        assert_eq!(fs::read_to_string(&aside).unwrap(), format!("# the boiler\n{} # old\n", NEW.trim_end()));
        assert_eq!(fs::read_to_string(&path).unwrap(), "# edited\n");
    }
}
