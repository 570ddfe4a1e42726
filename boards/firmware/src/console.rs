//! The console over a board's terminal.

use core::pin::pin;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::console::{self, Mode};
use mobgate::gateway::audit::{Actor, Topic};
use mobgate::hal::SharedUpdate;
use mobgate_flash::{FlashStore, SharedStore};

use crate::gateway::{LIVENESS, Task, gateway};
use crate::system::Board;
use crate::trial::Firmware;
// Without EtherCAT nothing waits.
#[cfg(feature = "ethercat")]
use crate::waiting::Shown;
use crate::{start, trial};

/// Where a person types.
pub trait Terminal: Read + Write {
    /// Waits for a peer, where the board can detect one.
    async fn opened(&mut self) {}
}

/// Applies the settings in `flash`, whose two sectors begin at `settings`, or deletes them if `forget`, and serves the console.
/// `firmware` takes new firmware, and if what runs is on trial, that ends here.
/// What is large is borrowed, because a future stores its arguments twice.
pub async fn run(
    board: &mut Board,
    terminal: &mut impl Terminal,
    flash: impl NorFlash,
    settings: u32,
    firmware: &Mutex<NoopRawMutex, impl Firmware>,
    forget: bool,
) -> ! {
    let serve = pin!(serve(board, terminal, flash, settings, firmware, forget));
    LIVENESS.watch(Task::Console as usize, serve).await
}

async fn serve(
    board: &mut Board,
    terminal: &mut impl Terminal,
    flash: impl NorFlash,
    settings: u32,
    firmware: &Mutex<NoopRawMutex, impl Firmware>,
    forget: bool,
) -> ! {
    let image = trial::image(board, &mut *firmware.lock().await).await;
    // If the flash has failed, the console still runs and the store reports it.
    let flash = Mutex::<NoopRawMutex, _>::new(FlashStore::open(flash, settings, image).await);
    let mut store = SharedStore::new(&flash);
    board.settings = start::settings(&mut store, forget).await.err();
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
        gateway().audit(Topic::Start, Actor::System, format_args!("settings {problem}"));
    }
    let board: &Board = board;
    let trial = pin!(trial::run(board, firmware, &flash));
    let updater = || {
        let update = SharedUpdate::new(firmware);
        // Without EtherCAT a restart follows at once.
        #[cfg(feature = "ethercat")]
        let update = Shown::new(update, board);
        update
    };
    let sessions = pin!(async {
        let mut update = updater();
        loop {
            terminal.opened().await;
            // `exit` starts a new session, and so does a terminal that was unplugged.
            let _ = console::run(gateway(), &mut *terminal, &mut store, &mut update, board, Mode::Echo).await;
            store = SharedStore::new(&flash);
        }
    });
    // In an image without EtherCAT this would finish at once, but its code and memory would remain.
    #[cfg(feature = "ethercat")]
    let sessions = async {
        let device = pin!(serve_main_device(board, &flash, updater()));
        embassy_futures::join::join(device, sessions).await.1
    };
    // As its feature.
    #[cfg(feature = "ssh")]
    let sessions = async {
        let guests = pin!(crate::ssh::serve(board, &flash, updater));
        embassy_futures::join::join(guests, sessions).await.1
    };
    // As its feature.
    #[cfg(feature = "web")]
    let sessions = async {
        let web = pin!(crate::web::serve(board, &flash, updater));
        embassy_futures::join::join(web, sessions).await.1
    };
    embassy_futures::join::join(trial, sessions).await.1
}

/// Does what an EtherCAT MainDevice requests: a save, new firmware, and files where the image has them.
#[cfg(feature = "ethercat")] // As what calls it.
async fn serve_main_device<F: NorFlash>(
    board: &Board,
    flash: &Mutex<NoopRawMutex, FlashStore<F>>,
    mut update: impl mobgate::hal::Update,
) {
    let mut store = SharedStore::new(flash);
    let keep = pin!(gateway().keep_settings(&mut store));
    let take = pin!(gateway().take_firmware(&crate::states::FILES, &mut update, board));
    // As its feature.
    #[cfg(feature = "files")]
    let take = async {
        let mut store = SharedStore::new(flash);
        let files = pin!(console::serve_files(gateway(), &crate::states::FILES, &mut store, board));
        embassy_futures::join::join(files, take).await;
    };
    embassy_futures::join::join(keep, take).await;
}
