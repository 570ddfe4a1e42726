//! [`Updater`]: one update file after the other, and the state of what runs.

use core::fmt::Write;

use embassy_boot::{FirmwareState, FirmwareUpdaterError, State};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use mobgate::hal::{self, Update, UpdateError, Version};
use mobgate_boot::Layout;
use mobgate_image::{
    HEADER_BYTES, Header, INFO_BYTES, INFO_OFFSET, Info, PUBLIC_KEY_BYTES, Receiver, Refused,
};
use salty::{PublicKey, Signature};

use crate::partition::Partition;
use crate::writer::Writer;

/// Longest word of a flash.
const WORD_BYTES_MAX: usize = 64;

/// Whose images a board takes.
#[derive(Debug, Clone, Copy)]
pub struct Trust {
    /// The image that runs: board and version.
    pub running: Info,
    /// The ed25519 key; without one no image is taken.
    pub key: Option<[u8; PUBLIC_KEY_BYTES]>,
}

/// A file that is being received.
struct File {
    receiver: Receiver,
    writer: Writer,
}

/// New firmware for the partitions `layout` of `flash`, which others share: images are erased in pages of `PAGE` bytes, the state in pages of
/// `STATE_PAGE`.
pub struct Updater<'a, M: RawMutex, F, const PAGE: usize, const STATE_PAGE: usize> {
    pub(crate) flash: &'a Mutex<M, F>,
    pub(crate) layout: Layout,
    trust: Trust,
    /// The file that is being received.
    file: Option<File>,
    /// The image that the next restart starts.
    next: Option<Version>,
}

impl<'a, M: RawMutex, F: NorFlash, const PAGE: usize, const STATE_PAGE: usize>
    Updater<'a, M, F, PAGE, STATE_PAGE>
{
    /// Nothing is received yet.
    pub const fn new(flash: &'a Mutex<M, F>, layout: Layout, trust: Trust) -> Self {
        Self { flash, layout, trust, file: None, next: None }
    }

    /// The state of what runs. `why` it was started again, if it has gone back.
    ///
    /// # Errors
    /// The flash fails.
    pub async fn firmware(&mut self, why: &'static str) -> Result<hal::FirmwareState, UpdateError> {
        if let Some(next) = &self.next {
            return Ok(hal::FirmwareState::Next(next.clone()));
        }
        Ok(match self.state().await? {
            State::Swap => hal::FirmwareState::OnTrial,
            State::Revert => hal::FirmwareState::WentBack { from: self.version_before().await, why },
            State::Boot | State::DfuDetach => hal::FirmwareState::Confirmed,
        })
    }

    /// Confirms the image that runs on trial, or forgets one that waits.
    ///
    /// # Errors
    /// The flash fails.
    pub async fn confirm(&mut self) -> Result<(), UpdateError> {
        self.kept_state(&mut [0; WORD_BYTES_MAX]).mark_booted().await.map_err(failed)
    }

    pub(crate) async fn state(&mut self) -> Result<State, UpdateError> {
        self.kept_state(&mut [0; WORD_BYTES_MAX]).get_state().await.map_err(failed)
    }

    /// The state in the flash; `word` is for a word of it.
    fn kept_state<'w>(
        &self,
        word: &'w mut [u8; WORD_BYTES_MAX],
    ) -> FirmwareState<'w, Partition<'a, M, F, STATE_PAGE>> {
        const { assert!(F::WRITE_SIZE <= WORD_BYTES_MAX && F::READ_SIZE <= F::WRITE_SIZE) };
        FirmwareState::new(Partition::new(self.flash, self.layout.state.clone()), &mut word[..F::WRITE_SIZE])
    }

    fn partition(&self) -> Partition<'a, M, F, PAGE> {
        Partition::new(self.flash, self.layout.update.clone())
    }

    /// The version of the image in the update's partition, if there is one.
    async fn version_before(&mut self) -> Option<Version> {
        let mut info = [0; INFO_BYTES];
        self.partition().read(INFO_OFFSET as u32, &mut info).await.ok()?;
        Some(text(&Info::from_bytes(&info)?))
    }

    fn is_signed(&self, hash: &[u8; 64], header: &Header) -> bool {
        let verified = |key: [u8; PUBLIC_KEY_BYTES]| {
            let key = PublicKey::try_from(&key).ok()?;
            key.verify(hash, &Signature::from(&header.signature)).ok()
        };
        self.trust.key.and_then(verified).is_some()
    }
}

