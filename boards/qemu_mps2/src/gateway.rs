//! The gateway and its parts, in statics.

use mobgate::capture::Capture;
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Connection, Gateway, Ports};

/// Ports of any kind.
pub(crate) const PORTS: usize = 8;
/// TCP connections of all servers together: 16 clients, one that is accepted before another is closed for it, and a small server's.
pub(crate) const CONNECTIONS: usize = 22;
const RESERVED: usize = CONNECTIONS + PORTS;
const FRAMES: usize = 2 * RESERVED;

static SLOTS: [Slot; FRAMES] = [const { Slot::new() }; FRAMES];
static POOL: FramePool<'static> = FramePool::new(&SLOTS, RESERVED);
static PORT_STATES: Ports<PORTS> = Ports::new();
static CONNECTION_STATES: [Connection; CONNECTIONS] = [const { Connection::new() }; CONNECTIONS];
static CAPTURE: Capture = Capture::new();
/// The settings that are being changed, or those to go back to.
#[cfg(feature = "web")] // Only the web interface changes it.
static CANDIDATE: mobgate::gateway::Candidate = mobgate::gateway::Candidate::new();

// The image without data points and EtherCAT is smaller, see Cargo.toml; so are those without `audit` or `web`.
#[cfg(feature = "ethercat")]
pub(crate) static GATEWAY: Gateway<'static> = crate::ethercat::join(gateway());
#[cfg(not(feature = "ethercat"))]
pub(crate) static GATEWAY: Gateway<'static> = gateway();

const fn gateway() -> Gateway<'static> {
    let gateway = Gateway::new(&POOL, &PORT_STATES, &CONNECTION_STATES).with_own_network();
    #[cfg(feature = "audit")]
    let gateway = gateway.with_audit(mobgate_faults::audit_memory());
    #[cfg(feature = "web")]
    let gateway = gateway.with_candidate(&CANDIDATE);
    gateway.with_capture(&CAPTURE)
}
