//! A board: its flash with three partitions, its boot loader and its updater, and whoever signs images for it.

use std::cell::RefCell;

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use mobgate::hal::{FirmwareState, Update, UpdateError, Version};
use mobgate_boot::{Layout, State, prepare};
use mobgate_image::{Header, INFO_OFFSET, Info};
use mobgate_update::{Trust, Updater};
use salty::{Keypair, Sha512};

use crate::flash::{Flash, PAGE};

const ACTIVE_PAGES: u32 = 2;

pub(crate) const BOARD: &str = "NUCLEO-TEST";

pub(crate) fn keys() -> Keypair {
    Keypair::from(&[7; 32])
}

/// A firmware of this board: the info block among bytes that follow from `seed`.
pub(crate) fn firmware(board: &str, version: &str, bytes: usize, seed: u8) -> Vec<u8> {
    let mut firmware: Vec<u8> =
        (0..bytes).map(|at| seed ^ (at as u8).wrapping_mul(31) ^ (at >> 8) as u8).collect();
    let info = Info::new(board, version).unwrap().to_bytes();
    firmware[INFO_OFFSET..][..info.len()].copy_from_slice(&info);
    firmware
}

/// The update file of a firmware.
pub(crate) fn file(firmware: &[u8]) -> Vec<u8> {
    let hash = Sha512::new().updated(firmware).finalize();
    let signature = keys().sign(&hash).to_bytes();
    let header = Header { firmware_bytes: firmware.len() as u32, signature };
    [&header.to_bytes()[..], firmware].concat()
}

/// A board with a firmware.
#[derive(Clone)]
pub(crate) struct Board<const ECC: bool> {
    pub(crate) flash: Flash<ECC>,
    pub(crate) running: Vec<u8>,
}

type TestUpdater<'a, const ECC: bool> = Updater<'a, NoopRawMutex, Flash<ECC>, PAGE, PAGE>;

impl<const ECC: bool> Board<ECC> {
    pub(crate) fn new(firmware: Vec<u8>) -> Self {
        let mut flash = Flash::new(2 * ACTIVE_PAGES as usize + 2);
        flash.cells[..firmware.len()].copy_from_slice(&firmware);
        Self { flash, running: firmware }
    }

    pub(crate) fn layout() -> Layout {
        let page = PAGE as u32;
        let update = ACTIVE_PAGES * page..(2 * ACTIVE_PAGES + 1) * page;
        Layout { active: 0..ACTIVE_PAGES * page, state: update.end..update.end + page, update }
    }

    /// What the program does with its updater. `Err` also if the power is cut.
    pub(crate) fn program<R>(
        &mut self,
        act: impl AsyncFnOnce(&mut TestUpdater<'_, ECC>) -> Result<R, UpdateError>,
    ) -> Result<R, UpdateError> {
        let running = Info::of_firmware(&self.running).unwrap();
        let trust = Trust { running, key: Some(keys().public.to_bytes()) };
        let flash = Mutex::new(self.flash.clone());
        let done = block_on(act(&mut Updater::new(&flash, Self::layout(), trust)));
        self.flash = flash.into_inner();
        done
    }

    /// Takes a file, in pieces as a protocol has them.
    pub(crate) fn update(&mut self, file: &[u8]) -> Result<Version, UpdateError> {
        self.program(async |updater| {
            updater.begin(None, false).await?;
            for piece in file.chunks(100) {
                updater.write(piece).await?;
            }
            updater.finish().await
        })
    }

    pub(crate) fn confirm(&mut self) -> Result<(), UpdateError> {
        self.program(async |updater| updater.confirm().await)
    }

    pub(crate) fn state(&mut self) -> FirmwareState {
        self.program(async |updater| updater.firmware("reset").await).unwrap()
    }

    /// Resets the board: the boot loader runs, and starts what is active. `None` if the power was cut meanwhile.
    pub(crate) fn restart(&mut self) -> Option<State> {
        let flash = RefCell::new(self.flash.clone());
        let state = prepare::<_, PAGE, PAGE>(&flash, &Self::layout(), || ());
        self.flash = flash.into_inner();
        let state = state.ok()?;
        self.running = self.flash.cells[..self.running.len()].to_vec();
        Some(state)
    }

    /// Cuts the power at a later operation: 0 is the next one.
    pub(crate) fn cut_at(&mut self, operation: usize) {
        self.flash.cut_at = self.flash.operations + operation;
    }

    pub(crate) fn keep_power(&mut self) {
        self.flash.cut_at = usize::MAX;
    }
}
