//! Names of the lines.

const NAMES: [(&str, usize); 3] = [("uart1", 1), ("uart2", 2), ("uart3", 3)];

/// The UART of line `device`.
pub(crate) fn number(device: &str) -> Option<usize> {
    NAMES.iter().find(|(name, _)| *name == device).map(|(_, number)| *number)
}
