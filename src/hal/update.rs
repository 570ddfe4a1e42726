//! New firmware: a board's memory for an image that runs after a restart, first on trial.

use core::fmt;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use heapless::String;

/// Most bytes of a [`Version`]: three numbers of 16 bits and a pre-release.
pub(crate) const VERSION_BYTES_MAX: usize = 32;

/// The version of an image as text: `0.5.0`.
pub type Version = String<VERSION_BYTES_MAX>;

/// Takes the file of a new image, and checks it: signature, board, version.
///
/// [`begin`](Self::begin), then [`write`](Self::write) as often as needed, then [`finish`](Self::finish). After an error nothing of
/// the image is left, and `begin` is next. What runs is never changed before a restart. Dropping a pending future, or
/// [`discard`](Self::discard), discards what was written.
pub trait Update {
    /// False if [`begin`](Self::begin) always fails, so that its callers' code can be left out.
    const EXISTS: bool = true;

    /// Begins a file of `bytes`, if that is known. An image older than what runs is accepted only if the caller allows it.
    ///
    /// # Errors
    /// [`UpdateError::Absent`], [`UpdateError::Busy`], [`UpdateError::OnTrial`], [`UpdateError::TooLong`], or
    /// [`UpdateError::Failed`].
    async fn begin(&mut self, bytes: Option<u32>, allow_older: bool) -> Result<(), UpdateError>;

    /// Writes the next bytes, any number of them. What follows the image's end is ignored, because some protocols pad files.
    ///
    /// # Errors
    /// As soon as it is known that the image will not be accepted: [`UpdateError::NotAnImage`], [`UpdateError::OtherBoard`],
    /// [`UpdateError::Older`], [`UpdateError::TooLong`]; or [`UpdateError::Failed`].
    async fn write(&mut self, bytes: &[u8]) -> Result<(), UpdateError>;

    /// Checks the image as a whole; the next restart starts it. Returns its version.
    ///
    /// # Errors
    /// [`UpdateError::Truncated`], [`UpdateError::Signature`], or any of [`write`](Self::write).
    async fn finish(&mut self) -> Result<Version, UpdateError>;

    /// Discards an unfinished image, if any, so that another update can begin.
    fn discard(&mut self);
}

/// Why a new image was not accepted. What runs is untouched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum UpdateError {
    /// This board, or this run, has no updates; with what to do instead.
    #[error("no updates here: {0}")]
    Absent(&'static str),
    /// Another update is in progress.
    #[error("another update is in progress")]
    Busy,
    /// The image that runs is on trial: it would be lost.
    #[error("the firmware that runs is still on trial: wait until it is confirmed")]
    OnTrial,
    /// The file is not an image, or has an unknown format.
    #[error("this is no image of mobgate")]
    NotAnImage,
    /// The image is for another board.
    #[error("the image is for another board")]
    OtherBoard,
    /// The image is older than what runs, and that was not allowed.
    #[error("the image is older than what runs")]
    Older,
    /// The image does not fit.
    #[error("the image is too long for this board")]
    TooLong,
    /// The file ended too early.
    #[error("the image is incomplete")]
    Truncated,
    /// The signature is not that of this firmware by the key that the board trusts.
    #[error("the image's signature is wrong")]
    Signature,
    /// The flash memory failed.
    #[error("writing the image failed")]
    Failed,
}

/// How the running image was started, or what happens next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FirmwareState {
    /// It is confirmed: it starts again and again.
    Confirmed,
    /// It runs for the first time, and is confirmed once it has proved itself; a restart before that goes back.
    OnTrial,
    /// It is confirmed, and runs because another one failed its trial.
    WentBack {
        /// The version that failed, if known.
        from: Option<Version>,
        /// What failed: "watchdog", "no network".
        why: &'static str,
    },
    /// It is confirmed, and the next restart starts another one.
    Next(Version),
}

impl fmt::Display for FirmwareState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Confirmed => f.write_str("confirmed"),
            Self::OnTrial => f.write_str("on trial"),
            Self::WentBack { from: Some(version), why } => write!(f, "went back from {version}: {why}"),
            Self::WentBack { from: None, why } => write!(f, "went back: {why}"),
            Self::Next(version) => write!(f, "confirmed, {version} starts with the next restart"),
        }
    }
}

/// A board without updates, and what to do instead.
#[derive(Debug, Clone, Copy)]
pub struct NoUpdate(pub &'static str);

impl Update for NoUpdate {
    const EXISTS: bool = false;

    async fn begin(&mut self, _bytes: Option<u32>, _allow_older: bool) -> Result<(), UpdateError> {
        Err(UpdateError::Absent(self.0))
    }

    async fn write(&mut self, _bytes: &[u8]) -> Result<(), UpdateError> {
        Err(UpdateError::Absent(self.0))
    }

    async fn finish(&mut self) -> Result<Version, UpdateError> {
        Err(UpdateError::Absent(self.0))
    }

    fn discard(&mut self) {}
}

/// A handle of an updater shared by consoles and an EtherCAT MainDevice. The one that began keeps it until the end; others
/// get [`UpdateError::Busy`]. Dropping the handle discards what it has begun.
pub struct SharedUpdate<'a, M: RawMutex, U: Update> {
    update: &'a Mutex<M, U>,
    /// Held from the beginning to the end.
    held: Option<MutexGuard<'a, M, U>>,
}

impl<'a, M: RawMutex, U: Update> SharedUpdate<'a, M, U> {
    /// Creates a handle of `update`.
    pub const fn new(update: &'a Mutex<M, U>) -> Self {
        Self { update, held: None }
    }

    /// Another handle of the same updater.
    #[must_use]
    pub const fn another(&self) -> Self {
        Self::new(self.update)
    }
}

impl<M: RawMutex, U: Update> Update for SharedUpdate<'_, M, U> {
    const EXISTS: bool = U::EXISTS;

    async fn begin(&mut self, bytes: Option<u32>, allow_older: bool) -> Result<(), UpdateError> {
        self.discard();
        let mut update = self.update.try_lock().map_err(|_| UpdateError::Busy)?;
        update.discard();
        update.begin(bytes, allow_older).await?;
        self.held = Some(update);
        Ok(())
    }

    async fn write(&mut self, bytes: &[u8]) -> Result<(), UpdateError> {
        // Taken: after an error, or when this future is dropped, others may begin.
        let mut update = self.held.take().ok_or(UpdateError::Truncated)?;
        update.write(bytes).await?;
        self.held = Some(update);
        Ok(())
    }

    async fn finish(&mut self) -> Result<Version, UpdateError> {
        let mut update = self.held.take().ok_or(UpdateError::Truncated)?;
        update.finish().await
    }

    fn discard(&mut self) {
        if let Some(mut update) = self.held.take() {
            update.discard();
        }
    }
}
