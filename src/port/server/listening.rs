//! Reports whether a network server listens, or why it cannot, and which peers it refuses.

use core::net::{IpAddr, SocketAddr};

use embassy_time::Duration;

use crate::gateway::audit::Topic;
use crate::gateway::{Gateway, PortState, Status};
use crate::hal::OpenError;
use crate::settings::{AUDIT, Address, PortId, canonical};
use crate::stats::{Event, LastError};

/// Pause after a listener fails.
pub(crate) const LISTEN_PAUSE: Duration = Duration::from_secs(1);

/// Reports that the server at `port_state` listens on `port` of `protocol`; `open_to_all` returns an address at which the whole world
/// reaches it.
pub(crate) fn listens(
    port_state: &PortState,
    protocol: &str,
    port: u16,
    open_to_all: impl FnOnce() -> Option<IpAddr>,
) {
    if port_state.set_status(Status::Open) {
        has_opened(port_state, protocol, port, open_to_all);
    }
}

/// Logs that the server at `port_state` has begun to listen.
fn has_opened(
    port_state: &PortState,
    protocol: &str,
    port: u16,
    open_to_all: impl FnOnce() -> Option<IpAddr>,
) {
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

/// Reports that the client port at `port_state` waits for its device, at TCP port `port`; the rest as [`listens`].
// Other images have no such devices; also below.
#[cfg(feature = "dial-in")]
pub(crate) fn waits(port_state: &PortState, port: u16, open_to_all: impl FnOnce() -> Option<IpAddr>) {
    if matches!(port_state.status(), Status::Off | Status::Failed(_)) {
        port_state.set_status(Status::Waiting);
        has_opened(port_state, "TCP", port, open_to_all);
    }
}

/// Reports that the client port `port` has refused a device at `peer`.
#[cfg(feature = "dial-in")]
pub(crate) fn refuses_device(gateway: &Gateway<'_>, port: PortId, peer: IpAddr, why: Event) {
    let why = match why {
        Event::Unwelcome => "it is that of no port",
        Event::Stalled => "its first bytes do not come",
        _ => "too many wait for their first bytes",
    };
    let what = format_args!("a device is refused, {why},");
    gateway.audit_refusal(Topic::RefusedClient, Some(port), Some(peer), what);
}

/// Reports that the server at `port_state` cannot listen.
pub(crate) fn fails(port_state: &PortState, protocol: &str, port: u16, error: OpenError) {
    port_state.stats.note(LastError::Port);
    if port_state.set_status(Status::Failed(error)) {
        log_warn!("{} port {} cannot be opened: {}", protocol, port, error);
    }
}

/// Reports that the server at `port` has refused a client at `peer`.
pub(crate) fn refuses(gateway: &Gateway<'_>, port: PortId, peer: IpAddr, why: Event) {
    let why = if why == Event::Unwelcome { "its address is not allowed" } else { "no connection is free" };
    let what = format_args!("a client is refused, {why},");
    gateway.audit_refusal(Topic::RefusedClient, Some(port), Some(peer), what);
}

/// Reports that the server at `port` has refused a client at `peer` because of its certificate.
// Servers without TLS ask for none.
#[cfg_attr(not(feature = "tls"), allow(dead_code))]
pub(crate) fn refuses_certificate(gateway: &Gateway<'_>, port: PortId, peer: IpAddr, why: &str) {
    let what = format_args!("a client is refused, {why},");
    gateway.audit_refusal(Topic::RefusedClient, Some(port), Some(peer), what);
}

/// Reports that the server at `port` closes the connection of `left` for a newcomer at `peer`.
pub(crate) fn displaces(gateway: &Gateway<'_>, port: PortId, left: Option<SocketAddr>, peer: IpAddr) {
    if let (true, Some(left)) = (AUDIT, left) {
        let what = format_args!("displaces {}", Address(canonical(left.ip())));
        gateway.audit_refusal(Topic::Displaced, Some(port), Some(peer), what);
    }
}
