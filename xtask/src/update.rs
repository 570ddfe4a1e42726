//! Update files: a board's firmware with the header of mobgate-image, signed.

use std::path::{Path, PathBuf};

use mobgate_image::{Header, Info};

use crate::board;
use crate::key::Key;
use crate::tools::{Outcome, written};

/// Ending of an update file's name.
pub(crate) const ENDING: &str = "mgu";

/// Writes the update file beside an image, if that has an info block where updates look for it.
pub(crate) fn write(image: &Path) -> Outcome<Option<PathBuf>> {
    let (_, firmware) = board::flat(&[image])?;
    let Some(info) = Info::of_firmware(&firmware) else { return Ok(None) };
    let key = Key::for_images()?;
    println!("{} {}, signed for {}", info.board(), info.version(), key.public());
    written(image.with_extension(ENDING), &file(&key, &firmware)?).map(Some)
}

fn file(key: &Key, firmware: &[u8]) -> Outcome<Vec<u8>> {
    let firmware_bytes = firmware.len().try_into().map_err(|_| "a firmware of more than 4 GiB")?;
    let header = Header { firmware_bytes, signature: key.sign(firmware) };
    Ok([header.to_bytes().as_slice(), firmware].concat())
}

#[cfg(test)]
mod tests {
    use super::file;
    use crate::key::Key;
    use mobgate_image::{INFO_OFFSET, Info, Receiver};

    #[test]
    fn boards_take_the_file_that_is_written() {
        let folder = std::env::temp_dir().join(format!("mobgate-update-{}", std::process::id()));
        let key = Key::made(&folder.join("some.key")).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let info = Info::new("NUCLEO-F767ZI", "0.1.0").unwrap();
        let mut firmware = vec![0xa5; 4000];
        firmware.splice(INFO_OFFSET..INFO_OFFSET + 32, info.to_bytes());
        let file = file(&key, &firmware).unwrap();
        let mut receiver = Receiver::new(info, 4000, false);
        assert_eq!(receiver.take(&file).unwrap(), firmware);
        let (header, received) = receiver.finish().unwrap();
        assert_eq!((header.signature, received), (key.sign(&firmware), info));
    }
}
