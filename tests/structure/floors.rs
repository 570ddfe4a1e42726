//! The floors of the core. A file imports from its own floor and from those below.

/// The rooms of each floor, from the lowest up.
pub(crate) const FLOORS: &[&[&str]] = &[
    // Bytes.
    &["fmt", "modbus", "mqtt"],
    // Values, words and decisions, without time and without I/O.
    &["scanner", "settings", "language", "routing"],
    // The gateway as an EtherCAT device: what it shares with the gateway.
    &["fieldbus"],
    // What a board gives; frames, counters, and what was on the wire.
    &["hal", "frame", "stats", "capture"],
    // What tasks share.
    &["gateway"],
    // One role each.
    &["port"],
    // People, and systems that look at the gateway and change it.
    &["console", "web", "telemetry"],
    // The futures that a board runs.
    &["tasks"],
];
