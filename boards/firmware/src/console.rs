//! The console over a board's terminal.

use core::pin::pin;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::console::{self, Mode};
use mobgate::hal::NoUpdate;
use mobgate_flash::{FlashStore, Image, SharedStore};

use crate::gateway::{LIVENESS, Task, gateway};
use crate::start;
use crate::system::Board;

/// Where a person types.
pub trait Terminal: Read + Write {
    /// Waits for somebody, where that can be known.
    async fn opened(&mut self) {}
}

/// Without a boot loader.
fn by_probe() -> NoUpdate {
    NoUpdate("this board does not take updates yet: flash it")
}

/// Applies the settings in `flash`, whose two sectors begin at `settings`, or deletes them if `forget`, and serves the console.
/// Board and terminal are borrowed, because a future stores its arguments twice.
pub async fn run(
    board: &mut Board,
    terminal: &mut impl Terminal,
    flash: impl NorFlash,
    settings: u32,
    forget: bool,
) {
    let serve = pin!(serve(board, terminal, flash, settings, forget));
    LIVENESS.watch(Task::Console as usize, serve).await
}

async fn serve(
    board: &mut Board,
    terminal: &mut impl Terminal,
    flash: impl NorFlash,
    settings: u32,
    forget: bool,
) {
    // If the flash has failed, the console still runs and the store reports it.
    let flash = Mutex::<NoopRawMutex, _>::new(FlashStore::open(flash, settings, Image::ONLY).await);
    let mut store = SharedStore::new(&flash);
    board.settings = start::settings(&mut store, forget).await.err();
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
    }
    let sessions = pin!(async {
        loop {
            terminal.opened().await;
            // `exit` starts a new session, and so does a terminal that was unplugged.
            let _ = console::run(gateway(), &mut *terminal, &mut store, &mut by_probe(), &*board, Mode::Echo)
                .await;
            store = SharedStore::new(&flash);
        }
    });
    // An EtherCAT MainDevice may also request a save. In an image without EtherCAT this would finish at once, but its code and
    // memory would remain.
    #[cfg(feature = "ethercat")]
    let sessions = async {
        let mut kept = SharedStore::new(&flash);
        let keep = pin!(gateway().keep_settings(&mut kept));
        embassy_futures::join::join(keep, sessions).await;
    };
    sessions.await;
}
