//! What is done with a data point at once.

/// What is done with a point at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointCommand {
    Read,
    Write,
    Mark,
    Begin,
    Finish,
}
