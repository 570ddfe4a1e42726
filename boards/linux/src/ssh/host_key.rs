//! The host key: made once, and kept beside the settings.

use std::fs::{self, File};
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use russh::keys::ssh_key::LineEnding;
use russh::keys::ssh_key::private::Ed25519Keypair;
use russh::keys::{HashAlg, PrivateKey};
use rustix::rand::{GetRandomFlags, getrandom};

use crate::file;

/// What the file is called: the name of that of the settings, and this.
const SUFFIX: &str = ".host-key";
/// Access for the owner only.
const OTHERS: u32 = 0o077;

/// The file of the key, beside that of the settings.
pub(super) fn beside(settings: &Path) -> PathBuf {
    file::beside(settings, SUFFIX)
}

/// Reads the key in the file at `path`, or makes it; without a path one that is not kept.
pub(super) fn open(path: Option<&Path>) -> Result<PrivateKey, String> {
    let Some(path) = path else {
        log::warn!(
            "the SSH host key is another after each start: there is no file of settings to keep it beside"
        );
        return generate();
    };
    let fault = |reason: &dyn std::fmt::Display| format!("host key {}: {reason}", path.display());
    let key = match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => make(path).map_err(|error| fault(&error))?,
        Err(error) => return Err(fault(&error)),
        Ok(facts) if facts.mode() & OTHERS != 0 => return Err(fault(&"others may read it: chmod 600")),
        Ok(_) => {
            let text = file::read(path).map_err(|error| fault(&error))?.unwrap_or_default();
            PrivateKey::from_openssh(text).map_err(|error| fault(&error))?
        }
    };
    log::info!("SSH host key {} in {}", key.fingerprint(HashAlg::Sha256), path.display());
    Ok(key)
}

fn generate() -> Result<PrivateKey, String> {
    let mut seed = [0; 32];
    match getrandom(&mut seed, GetRandomFlags::empty()) {
        Ok(count) if count == seed.len() => Ok(Ed25519Keypair::from_seed(&seed).into()),
        Ok(_) => Err("too few random numbers".to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

/// Writes the key to a new file, atomically.
fn make(path: &Path) -> Result<PrivateKey, String> {
    let key = generate()?;
    let text = key.to_openssh(LineEnding::LF).map_err(|error| error.to_string())?;
    let folder = path.parent().unwrap_or(Path::new("/"));
    let written = || {
        // For its owner only, as all temporary files.
        let mut new = tempfile::NamedTempFile::new_in(folder)?;
        new.write_all(text.as_bytes())?;
        new.as_file().sync_all()?;
        new.persist_noclobber(path)?;
        File::open(folder)?.sync_all()
    };
    written().map_err(|error| error.to_string()).map(|()| key)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_key_is_made_once_for_its_owner_alone_and_never_in_place_of_another_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = beside(&folder.path().join("mobgate.conf"));
        let made = open(Some(&path)).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        assert_eq!(open(Some(&path)).unwrap(), made);
        assert_ne!(generate().unwrap(), made);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        assert!(open(Some(&path)).unwrap_err().contains("others may read it"));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        fs::write(&path, "something else").unwrap();
        open(Some(&path)).unwrap_err();
        assert_eq!(fs::read_to_string(&path).unwrap(), "something else");
    }
}
