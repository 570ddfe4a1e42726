//! Reports whether a network server listens, or why it cannot.

use core::net::IpAddr;

use crate::gateway::{PortState, Status};
use crate::hal::OpenError;
use crate::stats::LastError;

/// Reports that the server at `port_state` listens on `port` of `protocol`; `open_to_all` returns an address at which the whole world
/// reaches it.
pub(crate) fn listens(
    port_state: &PortState,
    protocol: &str,
    port: u16,
    open_to_all: impl FnOnce() -> Option<IpAddr>,
) {
    if port_state.set_status(Status::Open) {
        port_state.stats.note(LastError::None);
        log_info!("listening on {} port {}", protocol, port);
        if let Some(address) = open_to_all() {
            log_warn!(
                "{} port {} serves whoever reaches {}, which is not private: limit it with allow",
                protocol,
                port,
                address
            );
        }
    }
}

/// Reports that the server at `port_state` cannot listen.
pub(crate) fn fails(port_state: &PortState, protocol: &str, port: u16, error: OpenError) {
    port_state.stats.note(LastError::Port);
    if port_state.set_status(Status::Failed(error)) {
        log_warn!("{} port {} cannot be opened: {}", protocol, port, error);
    }
}
