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

/// Features of the mutated build that its files name: those that are on by default. Code for others is no candidate.
pub(crate) const FEATURES: &[&str] = &[
    "audit",
    "candidate",
    "capture",
    "files",
    "ipv6",
    "long-images",
    "long-values",
    "paths",
    "points",
    "servers",
    "tls",
    "users",
    "versions",
];
