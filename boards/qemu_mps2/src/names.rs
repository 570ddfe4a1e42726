//! Names of the lines.

const NAMES: [(&str, usize); 3] = [("uart1", 1), ("uart2", 2), ("uart3", 3)];

/// The name of line `nth`, from 0.
pub(crate) fn name(nth: usize) -> Option<&'static str> {
    NAMES.get(nth).map(|(name, _)| *name)
}

/// The UART of line `device`.
pub(crate) fn number(device: &str) -> Option<usize> {
    NAMES.iter().find(|(name, _)| *name == device).map(|(_, number)| *number)
}
