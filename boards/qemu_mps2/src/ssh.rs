//! The console by SSH: a task for each session, and the host key.

use core::net::IpAddr;

use embassy_executor::Spawner;
use embassy_futures::block_on;
use mobgate::hal::System;
use mobgate::settings::PortId;
use mobgate_net::{SSH_SESSIONS_MAX, Sockets, TcpStream};
use mobgate_ssh::{SEED_BYTES, Visit, serve};
use static_cell::StaticCell;

use crate::board::{Board, NO_UPDATE, Store};
use crate::gateway::GATEWAY;

/// Concurrent sessions.
const SESSIONS: usize = SSH_SESSIONS_MAX;

#[embassy_executor::task(pool_size = SESSIONS)]
async fn session(
    task: usize,
    sockets: &'static Sockets,
    store: Store,
    board: &'static Board,
    seed: &'static [u8; SEED_BYTES],
) {
    let serve_one = async |stream: &mut TcpStream, port: PortId, peer: IpAddr, logged_in: &dyn Fn()| {
        let store = store.another();
        let own = mobgate_ssh::Board { seed, system: board, passwords: true, store, update: NO_UPDATE };
        if let Err(error) = serve(&GATEWAY, stream, Visit { peer, port }, own, logged_in).await {
            log::debug!("SSH connection of {peer}: {error:?}");
        }
    };
    sockets.serve_ssh(task, serve_one).await
}

/// Starts the tasks. The host key is made at the first start.
pub(crate) fn start(spawner: Spawner, sockets: &'static Sockets, mut store: Store, board: &'static Board) {
    static SEED: StaticCell<[u8; SEED_BYTES]> = StaticCell::new();
    match block_on(store.secret(|seed| board.random(seed))) {
        Ok(seed) => {
            let seed = SEED.init(seed);
            for task in 0..SESSIONS {
                // Spawned once: the task slots are free.
                spawner.spawn(session(task, sockets, store.another(), board, seed).unwrap());
            }
        }
        Err(error) => log::error!("no SSH without a host key: {error}"),
    }
}
