//! The console on the ST-LINK's virtual COM port: 115200 8N1.

use core::pin::pin;

use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use mobgate::console::{self, Mode};
use mobgate::settings::{LineSettings, Parity};
use mobgate_flash::{FlashStore, SharedStore};

use crate::flash::{SETTINGS_START, SettingsFlash};
use crate::gateway::{LIVENESS, Task, gateway};
use crate::line::Line;
use crate::start;
use crate::system::Board;

const LINE: LineSettings = LineSettings { baud: 115_200, parity: Parity::None, ..LineSettings::DEFAULT };

/// Applies the settings in `flash`, or deletes them if `forget`, and serves the console on `line`.
pub(crate) fn start(spawner: Spawner, board: Board, line: Line, flash: SettingsFlash, forget: bool) {
    // Spawned once: the task slot is free.
    spawner.spawn(run(board, line, flash, forget).unwrap());
}

#[embassy_executor::task]
async fn run(mut board: Board, mut line: Line, flash: SettingsFlash, forget: bool) {
    // Borrowed, because a future stores its arguments twice.
    LIVENESS.watch(Task::Console as usize, pin!(serve(&mut board, &mut line, flash, forget))).await
}

async fn serve(board: &mut Board, line: &mut Line, flash: SettingsFlash, forget: bool) {
    // Every chip supports this format. Only the error's kind, because formatting its hint would pull the Unicode tables (3 KiB)
    // into the image.
    line.configure(&LINE).map_err(|error| error.kind).unwrap();
    // If the flash has failed, the console still runs and the store reports it.
    let flash = Mutex::<NoopRawMutex, _>::new(FlashStore::open(flash, SETTINGS_START).await);
    let mut store = SharedStore::new(&flash);
    board.settings = start::settings(&mut store, forget).await.err();
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
    }
    let sessions = pin!(async {
        loop {
            // A line never ends; `exit` starts a new session.
            let _ = console::run(gateway(), &mut *line, &mut store, &*board, Mode::Echo).await;
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
