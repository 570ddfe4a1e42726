//! The trial of new firmware: it is confirmed once it has shown that it works; or else the board starts again, and goes back.
//!
//! It has shown that when the settings were read, the network's hardware was found (its driver is ready; a cable need not be in), and every
//! task, the console's among them, has answered for some seconds. A fault, a panic or the watchdog end the trial as well.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Instant, Timer};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{FirmwareState, NoUpdate, System, Update, UpdateError};
use mobgate_flash::{FlashStore, Image};
use mobgate_update::{Reason, Updater};
use static_cell::StaticCell;

use crate::start::Problem;
use crate::system::Board;

/// What has not proved itself by then goes back.
const TRIAL_MAX: Duration = Duration::from_secs(60);
/// How often in a row every task must have answered: for five seconds.
const RESPONSES: u32 = 10;
/// How often the trial looks.
const PERIOD: Duration = Duration::from_millis(500);

/// How often in a row every task has answered.
static ANSWERED: AtomicU32 = AtomicU32::new(0);
static HAS_NETWORK: AtomicBool = AtomicBool::new(false);

/// The network's driver has found its hardware.
pub fn found_network() {
    HAS_NETWORK.store(true, Ordering::Relaxed);
}

/// Whether every task has answered in time.
pub(crate) fn note_responses(all: bool) {
    // Only the watchdog's loop writes it.
    let before = if all { ANSWERED.load(Ordering::Relaxed) } else { 0 };
    ANSWERED.store(before.saturating_add(all.into()), Ordering::Relaxed);
}

/// A board's firmware: takes new one, and knows how what runs came to run.
pub trait Firmware: Update {
    /// A number of the image that runs, which others do not have, and its state; `why` the board was started.
    async fn origin(&mut self, why: Reason) -> Result<(u32, FirmwareState), UpdateError>;

    /// Confirms what runs on trial.
    async fn confirm(&mut self) -> Result<(), UpdateError>;
}

impl Firmware for NoUpdate {
    async fn origin(&mut self, _why: Reason) -> Result<(u32, FirmwareState), UpdateError> {
        Err(UpdateError::Absent(self.0))
    }

    async fn confirm(&mut self) -> Result<(), UpdateError> {
        Ok(())
    }
}

impl<M: RawMutex, F: NorFlash, const PAGE: usize, const STATE_PAGE: usize> Firmware
    for Updater<'_, M, F, PAGE, STATE_PAGE>
{
    async fn origin(&mut self, why: Reason) -> Result<(u32, FirmwareState), UpdateError> {
        static WHY: StaticCell<Reason> = StaticCell::new();
        let id = self.id().await?;
        let why = self.reason(why).await?;
        // Asked once, at the start.
        let why = why.and_then(|why| WHY.try_init(why)).map_or("", |why| why.as_str());
        Ok((id, self.firmware(why).await?))
    }

    fn confirm(&mut self) -> impl Future<Output = Result<(), UpdateError>> {
        Updater::confirm(self)
    }
}

/// The image that runs, as the settings' store needs to know it. Its state is `board`'s from here on.
pub(crate) async fn image(board: &Board, firmware: &mut impl Firmware) -> Image {
    match firmware.origin(board.why()).await {
        Ok((id, state)) => {
            let confirmed = state != FirmwareState::OnTrial;
            board.set_firmware(state);
            Image { id, confirmed }
        }
        // Without a boot loader, or with a flash that fails.
        Err(_) => Image::ONLY,
    }
}

/// Ends the trial of what runs, if it is on trial: confirms it with the settings that it has saved, or starts the board again.
pub(crate) async fn run<F: NorFlash>(
    board: &Board,
    firmware: &Mutex<NoopRawMutex, impl Firmware>,
    store: &Mutex<NoopRawMutex, FlashStore<F>>,
) {
    if board.firmware() != Some(FirmwareState::OnTrial) {
        return;
    }
    let ended = match prove(board).await {
        Ok(()) => confirm(firmware, store).await,
        Err(fault) => Err(fault),
    };
    match ended {
        Ok(()) => {
            defmt::info!("the firmware is confirmed");
            board.set_firmware(FirmwareState::Confirmed);
        }
        Err(fault) => {
            mobgate_faults::note(format_args!("on trial {fault}"));
            board.reboot();
        }
    }
}

async fn confirm<F: NorFlash>(
    firmware: &Mutex<NoopRawMutex, impl Firmware>,
    store: &Mutex<NoopRawMutex, FlashStore<F>>,
) -> Result<(), &'static str> {
    // Settings cannot be saved meanwhile.
    let mut store = store.lock().await;
    firmware.lock().await.confirm().await.map_err(|_| "the flash failed")?;
    // What fails here is done at the next start.
    let _ = store.confirm().await;
    Ok(())
}

/// Waits until the firmware has proved itself. What it fails in, after [`TRIAL_MAX`].
async fn prove(board: &Board) -> Result<(), &'static str> {
    let begun = Instant::now();
    loop {
        let fault = if !matches!(board.settings, None | Some(Problem::Forgotten)) {
            "the settings were not taken over"
        } else if !HAS_NETWORK.load(Ordering::Relaxed) {
            "the network's hardware was not found"
        } else if ANSWERED.load(Ordering::Relaxed) < RESPONSES {
            "a task did not respond"
        } else {
            return Ok(());
        };
        if begun.elapsed() > TRIAL_MAX {
            return Err(fault);
        }
        Timer::after(PERIOD).await;
    }
}
