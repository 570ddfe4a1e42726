//! The flash of what was added to an image since commit `ed70195`, part by part.
//!
//! An instruction belongs to the part whose sources it was written in, or else to that of the function it was inlined into, as the
//! debug information tells, innermost first. Constants, and what is in no source of a part, count as there before.

use std::fs::{self, File};
use std::ops::Range;
use std::path::Path;

use crate::tools::{Outcome, command, output, root};

/// The parts, and the ends, beginnings or folders of their sources' paths.
const PARTS: [(&str, &[&str]); 11] = [
    // Late responses: what proves that a unit is in step.
    (
        "in_step",
        &[
            "/src/gateway/outstanding.rs",
            "/src/gateway/unit_health/in_step.rs",
            "/src/port/client/dispatcher/proof.rs",
            "/src/port/client/transaction/unsolicited.rs",
            "/src/settings/proof.rs",
            "/src/language/proof.rs",
        ],
    ),
    // Several servers behind a port.
    (
        "servers",
        &[
            "/src/gateway/socket.rs",
            "/src/port/client/dispatcher/dispatch.rs",
            "/src/port/client/servers.rs",
            "/src/settings/servers.rs",
            "/src/language/servers.rs",
        ],
    ),
    // Names of servers.
    ("dns", &["/boards/net/src/names.rs", "/embassy-net-*/src/dns.rs", "/smoltcp-*/src/socket/dns.rs"]),
    // The gateway by its name in the network.
    (
        "mdns",
        &[
            "/boards/mdns/src/",
            "/boards/net/src/mdns.rs",
            "/src/settings/mdns.rs",
            "/src/language/mdns.rs",
            "/domain-*/src/",
            "/octseq-*/src/",
            "/smoltcp-*/src/iface/interface/multicast.rs",
            "/smoltcp-*/src/wire/igmp.rs",
        ],
    ),
    // Who changed what: the trail, and a server that gets it.
    (
        "audit",
        &[
            "/src/console/audit.rs",
            "/src/gateway/audit.rs",
            "/src/gateway/audit/",
            "/src/hal/syslog.rs",
            "/src/language/syslog.rs",
            "/src/settings/syslog.rs",
            "/src/tasks/syslog.rs",
            "/boards/net/src/audit.rs",
            "/boards/net/src/syslog.rs",
        ],
    ),
    // The time, by an NTP server.
    (
        "time",
        &[
            "/src/gateway/calendar.rs",
            "/src/gateway/calendar/",
            "/src/gateway/date.rs",
            "/src/language/ntp.rs",
            "/src/settings/time.rs",
            "/boards/net/src/sntp.rs",
            "/sntpc-*/src/",
            "/time-*/src/",
        ],
    ),
    // Users with passwords.
    (
        "users",
        &[
            "/src/console/log_in.rs",
            "/src/console/users.rs",
            "/src/gateway/enter.rs",
            "/src/gateway/log_in.rs",
            "/src/language/users.rs",
            "/src/settings/users.rs",
            "/boards/passwords/src/",
            "/boards/stm32/src/random.rs",
            "/argon2-*/src/",
            "/base64ct-*/src/",
            "/blake2-*/src/",
            "/password-hash-*/src/",
            "/phc-*/src/",
        ],
    ),
    // New firmware: from the console, into the flash, and its trial.
    (
        "update",
        &[
            "/src/hal/update.rs",
            "/src/console/update.rs",
            "/src/console/update/",
            "/boards/update/src/",
            "/boards/image/src/",
            "/boards/firmware/src/trial.rs",
            "/embassy-boot-*/",
            "/salty-*/",
        ],
    ),
    // Characters that the receive interrupt hands on; other boards had that before.
    ("relay", &["/boards/common/src/relay.rs"]),
    // Clients that come in a burst.
    ("backlog", &["/boards/net/src/backlog.rs", "/boards/net/src/queued.rs", "/boards/net/src/syn.rs"]),
    // Clients that ask for what is refused are slowed down.
    ("pace", &["/src/port/server/tcp/window.rs", "/src/gateway/turns.rs"]),
];

/// Bytes of each part's instructions in `code`, the addresses of an image's text.
pub(crate) fn bytes(image: &Path, code: Range<u64>) -> Outcome<Vec<(&'static str, u64)>> {
    /// Instructions have two or four bytes.
    const STEP: usize = 2;
    let list = root().join("target/tmp/addresses");
    let addresses: String = code.step_by(STEP).map(|address| format!("{address:#x}\n")).collect();
    fs::create_dir_all(root().join("target/tmp")).map_err(|error| error.to_string())?;
    fs::write(&list, addresses).map_err(|error| format!("{}: {error}", list.display()))?;
    let list = File::open(&list).map_err(|error| format!("{}: {error}", list.display()))?;
    // For each address a line with it, and one with the source of each function that it is in, its path from the checkout or registry.
    let sources = output(command("addr2line", &["--inlines", "--addresses", "-e"]).arg(image).stdin(list))?;
    let mut bytes = PARTS.map(|(part, _)| (part, 0));
    let mut is_counted = true;
    for source in sources.lines() {
        if source.starts_with("0x") {
            is_counted = false;
        } else if let Some(part) = of(&format!("/{source}")).filter(|_| !is_counted) {
            bytes[part].1 += STEP as u64;
            is_counted = true;
        }
    }
    Ok(bytes.into())
}

/// The part that a line of this source belongs to.
fn of(source: &str) -> Option<usize> {
    PARTS.iter().position(|(_, sources)| sources.iter().any(|path| contains(source, path)))
}

/// Whether `source` contains `path`, in which a star is a version.
fn contains(source: &str, path: &str) -> bool {
    match path.split_once('*') {
        None => source.contains(path),
        Some((name, rest)) => source.split_once(name).is_some_and(|(_, version)| {
            version.split_once('/').is_some_and(|(_, file)| rest == "/" || file.starts_with(&rest[1..]))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::{PARTS, of};
    use crate::tools::root;

    /// Renaming a file would change the figures silently.
    #[test]
    fn the_sources_of_the_parts_are_there() {
        let sources = PARTS.iter().flat_map(|(_, sources)| *sources);
        for source in sources.filter(|source| !source.contains('*')) {
            assert!(root().join(source.trim_start_matches('/')).exists(), "{source}");
        }
    }

    #[test]
    fn a_source_is_of_one_part() {
        let part = |source| of(source).map(|part| PARTS[part].0);
        assert_eq!(
            part("/home/user/mobgate/src/gateway/outstanding.rs:101 (discriminator 2)"),
            Some("in_step")
        );
        assert_eq!(part("/registry/src/index/domain-0.11.1/src/base/name/label.rs:7"), Some("mdns"));
        assert_eq!(part("/registry/src/index/smoltcp-0.13.1/src/socket/dns.rs:7"), Some("dns"));
        assert_eq!(part("/registry/src/index/smoltcp-0.13.1/src/socket/tcp.rs:7"), None);
        assert_eq!(part("??:?"), None);
    }
}
