//! The console on the ST-LINK's virtual COM port: 115200 8N1.

use embassy_executor::Spawner;
use mobgate::config::{LineSettings, Parity};
use mobgate::console::{self, Mode};
use mobgate::hal::{Store, StoreError};
use mobgate_flash::FlashStore;

use crate::flash::{SETTINGS_START, SettingsFlash};
use crate::gateway::{GATEWAY, LIVENESS, Task};
use crate::line::Line;
use crate::start::{self, Problem};
use crate::system::Board;

const LINE: LineSettings = LineSettings { baud: 115_200, parity: Parity::None, ..LineSettings::DEFAULT };

/// Takes the settings in `flash` over, unless the button was held, and serves the console on `line`.
pub fn start(spawner: Spawner, board: Board, line: Line, flash: SettingsFlash, forget: bool) {
    // Spawned once: its place is free.
    spawner.spawn(run(board, line, flash, forget).unwrap());
}

#[embassy_executor::task]
async fn run(board: Board, line: Line, flash: SettingsFlash, forget: bool) {
    LIVENESS.watch(Task::Console as usize, serve(board, line, flash, forget)).await
}

async fn serve(mut board: Board, mut line: Line, flash: SettingsFlash, forget: bool) {
    // It is a format that every chip has.
    line.configure(&LINE).unwrap();
    let mut store = FlashStore::open(flash, SETTINGS_START).await;
    board.settings = match &mut store {
        Ok(store) => start::settings(store, forget).await.err(),
        Err(error) => Some(Problem::Store(*error)),
    };
    if let Some(problem) = &board.settings {
        defmt::warn!("settings: {}", defmt::Display2Format(problem));
    }
    loop {
        // A line never ends; `exit` begins a new session.
        let _ = match &mut store {
            Ok(store) => {
                store.forget();
                console::run(&GATEWAY, &mut line, store, &board, Mode::Echo).await
            }
            Err(error) => console::run(&GATEWAY, &mut line, &mut Broken(*error), &board, Mode::Echo).await,
        };
    }
}

/// The store of a board whose flash failed.
struct Broken(StoreError);

impl Store for Broken {
    async fn read(&mut self, _offset: usize, _into: &mut [u8]) -> Result<usize, StoreError> {
        Err(self.0)
    }

    async fn append(&mut self, _text: &[u8]) -> Result<(), StoreError> {
        Err(self.0)
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        Err(self.0)
    }
}
