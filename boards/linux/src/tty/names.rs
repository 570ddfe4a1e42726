//! The names of this machine's serial lines: those in `/dev/serial/by-id`, which stay with an adapter, before the others.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serial2::SerialPort;

/// Symbolic links that udev makes.
const BY_ID: &str = "/dev/serial/by-id";
/// What the kernel knows of each line.
const CLASS: &str = "/sys/class/tty";

/// The names, as they were when the first one was asked for.
static NAMES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// The name of line `n`, from 0; the first one looks for them again.
pub fn nth(n: usize) -> Option<String> {
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    if n == 0 {
        *names = found(Path::new(BY_ID), Path::new(CLASS), SerialPort::available_ports().unwrap_or_default());
    }
    names.get(n).cloned()
}

/// The links in `by_id`, and the `devices` that none of them leads to, without those that `class` says have no hardware.
fn found(by_id: &Path, class: &Path, devices: Vec<PathBuf>) -> Vec<String> {
    let mut links: Vec<PathBuf> =
        fs::read_dir(by_id).into_iter().flatten().flatten().map(|link| link.path()).collect();
    links.sort();
    let led_to: Vec<PathBuf> = links.iter().filter_map(|link| fs::canonicalize(link).ok()).collect();
    let is_there = |device: &Path| {
        let kind = device.file_name().map(|name| class.join(name).join("type"));
        // Four or more `ttyS` are there without hardware; 0 is PORT_UNKNOWN (serial_core.h).
        kind.and_then(|kind| fs::read_to_string(kind).ok()).is_none_or(|kind| kind.trim() != "0")
    };
    let mut others: Vec<PathBuf> =
        devices.into_iter().filter(|device| !led_to.contains(device) && is_there(device)).collect();
    others.sort();
    let texts = links.into_iter().chain(others).map(PathBuf::into_os_string);
    texts.filter_map(|text| text.into_string().ok()).collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::found;

    #[test]
    fn a_line_has_the_name_that_stays_and_one_without_hardware_none() {
        let folder = tempfile::tempdir().unwrap();
        let [by_id, class] = ["by-id", "class"].map(|name| folder.path().join(name));
        let devices = ["ttyUSB1", "ttyS1", "ttyUSB0", "ttyS0"].map(|name| folder.path().join(name));
        assert_eq!(found(&by_id, &class, devices.to_vec()).len(), 4, "without udev and sysfs all are shown");
        std::fs::create_dir_all(&by_id).unwrap();
        for (name, kind) in [("ttyS0", "4\n"), ("ttyS1", "0\n")] {
            std::fs::create_dir_all(class.join(name)).unwrap();
            std::fs::write(class.join(name).join("type"), kind).unwrap();
        }
        std::fs::write(&devices[2], "").unwrap();
        symlink(&devices[2], by_id.join("usb-adapter-port0")).unwrap();
        let names: Vec<_> = found(&by_id, &class, devices.to_vec());
        let names: Vec<_> = names.iter().map(|name| name.rsplit('/').next().unwrap()).collect();
        assert_eq!(names, ["usb-adapter-port0", "ttyS0", "ttyUSB1"]);
    }
}
