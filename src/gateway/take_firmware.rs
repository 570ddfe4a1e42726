//! New firmware from an EtherCAT MainDevice, for the owner of the flash.

use embassy_time::{Duration, Timer};
use ethercat_subdevice::foe::{FileError, FileErrorCode};

use super::Gateway;
use super::audit::{Actor, Topic};
use crate::fieldbus::{FileBuffer, Owner, Packet, Work};
use crate::hal::{System, Update, UpdateError};

/// How long the MainDevice may take to see that the SubDevice has left Boot, before it vanishes for a restart.
const SEEN_AFTER: Duration = Duration::from_millis(500);

impl Gateway<'_> {
    /// Writes what a MainDevice sends to `buffer` into `update`, forever, and restarts once it takes the SubDevice out of Boot
    /// behind a whole image. A board with an EtherCAT controller runs it once. An older image is refused.
    pub async fn take_firmware(
        &self,
        buffer: &FileBuffer,
        update: &mut impl Update,
        system: &impl System,
    ) -> ! {
        loop {
            let work = buffer.work(Owner::Flash).await;
            let done = match &work {
                Work::Open(..) => update.begin(None, false).await,
                Work::Write(packet) => update.write(packet).await,
                Work::Finish => update.finish().await.map(|version| {
                    let what = format_args!("firmware {version} is complete and starts when Boot is left");
                    self.audit(Topic::Update, Actor::Ethercat, what);
                }),
                // Nobody reads an image.
                Work::Discard | Work::Read(_) => {
                    update.discard();
                    Ok(())
                }
                Work::Restart => {
                    Timer::after(SEEN_AFTER).await;
                    system.reboot();
                    Ok(())
                }
            };
            if let Err(why) = done {
                self.audit(Topic::Update, Actor::Ethercat, format_args!("no new firmware: {why}"));
                update.discard();
            }
            let done = done.map(|()| Packet::new());
            buffer.done(&work, done.map_err(|why| FileError::new(code(why), why)));
        }
    }
}

const fn code(why: UpdateError) -> FileErrorCode {
    match why {
        UpdateError::Absent(_) => FileErrorCode::NotFound,
        UpdateError::Busy | UpdateError::OnTrial | UpdateError::Older => FileErrorCode::AccessDenied,
        UpdateError::NotAnImage => FileErrorCode::InvalidHeader,
        UpdateError::OtherBoard => FileErrorCode::InvalidFirmware,
        UpdateError::TooLong => FileErrorCode::DiskFull,
        UpdateError::Truncated | UpdateError::Signature => FileErrorCode::InvalidChecksum,
        UpdateError::Failed => FileErrorCode::FlashFailed,
    }
}
