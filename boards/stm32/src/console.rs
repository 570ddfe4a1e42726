//! The console on the ST-LINK's virtual COM port: 115200 8N1.

use core::pin::pin;

use embassy_executor::Spawner;
use mobgate::config::{LineSettings, Parity};
use mobgate::console::{self, Mode};
use mobgate::hal::{Store, StoreError};
use mobgate_flash::FlashStore;

use crate::flash::{SETTINGS_START, SettingsFlash};
use crate::gateway::{LIVENESS, Task, gateway};
use crate::line::Line;
use crate::start;
use crate::system::Board;

const LINE: LineSettings = LineSettings { baud: 115_200, parity: Parity::None, ..LineSettings::DEFAULT };

/// Takes the settings in `flash` over, unless the button was held, and serves the console on `line`.
pub fn start(spawner: Spawner, board: Board, line: Line, flash: SettingsFlash, forget: bool) {
    // Spawned once: its place is free.
    spawner.spawn(run(board, line, flash, forget).unwrap());
}

#[embassy_executor::task]
async fn run(mut board: Board, mut line: Line, flash: SettingsFlash, forget: bool) {
    // Lent and not moved: what a future is given it keeps twice.
    LIVENESS.watch(Task::Console as usize, pin!(serve(&mut board, &mut line, flash, forget))).await
}

async fn serve(board: &mut Board, line: &mut Line, flash: SettingsFlash, forget: bool) {
    // It is a format that every chip has.
    line.configure(&LINE).unwrap();
    let mut store = Settings(FlashStore::open(flash, SETTINGS_START).await);
    board.settings = start::settings(&mut store, forget).await.err();
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
    }
    loop {
        // A line never ends; `exit` begins a new session.
        let _ = console::run(gateway(), &mut *line, &mut store, &*board, Mode::Echo).await;
        store.0.iter_mut().for_each(FlashStore::forget);
    }
}

/// The store, or why there is none: a flash that failed leaves the console running.
struct Settings(Result<FlashStore<SettingsFlash>, StoreError>);

impl Settings {
    fn store(&mut self) -> Result<&mut FlashStore<SettingsFlash>, StoreError> {
        self.0.as_mut().map_err(|error| *error)
    }
}

impl Store for Settings {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        self.store()?.read(offset, into).await
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        self.store()?.append(text).await
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        self.store()?.commit().await
    }
}