impl<M: RawMutex, F: NorFlash, const PAGE: usize, const STATE_PAGE: usize> Update
    for Updater<'_, M, F, PAGE, STATE_PAGE>
{
    async fn begin(&mut self, bytes: Option<u32>, allow_older: bool) -> Result<(), UpdateError> {
        self.discard();
        if self.trust.key.is_none() {
            return Err(UpdateError::Absent("this firmware was built without a key for signatures"));
        }
        let most = self.layout.active.len() as u32;
        if bytes.is_some_and(|bytes| bytes > most + HEADER_BYTES as u32) {
            return Err(UpdateError::TooLong);
        }
        if self.next.take().is_some() {
            // The boot loader must not swap in what is written from now on.
            self.confirm().await?;
        } else if self.state().await? == State::Swap {
            return Err(UpdateError::OnTrial);
        }
        let receiver = Receiver::new(self.trust.running, most, allow_older);
        self.file = Some(File { receiver, writer: Writer::new() });
        Ok(())
    }

    async fn write(&mut self, mut bytes: &[u8]) -> Result<(), UpdateError> {
        let mut partition = self.partition();
        let pending = Pending(&mut self.file);
        let File { receiver, writer } = pending.0.as_mut().ok_or(UpdateError::Truncated)?;
        loop {
            let room = match receiver.progress() {
                (received, Some(all)) => (all - received) as usize,
                // A firmware is longer than this.
                (_, None) => HEADER_BYTES,
            };
            let (now, later) = bytes.split_at(bytes.len().min(room));
            if now.is_empty() {
                break;
            }
            let firmware = receiver.take(now).map_err(error)?;
            writer.write(&mut partition, firmware).await?;
            bytes = later;
        }
        pending.keep();
        Ok(())
    }

    async fn finish(&mut self) -> Result<Version, UpdateError> {
        let mut partition = self.partition();
        let pending = Pending(&mut self.file);
        let File { receiver, writer } = pending.0.as_mut().ok_or(UpdateError::Truncated)?;
        let (header, info) = receiver.finish().map_err(error)?;
        let hash = writer.finish(&mut partition).await?;
        drop(pending);
        if !self.is_signed(&hash, &header) {
            return Err(UpdateError::Signature);
        }
        self.kept_state(&mut [0; WORD_BYTES_MAX]).mark_updated().await.map_err(failed)?;
        let version = text(&info);
        self.next = Some(version.clone());
        Ok(version)
    }

    fn discard(&mut self) {
        self.file = None;
    }
}

/// The file while it is worked on. Dropped, it is discarded: after an error, or with the future that works on it.
struct Pending<'f>(&'f mut Option<File>);

impl Pending<'_> {
    /// More of the file follows.
    fn keep(self) {
        core::mem::forget(self);
    }
}

impl Drop for Pending<'_> {
    fn drop(&mut self) {
        *self.0 = None;
    }
}

fn failed(_: FirmwareUpdaterError) -> UpdateError {
    UpdateError::Failed
}

fn text(info: &Info) -> Version {
    let mut text = Version::new();
    // The longest version fits: three numbers and a pre-release.
    let _ = write!(text, "{}", info.version());
    text
}

fn error(refused: Refused) -> UpdateError {
    match refused {
        Refused::NotAnImage => UpdateError::NotAnImage,
        Refused::TooLarge { .. } | Refused::TooLong => UpdateError::TooLong,
        Refused::OtherBoard(_) => UpdateError::OtherBoard,
        Refused::Older(_) => UpdateError::Older,
        Refused::Truncated { .. } => UpdateError::Truncated,
    }
}
