//! What is known of the image that runs: a number that tells it from others, and why the one before it went back.

use core::str::from_utf8;

use embassy_boot::State;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use heapless::String;
use mobgate::hal::UpdateError;

use crate::partition::Partition;
use crate::updater::Updater;
use crate::writer::BLANK;

/// Longest [`Reason`] in bytes: whole words of each chip's flash. The record is the end of the state's partition, which the boot loader
/// erases with the rest and does not use.
pub const REASON_BYTES_MAX: usize = 192;

/// Why an image went back.
pub type Reason = String<REASON_BYTES_MAX>;

/// Bytes that are read at a time.
const CHUNK_BYTES: usize = 256;
// FNV-1a over words of 32 bits.
const OFFSET_BASIS: u32 = 0x811c_9dc5;
const PRIME: u32 = 0x0100_0193;

impl<M: RawMutex, F: NorFlash, const PAGE: usize, const STATE_PAGE: usize>
    Updater<'_, M, F, PAGE, STATE_PAGE>
{
    /// A number that another image does not have: a hash of the whole partition, because builds of one version differ somewhere.
    ///
    /// # Errors
    /// The flash fails.
    pub async fn id(&mut self) -> Result<u32, UpdateError> {
        let mut active = Partition::<M, F, PAGE>::new(self.flash, self.layout.active.clone());
        let (mut id, mut chunk) = (OFFSET_BASIS, [0; CHUNK_BYTES]);
        for at in (0..active.capacity() as u32).step_by(CHUNK_BYTES) {
            active.read(at, &mut chunk).await.map_err(|_| UpdateError::Failed)?;
            let (words, _) = chunk.as_chunks();
            id = words.iter().fold(id, |id, word| (id ^ u32::from_le_bytes(*word)).wrapping_mul(PRIME));
        }
        Ok(id)
    }

    /// Why the image before this one went back, if it has. At the first start since then that is `now`, which is kept until the next
    /// update.
    ///
    /// # Errors
    /// The flash fails.
    pub async fn reason(&mut self, now: Reason) -> Result<Option<Reason>, UpdateError> {
        const { assert!(REASON_BYTES_MAX.is_multiple_of(F::WRITE_SIZE)) };
        if self.state().await? != State::Revert {
            return Ok(None);
        }
        let failed = |_| UpdateError::Failed;
        let mut state = Partition::<M, F, STATE_PAGE>::new(self.flash, self.layout.state.clone());
        let at = (state.capacity() - REASON_BYTES_MAX) as u32;
        let mut record = [0; REASON_BYTES_MAX];
        state.read(at, &mut record).await.map_err(failed)?;
        if record.iter().all(|&byte| byte == BLANK) {
            record.fill(0);
            record.iter_mut().zip(now.bytes()).for_each(|(to, byte)| *to = byte);
            state.write(at, &record).await.map_err(failed)?;
        }
        let text = from_utf8(record.split(|&byte| byte == 0).next().unwrap_or_default());
        // A power cut has left it half written: blank bytes are no UTF-8.
        let text = text.ok().filter(|text| !text.is_empty()).unwrap_or("for a reason that was lost");
        Ok(Reason::try_from(text).ok())
    }
}
