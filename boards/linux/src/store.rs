//! The settings' text in a file, which is replaced as a whole.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::path::{Path, PathBuf};

use mobgate::hal::{Store, StoreError};

use crate::worker;

/// Longest text that is written; far above what full settings come to.
const TEXT_BYTES_MAX: usize = 256 * 1024;
/// Permissions of a file that did not exist before.
const NEW_FILE_MODE: u32 = 0o644;

/// The configuration file, or none when the program was started without one.
#[derive(Debug, Clone)]
pub struct FileStore {
    path: Option<PathBuf>,
    /// The version that is being written.
    next: Vec<u8>,
}

impl FileStore {
    /// Keeps the settings in the file at `path`.
    pub fn new(path: Option<PathBuf>) -> Self {
        Self { path, next: Vec::new() }
    }

    fn path(&self) -> Result<&Path, StoreError> {
        self.path.as_deref().ok_or(StoreError::Absent("start with --config FILE"))
    }
}

impl Store for FileStore {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let file = match File::open(self.path()?) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(0),
            opened => opened.map_err(|error| failed(&error))?,
        };
        file.read_at(into, offset as u64).map_err(|error| failed(&error))
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        self.path()?;
        if self.next.len() + text.len() > TEXT_BYTES_MAX {
            self.next.clear();
            return Err(StoreError::Full(TEXT_BYTES_MAX));
        }
        self.next.extend_from_slice(text);
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        let path = self.path()?.to_owned();
        let text = std::mem::take(&mut self.next);
        // fsync may take long, and the executor serves the lines meanwhile.
        let replaced = worker::once(move || replace(&path, &text)).await;
        replaced.flatten().map_err(|error| failed(&error))
    }
}

fn failed(error: &io::Error) -> StoreError {
    log::error!("settings file: {error}");
    StoreError::Failed
}

/// Puts `text` in place of the file at `path`: whoever reads it, also after a power cut, sees the old or the new text.
fn replace(path: &Path, text: &[u8]) -> io::Result<()> {
    // A link stays a link: its target is replaced.
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let mode = fs::metadata(&path).map_or(NEW_FILE_MODE, |facts| facts.permissions().mode());
    // In the same folder, because a rename does not cross file systems.
    let mut next = tempfile::Builder::new().prefix(".mobgate-").tempfile_in(folder)?;
    next.write_all(text)?;
    next.as_file().set_permissions(fs::Permissions::from_mode(mode))?;
    next.as_file().sync_all()?;
    next.persist(&path)?;
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use crate::reactor::block_on;
    use mobgate::hal::{Store, StoreError};

    use super::{FileStore, TEXT_BYTES_MAX};

    fn save(store: &mut FileStore, parts: &[&str]) {
        block_on(async {
            for part in parts {
                store.append(part.as_bytes()).await.unwrap();
            }
            store.commit().await.unwrap();
        });
    }

    #[test]
    fn what_is_committed_is_read_back_and_appended_text_alone_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = FileStore::new(Some(folder.path().join("mobgate.conf")));
        let mut text = [0; 64];
        assert_eq!(block_on(store.read(0, &mut text)).unwrap(), 0);
        save(&mut store, &["one\n", "two\n"]);
        block_on(store.append(b"three\n")).unwrap();
        assert_eq!(block_on(store.read(4, &mut text)).unwrap(), 4);
        assert_eq!(&text[..4], b"two\n");
    }

    #[test]
    fn the_files_mode_and_a_link_to_it_survive() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("real.conf"), folder.path().join("link.conf"));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&file, &link).unwrap();
        save(&mut FileStore::new(Some(link.clone())), &["new"]);
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert!(link.is_symlink());
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o640);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "a temporary file was left");
    }

    #[test]
    fn a_folder_that_cannot_be_written_leaves_an_error() {
        let mut store = FileStore::new(Some("/proc/mobgate.conf".into()));
        let saved = block_on(async {
            store.append(b"text").await?;
            store.commit().await
        });
        assert_eq!(saved, Err(StoreError::Failed));
    }

    #[test]
    fn without_a_file_the_user_is_told_how_to_have_one() {
        let refused = block_on(FileStore::new(None).append(b"text"));
        assert_eq!(refused, Err(StoreError::Absent("start with --config FILE")));
    }

    #[test]
    fn text_without_end_is_refused_and_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = FileStore::new(Some(folder.path().join("mobgate.conf")));
        let line = [b' '; 64 * 1024];
        let refused = (0..8).find_map(|_| block_on(store.append(&line)).err());
        assert_eq!(refused, Some(StoreError::Full(TEXT_BYTES_MAX)));
        save(&mut store, &["short"]);
        assert_eq!(block_on(store.read(0, &mut [0; 64])).unwrap(), 5);
    }
}
