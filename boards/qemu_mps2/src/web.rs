//! The web interface: a task for each connection, and one that takes back commits which nobody confirms.

use embassy_executor::Spawner;
use mobgate::web;
use mobgate_net::{Sockets, TcpSockets};

use crate::board::{Board, NO_UPDATE, Store};
use crate::gateway::GATEWAY;
use crate::network::WEB_CONNECTIONS;

#[embassy_executor::task(pool_size = WEB_CONNECTIONS)]
async fn connection(nth: usize, sockets: &'static Sockets, mut store: Store, board: &'static Board) {
    let mut update = NO_UPDATE;
    web::run(&GATEWAY, nth, &mut TcpSockets::new(sockets), (&mut store, &mut update), board).await
}

#[embassy_executor::task]
async fn commits() {
    GATEWAY.watch_commits().await;
}

/// Starts the tasks.
pub(crate) fn start(spawner: Spawner, sockets: &'static Sockets, store: &Store, board: &'static Board) {
    // Spawned once: the task slots are free.
    spawner.spawn(commits().unwrap());
    for nth in 0..WEB_CONNECTIONS {
        spawner.spawn(connection(nth, sockets, store.another(), board).unwrap());
    }
}
