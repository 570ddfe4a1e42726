//! The console by SSH: sessions beside the local one, in its task, since they share its store and its updater.

use core::net::IpAddr;

use embassy_futures::join::join_array;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{System, Update};
use mobgate::settings::PortId;
use mobgate_flash::{FlashStore, SharedStore};
use mobgate_net::{SSH_SESSIONS_MAX, TcpStream};
use mobgate_ssh::Visit;

use crate::gateway::gateway;
use crate::system::Board;

/// Serves sessions, each with the settings' store in `flash` and an updater of its own. The host key is made at the first start.
pub(crate) async fn serve<F: NorFlash, U: Update>(
    board: &Board,
    flash: &Mutex<NoopRawMutex, FlashStore<F>>,
    updater: impl Fn() -> U,
) {
    let made = SharedStore::new(flash).secret(|seed| board.random(seed)).await;
    let seed = match &made {
        Ok(seed) => seed,
        Err(error) => return defmt::error!("no SSH without a host key: {}", defmt::Display2Format(error)),
    };
    let serve_one = async |stream: &mut TcpStream, port: PortId, peer: IpAddr, logged_in: &dyn Fn()| {
        let (store, update) = (SharedStore::new(flash), updater());
        let own = mobgate_ssh::Board { seed, system: board, passwords: true, store, update };
        // The client has been told why.
        let _ = mobgate_ssh::serve(gateway(), stream, Visit { peer, port }, own, logged_in).await;
    };
    let sessions =
        core::array::from_fn::<_, SSH_SESSIONS_MAX, _>(|task| board.network.0.serve_ssh(task, &serve_one));
    join_array(sessions).await;
}
