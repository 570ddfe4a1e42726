//! The network: embassy-net over the Ethernet controller, and the gateway's sockets on top.

use embassy_executor::Spawner;
use embassy_futures::join::join4;
use embassy_net::{Runner, StackResources};
use mobgate::settings::OwnNetwork;
use mobgate_net::{Backlog, Queued, STACK_SOCKETS, Sockets, address, mdns};
use static_cell::{ConstStaticCell, StaticCell};

use crate::ethernet::Ethernet;
use crate::gateway::{CONNECTIONS, GATEWAY};
use crate::semihosting;

/// Most outgoing connections and UDP servers, together.
const CLIENTS: usize = 4;
/// Connections of the web interface: as many as it has, in an image with it.
pub(crate) const WEB_CONNECTIONS: usize = if cfg!(feature = "web") { 8 } else { 0 };
const SOCKETS: usize = CONNECTIONS + CLIENTS + WEB_CONNECTIONS;
/// Two frames of Modbus TCP in each direction, and some spare.
const SOCKET_BYTES: usize = 2 * 640;

/// Starts the network with this setting. Its tasks are to be [spawned](spawn).
pub(crate) fn start(setting: &OwnNetwork) -> (&'static Sockets, Runner<'static, Queued<Ethernet>>) {
    static RESOURCES: StaticCell<StackResources<{ SOCKETS + STACK_SOCKETS }>> = StaticCell::new();
    static BUFFERS: ConstStaticCell<[[u8; SOCKET_BYTES]; SOCKETS]> =
        ConstStaticCell::new([[0; SOCKET_BYTES]; SOCKETS]);
    static BACKLOG: ConstStaticCell<Backlog> = ConstStaticCell::new(Backlog::new());
    static POOL: StaticCell<Sockets> = StaticCell::new();
    // Otherwise connections after a restart would reuse ports and sequence numbers.
    let seed = semihosting::host_time() as u64;
    let config = address::stack_config(setting);
    let backlog: &'static Backlog = BACKLOG.take();
    let driver = Queued::new(Ethernet::start(), backlog);
    let (stack, runner) = embassy_net::new(driver, config, RESOURCES.init(StackResources::new()), seed);
    (POOL.init(Sockets::new(stack, backlog, BUFFERS.take())), runner)
}

/// Starts the network's tasks, once.
pub(crate) fn spawn(spawner: Spawner, runner: Runner<'static, Queued<Ethernet>>, sockets: &'static Sockets) {
    // Spawned once: the task slots are free.
    spawner.spawn(run(runner).unwrap());
    spawner.spawn(care(sockets).unwrap());
}

#[embassy_executor::task]
async fn run(mut runner: Runner<'static, Queued<Ethernet>>) {
    runner.run().await
}

/// The network's background jobs: the audit trail, closing connections, following the settings, multicast DNS, and logging the link state.
#[embassy_executor::task]
async fn care(sockets: &'static Sockets) {
    let stack = sockets.stack();
    let announce = async {
        loop {
            stack.wait_config_up().await;
            if let Some(own) = address::state(stack).address {
                log::info!("network up, address {own}");
            }
            stack.wait_config_down().await;
            log::info!("network down");
        }
    };
    let all = join4(sockets.run(), address::follow(&GATEWAY, stack), mdns::run(&GATEWAY, stack), announce);
    // The image without an audit trail has nothing to send.
    #[cfg(feature = "audit")]
    let all = embassy_futures::join::join(all, mobgate_net::follow_audit(&GATEWAY, sockets));
    all.await;
}
