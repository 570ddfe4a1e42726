//! The gateway's statics and tasks, the same on every board; a board has the port's task, which knows its kind of lines.

use core::fmt;
use core::pin::pin;

use embassy_executor::Spawner;
use embassy_sync::once_lock::OnceLock;
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Connection, Gateway, Ports};
use mobgate::hal::SerialHost;
use mobgate::settings::PortId;
use mobgate_board::liveness::Liveness;
use mobgate_net::{Connector, Datagrams, TcpSockets};
use static_cell::StaticCell;

use crate::sockets::Network;

/// Ports of any kind. Some chips have little memory.
pub const PORTS: usize = if cfg!(feature = "eight-clients") { 6 } else { 8 };
/// TCP connections of all servers together: sixteen clients (or eight), and one that is accepted before another is closed
/// for it.
pub const CONNECTIONS: usize = if cfg!(feature = "eight-clients") { 9 } else { 17 };
/// Most outgoing connections and UDP servers, together.
pub const CONNECTIONS_OUT: usize = 4;
/// One frame for each connection and each port.
const RESERVED: usize = CONNECTIONS + PORTS;
/// And some for clients that pipeline requests.
const FRAMES: usize = RESERVED + 15;

static SLOTS: [Slot; FRAMES] = [const { Slot::new() }; FRAMES];
static POOL: FramePool<'static> = FramePool::new(&SLOTS, RESERVED);
static PORT_STATES: Ports<PORTS> = Ports::new();
/// Initialised at run time: an unused connection is not all zeros, and a static initialiser would take as much flash.
static CONNECTION_STATES: StaticCell<[Connection; CONNECTIONS]> = StaticCell::new();
// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
static CAPTURE: mobgate::capture::Capture = mobgate::capture::Capture::new();
/// The settings that are being changed, or those to go back to.
#[cfg(feature = "web")] // Only the web interface changes it.
static CANDIDATE: StaticCell<mobgate::gateway::Candidate> = StaticCell::new();
/// Initialised at run time: a static containing a pointer would be copied from the flash as a whole.
static GATEWAY: OnceLock<Gateway<'static>> = OnceLock::new();

/// The gateway.
pub fn gateway() -> &'static Gateway<'static> {
    GATEWAY.get_or_init(|| {
        let connections = CONNECTION_STATES.init_with(|| [const { Connection::new() }; CONNECTIONS]);
        let gateway = Gateway::new(&POOL, &PORT_STATES, connections).with_own_network();
        // Images without it are smaller, see Cargo.toml.
        #[cfg(feature = "audit")]
        let gateway = gateway.with_audit(mobgate_faults::audit_memory());
        #[cfg(feature = "web")]
        let gateway = gateway.with_candidate(CANDIDATE.init_with(mobgate::gateway::Candidate::new));
        #[cfg(feature = "ethercat")]
        let gateway = crate::states::join(gateway).with_capture(&CAPTURE);
        gateway
    })
}

/// The tasks that must respond for the watchdog to be fed.
pub static LIVENESS: Liveness<{ Task::Port as usize + PORTS + CONNECTIONS }> = Liveness::new();

/// Task numbers. The ports and then the connections follow the first port.
#[derive(Clone, Copy)]
pub enum Task {
    /// The network's stack.
    Stack,
    /// The network's sockets.
    Sockets,
    /// The console.
    Console,
    /// The router.
    Router,
    /// The EtherCAT controller.
    // Images without it are smaller, see Cargo.toml.
    #[cfg(feature = "ethercat")]
    Ethercat,
    /// The first port.
    Port,
}

/// The name of a task for people, by its number.
pub struct TaskName(pub usize);

impl fmt::Display for TaskName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: &[&str] = &["network", "sockets", "console", "router", "EtherCAT"];
        const { assert!(Task::Port as usize <= NAMES.len()) };
        match self.0.checked_sub(Task::Port as usize) {
            None => f.write_str(NAMES.get(self.0).unwrap_or(&"")),
            Some(port @ 0..PORTS) => write!(f, "port task {}", port + 1),
            Some(other) => write!(f, "connection task {}", other + 1 - PORTS),
        }
    }
}

/// Starts routing and the connections; the board spawns [`port`] for each of [`PORTS`].
pub fn start(spawner: Spawner, network: Network) {
    // Each pool has room for the tasks spawned here, and this runs once: no `unwrap` can fail.
    spawner.spawn(router().unwrap());
    for index in 0..CONNECTIONS {
        spawner.spawn(connection(index, network).unwrap());
    }
}

#[embassy_executor::task]
async fn router() -> ! {
    LIVENESS.watch(Task::Router as usize, pin!(gateway().route())).await
}

/// Runs port `index` over the board's `lines`.
pub async fn port(index: usize, mut lines: impl SerialHost, network: Network) -> ! {
    let (connector, mut datagrams) = (Connector::new(network.0), Datagrams::new(network.0));
    let run = pin!(gateway().run_port(PortId(index as u8), &mut lines, &connector, &mut datagrams));
    match LIVENESS.watch(Task::Port as usize + index, run).await {}
}

#[embassy_executor::task(pool_size = CONNECTIONS)]
async fn connection(index: usize, network: Network) -> ! {
    let mut sockets = TcpSockets::new(network.0);
    let run = pin!(gateway().run_connection(index, &mut sockets));
    match LIVENESS.watch(Task::Port as usize + PORTS + index, run).await {}
}
