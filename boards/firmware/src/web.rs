//! The web interface: connections beside the local console, in its task, since they share its store and its updater.

use embassy_futures::join::{join, join_array};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::Update;
use mobgate::web;
use mobgate_flash::{FlashStore, SharedStore};
use mobgate_net::TcpSockets;

use crate::gateway::{WEB_CONNECTIONS, gateway};
use crate::system::Board;

/// Serves connections, each with the settings' store in `flash` and an updater of its own, and takes back commits that nobody
/// confirms.
pub(crate) async fn serve<F: NorFlash, U: Update>(
    board: &Board,
    flash: &Mutex<NoopRawMutex, FlashStore<F>>,
    updater: impl Fn() -> U,
) {
    let updater = &updater;
    let serve_one = |nth| async move {
        let (mut sockets, mut store) = (TcpSockets::new(board.network.0), SharedStore::new(flash));
        web::run(gateway(), nth, &mut sockets, (&mut store, &mut updater()), board).await;
    };
    let connections = core::array::from_fn::<_, WEB_CONNECTIONS, _>(serve_one);
    join(gateway().watch_commits(), join_array(connections)).await;
}
