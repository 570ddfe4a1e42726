//! Reports whether a network server listens, or why it cannot.

use crate::gateway::{PortState, Status};
use crate::hal::OpenError;
use crate::stats::LastError;

/// Reports that the server at `port_state` listens on `port` of `protocol`.
pub(crate) fn listens(port_state: &PortState, protocol: &str, port: u16) {
    if port_state.set_status(Status::Open) {
        port_state.stats.note(LastError::None);
        log_info!("listening on {} port {}", protocol, port);
    }
}

/// Reports that the server at `port_state` cannot listen.
pub(crate) fn fails(port_state: &PortState, protocol: &str, port: u16, error: OpenError) {
    port_state.stats.note(LastError::Port);
    if port_state.set_status(Status::Failed(error)) {
        log_warn!("{} port {} cannot be opened: {}", protocol, port, error);
    }
}
