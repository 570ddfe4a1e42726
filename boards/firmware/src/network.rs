//! The network: stack and sockets on the board's Ethernet driver. The stack notices a cable change within half a second.

use core::pin::pin;

use embassy_executor::Spawner;
use embassy_futures::join::join3;
use embassy_net::StackResources;
use embassy_net::driver::Driver;
use mobgate::settings::OwnNetwork;
use mobgate_net::{Backlog, Queued, STACK_SOCKETS, Sockets, address, mdns};
use static_cell::{ConstStaticCell, StaticCell};

use crate::gateway::{CONNECTIONS, CONNECTIONS_OUT, LIVENESS, Task, gateway};
pub use crate::sockets::Network;

/// Connections of the web interface: as many as a browser opens for a page, in an image with it.
pub(crate) const WEB_CONNECTIONS: usize = if cfg!(feature = "web") { 6 } else { 0 };
/// Open sockets: incoming and outgoing connections, and UDP.
const SOCKETS: usize = CONNECTIONS + CONNECTIONS_OUT + WEB_CONNECTIONS;
/// The longest Modbus TCP frame for each direction.
const SOCKET_BYTES: usize = 2 * 260;

static BUFFERS: ConstStaticCell<[[u8; SOCKET_BYTES]; SOCKETS]> =
    ConstStaticCell::new([[0; SOCKET_BYTES]; SOCKETS]);
static RESOURCES: StaticCell<StackResources<{ SOCKETS + STACK_SOCKETS }>> = StaticCell::new();
static BACKLOG: ConstStaticCell<Backlog> = ConstStaticCell::new(Backlog::new());
static POOL: StaticCell<Sockets> = StaticCell::new();

/// Runs the stack on a driver.
pub type Runner<D> = embassy_net::Runner<'static, Queued<D>>;

/// Starts the stack on `driver`, with DHCP until the settings are applied. The board runs [`stack`] as a task. `unique`, the chip's
/// number, keeps boards from sending DHCP requests in step and from starting with the same TCP port.
pub fn start<D: Driver>(spawner: Spawner, driver: D, unique: &[u8]) -> (Network, Runner<D>) {
    // Need not be secret.
    let seed = unique.iter().fold(0, |seed: u64, &byte| seed.rotate_left(5) ^ u64::from(byte));
    let config = address::stack_config(&OwnNetwork::DEFAULT);
    let backlog: &'static Backlog = BACKLOG.take();
    let driver = Queued::new(driver, backlog);
    let (stack, runner) = embassy_net::new(driver, config, RESOURCES.init_with(StackResources::new), seed);
    let sockets: &'static Sockets = POOL.init(Sockets::new(stack, backlog, BUFFERS.take()));
    // Spawned once: the task slot is free.
    spawner.spawn(run_sockets(sockets).unwrap());
    (Network(sockets), runner)
}

/// Runs the stack. The runner is borrowed, because a future stores its arguments twice.
pub async fn stack<D: Driver>(runner: &mut Runner<D>) -> ! {
    LIVENESS.watch(Task::Stack as usize, pin!(runner.run())).await
}

#[embassy_executor::task]
async fn run_sockets(sockets: &'static Sockets) -> ! {
    let (gateway, stack) = (gateway(), sockets.stack());
    // An image without an audit trail has nothing to send.
    #[cfg(feature = "audit")]
    let mdns =
        embassy_futures::join::join(mdns::run(gateway, stack), mobgate_net::follow_audit(gateway, sockets));
    #[cfg(not(feature = "audit"))]
    let mdns = mdns::run(gateway, stack);
    let all = pin!(join3(sockets.run(), address::follow(gateway, stack), mdns));
    let (never, ..) = LIVENESS.watch(Task::Sockets as usize, all).await;
    never
}
