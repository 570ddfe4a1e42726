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

/// Takes the settings in `flash` over, unless the button was held, and serves the console on `line`.
pub(crate) fn start(spawner: Spawner, board: Board, line: Line, flash: SettingsFlash, forget: bool) {
    // Spawned once: the slot of the task is free.
    spawner.spawn(run(board, line, flash, forget).unwrap());
}

#[embassy_executor::task]
async fn run(mut board: Board, mut line: Line, flash: SettingsFlash, forget: bool) {
    // Lent and not moved: what a future is given it keeps twice.
    LIVENESS.watch(Task::Console as usize, pin!(serve(&mut board, &mut line, flash, forget))).await
}

async fn serve(board: &mut Board, line: &mut Line, flash: SettingsFlash, forget: bool) {
    // It is a format that every chip has.
    // The kind tells enough: its hint as text would bring the tables of Unicode, 3 KiB, into the image.
    line.configure(&LINE).map_err(|error| error.kind).unwrap();
    // A flash that failed leaves the console running: the store says so.
    let flash = Mutex::<NoopRawMutex, _>::new(FlashStore::open(flash, SETTINGS_START).await);
    let mut store = SharedStore::new(&flash);
    board.settings = start::settings(&mut store, forget).await.err();
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
    }
    let sessions = pin!(async {
        loop {
            // A line never ends; `exit` begins a new session.
            let _ = console::run(gateway(), &mut *line, &mut store, &*board, Mode::Echo).await;
            store = SharedStore::new(&flash);
        }
    });
    // An EtherCAT MainDevice may want them saved too. In an image without EtherCAT that would end at once, but its code and its memory
    // would stay.
    #[cfg(feature = "ethercat")]
    let sessions = async {
        let mut kept = SharedStore::new(&flash);
        let keep = pin!(gateway().keep_settings(&mut kept));
        embassy_futures::join::join(keep, sessions).await;
    };
    sessions.await;
}
