//! Hints for the user with run-time contents, as the `&'static str` of an `OpenError`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Leaks a text once, however often it is requested. The callers' texts are few: one for each group of the system and each device
/// that no group may open, two with the program's path, and some for each network interface named by a user.
pub(crate) fn keep(text: String) -> &'static str {
    static KEPT: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = kept.get(text.as_str()) {
        return known;
    }
    let text: &'static str = text.leak();
    kept.insert(text);
    text
}

/// Permissions that a group needs to open a device.
const READ_AND_WRITE: u32 = 0o060;

/// What to do if `device` may not be opened: join its group, if that group has access.
pub(crate) fn device_denied(device: &Path) -> &'static str {
    use std::os::unix::fs::MetadataExt;
    let facts = std::fs::metadata(device).ok();
    // Joining root's group would grant too much.
    if facts.as_ref().is_some_and(|facts| facts.gid() == 0 || facts.mode() & READ_AND_WRITE != READ_AND_WRITE)
    {
        let device = device.display();
        return keep(format!(
            "no group may open it; until it is plugged in again: sudo chgrp dialout {device} && sudo chmod g+rw {device}"
        ));
    }
    let owner = facts.and_then(|facts| group_name(facts.gid()));
    let group = owner.as_deref().unwrap_or("dialout");
    keep(format!("add the user to the group {group}: sudo usermod -aG {group} $USER, then log in again"))
}

/// What to do if a port below 1024 may not be opened.
pub(crate) fn port_denied() -> &'static str {
    keep(format!(
        "ports below 1024 are privileged: sudo setcap cap_net_bind_service=+ep {}",
        program().display()
    ))
}

/// What to do if a raw socket may not be opened. Includes the ports below 1024, because setcap drops what it does not name.
pub(crate) fn raw_socket_denied() -> &'static str {
    keep(format!(
        "a raw socket needs CAP_NET_RAW: sudo setcap cap_net_raw,cap_net_bind_service=+ep {}; a service: see \
         docs/ethercat-on-linux.md",
        program().display()
    ))
}

/// What to do if a TAP interface may not be made or set up. Includes what else an EtherCAT port needs, as above.
pub(crate) fn tap_denied() -> &'static str {
    keep(format!(
        "a TAP interface needs CAP_NET_ADMIN: sudo setcap cap_net_admin,cap_net_raw,cap_net_bind_service=+ep {}; a service: see \
         docs/ethercat-on-linux.md",
        program().display()
    ))
}

fn program() -> PathBuf {
    std::env::current_exe().unwrap_or_else(|_| "mobgate".into())
}

/// The name of group `gid` in the system's group file.
fn group_name(gid: u32) -> Option<String> {
    group(|_, id| id == gid).map(|(name, _)| name)
}

/// The id of group `name` in the system's group file.
pub(crate) fn group_id(name: &str) -> Option<u32> {
    group(|known, _| known == name).map(|(_, id)| id)
}

/// The first group in the system's group file for which `is_it` holds.
fn group(is_it: impl Fn(&str, u32) -> bool) -> Option<(String, u32)> {
    let groups = std::fs::read_to_string("/etc/group").ok()?;
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, id) = (fields.next()?, fields.nth(1)?.parse().ok()?);
        is_it(name, id).then(|| (name.to_owned(), id))
    })
}

#[cfg(test)]
mod tests {
    use super::{device_denied, group_id, group_name, keep};

    #[test]
    fn a_hint_is_kept_once() {
        let first = keep("ask again".to_owned());
        assert!(std::ptr::eq(first, keep("ask again".to_owned())));
    }

    #[test]
    fn groups_are_known_by_name_and_by_id() {
        assert_eq!((group_id("root"), group_name(0).as_deref()), (Some(0), Some("root")));
        assert_eq!(group_id("no such group"), None);
    }

    #[test]
    fn a_refused_device_names_the_group_that_owns_it_and_never_that_of_root() {
        let hint = device_denied("/dev/tty".as_ref());
        assert!(hint.contains("usermod -aG tty") || hint.contains("no group"), "{hint}");
        let hint = device_denied("/dev/null".as_ref());
        assert!(!hint.contains("usermod") && hint.contains("chgrp dialout /dev/null"), "{hint}");
    }

    #[test]
    fn a_device_without_a_known_group_names_dialout() {
        assert!(device_denied("/does/not/exist".as_ref()).contains("group dialout"));
    }
}
