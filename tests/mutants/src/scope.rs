//! What is mutated, and which tests must notice.

/// Files and folders with mutants. Tests inside them are left out.
pub(crate) const PATHS: &[&str] = &[
    // Codecs.
    "src/modbus",
    // Rules.
    "src/routing.rs",
    "src/routing",
    "src/settings/functions.rs",
    "src/settings/policy.rs",
    "src/settings/rule.rs",
    "src/language/review.rs",
    // What is asked next, and what a response proves.
    "src/port/client/queue.rs",
    "src/port/client/queue",
    "src/port/client/dispatcher.rs",
    "src/port/client/dispatcher",
    "src/gateway/unit_health.rs",
    "src/gateway/unit_health",
    "src/gateway/outstanding.rs",
    // Cut-through.
    "src/port/cut_through",
    "src/settings/lane.rs",
    "src/hal/relay.rs",
    // Scanner.
    "src/scanner.rs",
    "src/scanner",
    "src/port/scanner.rs",
    // EtherCAT.
    "ethercat/subdevice/src/al_state.rs",
    "ethercat/subdevice/src/mailbox.rs",
    // Where a board keeps its settings.
    "boards/flash/src",
];

/// Packages whose code is mutated, with their folder; their unit and integration tests are those that must notice.
pub(crate) const PACKAGES: &[(&str, &str)] =
    &[("mobgate", ""), ("ethercat-subdevice", "ethercat/subdevice"), ("mobgate-flash", "boards/flash")];

/// Parts of the names of tests that are not asked: they need other programs, take their time from a clock of the machine, or
/// do the same many times.
pub(crate) const LEFT_OUT: &[&str] = &["outside::", "pysoem", "foreign::", "ethercat_mcp", "digital_io_"];

/// Random worlds: as many as notice most and have their share of good responses, since each mutant that lives through them costs
/// their time.
pub(crate) const ENVIRONMENT: &[(&str, &str)] = &[
    ("MOBGATE_SEEDS", "24"),
    ("PROPTEST_CASES", "64"),
    ("PROPTEST_RNG_SEED", "1"),
    ("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "1"),
    ("RUST_BACKTRACE", "0"),
];

/// Features of the mutated build: those that are on by default. Code for others is no candidate.
pub(crate) const FEATURES: &[&str] = &[
    "audit",
    "candidate",
    "capture",
    "eoe",
    "files",
    "ipv6",
    "long-images",
    "long-requests",
    "dial-in",
    "long-values",
    "mqtt",
    "page",
    "paths",
    "points",
    "servers",
    "ssh",
    "tls",
    "users",
    "versions",
    "web",
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::{FEATURES, PACKAGES};

    /// Adds what `feature` brings along to `on`.
    fn follow(features: &toml::Table, feature: &str, on: &mut BTreeSet<String>) {
        for brought in features.get(feature).and_then(|list| list.as_array()).into_iter().flatten() {
            // Others are dependencies, and features of those.
            let name = brought.as_str().filter(|name| !name.contains([':', '/']));
            if let Some(name) = name.filter(|name| on.insert((*name).to_owned())) {
                follow(features, name, on);
            }
        }
    }

    #[test]
    fn the_features_are_those_that_the_packages_have_by_default() {
        let mut on = BTreeSet::new();
        for (package, folder) in PACKAGES {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder).join("Cargo.toml");
            let manifest: toml::Table = std::fs::read_to_string(path).unwrap().parse().expect(package);
            if let Some(features) = manifest.get("features").and_then(|features| features.as_table()) {
                follow(features, "default", &mut on);
            }
        }
        assert_eq!(FEATURES.iter().map(|feature| (*feature).to_owned()).collect::<BTreeSet<_>>(), on);
    }
}
