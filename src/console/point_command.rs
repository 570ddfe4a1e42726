//! Commands that act on a data point.

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointCommand {
    Read,
    Write,
    Mark,
    Begin,
    Finish,
}
