//! How a server on the network tells that it listens, or why it cannot.

use crate::gateway::{PortPlace, Status};
use crate::hal::OpenError;
use crate::stats::LastError;

/// The server at `place` listens on `port` of `protocol`.
pub(crate) fn listens(place: &PortPlace, protocol: &str, port: u16) {
    if place.set_status(Status::Open) {
        place.stats.note(LastError::None);
        log_info!("listening on {} port {}", protocol, port);
    }
}

/// It cannot.
pub(crate) fn fails(place: &PortPlace, protocol: &str, port: u16, error: OpenError) {
    place.stats.note(LastError::Port);
    if place.set_status(Status::Failed(error)) {
        log_warn!("{} port {} cannot be opened: {}", protocol, port, error);
    }
}
