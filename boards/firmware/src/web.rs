//! The web interface: connections beside the local console, in its task, since they share its store and its updater.

use embassy_futures::join::{join, join_array};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::Update;
use mobgate::web;
use mobgate_flash::{FlashStore, SharedStore};
use mobgate_net::TcpSockets;

use crate::gateway::gateway;
use crate::network::WEB_CONNECTIONS;
use crate::system::Board;

/// Serves connections, each with the settings' store in `flash` and an updater of its own, and takes back commits which nobody confirms.
pub(crate) async fn serve<F: NorFlash, U: Update>(
    board: &Board,
    flash: &Mutex<NoopRawMutex, FlashStore<F>>,
    updater: impl Fn() -> U,
) {
    let connection = async |nth| {
        let (mut store, mut update) = (SharedStore::new(flash), updater());
        let mut sockets = TcpSockets::new(board.network.0);
        web::run(gateway(), nth, &mut sockets, (&mut store, &mut update), board).await
    };
    let connections = core::array::from_fn::<_, WEB_CONNECTIONS, _>(&connection);
    join(gateway().watch_commits(), join_array(connections)).await;
}
