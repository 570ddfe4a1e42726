//! `/api/v1/update`: the running version, upload of an image, which is written as it arrives, and rollback.

use embassy_time::Duration;
use picoserve::io::Read;
use picoserve::request::RequestBody;

use super::api::{Api, Caller};
use super::json::Quoted;
use super::response::{Refused, Response};
use super::transport::Life;
use crate::gateway::audit::Topic;
use crate::hal::{FirmwareState, Store, System, Update, UpdateError, Version};

/// More than any board's memory for an image.
const IMAGE_BYTES_MAX: usize = 4 * 1_024 * 1_024;
/// Bytes taken at a time.
const CHUNK_BYTES_MAX: usize = 256;
/// Silence after which the upload has failed. A board may take as long to erase its memory, or to check the image.
const SILENCE_MAX: Duration = Duration::from_secs(60);

/// Why an image was not taken.
#[derive(Debug, thiserror::Error)]
enum Untaken {
    #[error("the body did not come as announced")]
    Short,
    #[error(transparent)]
    Refused(#[from] UpdateError),
}

impl Untaken {
    const fn status(&self) -> u16 {
        match self {
            Self::Short => 400,
            Self::Refused(UpdateError::TooLong) => 413,
            Self::Refused(
                UpdateError::NotAnImage
                | UpdateError::OtherBoard
                | UpdateError::Older
                | UpdateError::Truncated
                | UpdateError::Signature,
            ) => 422,
            Self::Refused(
                UpdateError::Absent(_) | UpdateError::Busy | UpdateError::OnTrial | UpdateError::Failed,
            ) => 409,
        }
    }
}

/// An update, which is discarded unless it is finished, also when the connection ends.
struct Begun<'u, U: Update>(&'u mut U);

impl<U: Update> Drop for Begun<'_, U> {
    fn drop(&mut self) {
        self.0.discard();
    }
}

/// A body that is still arriving.
struct Upload<'l, R> {
    body: R,
    /// Bytes still to come.
    left: usize,
    life: &'l Life,
}

impl<R: Read> Upload<'_, R> {
    /// The next bytes; `None` at the end.
    async fn next<'c>(&mut self, chunk: &'c mut [u8]) -> Option<&'c [u8]> {
        let count = self.body.read(chunk).await.ok().filter(|count| *count > 0)?;
        self.left = self.left.saturating_sub(count);
        self.life.lasts(SILENCE_MAX);
        chunk.get(..count)
    }

    async fn write<U: Update>(&mut self, update: &mut U) -> Result<Version, Untaken> {
        let length = u32::try_from(self.left).map_err(|_| UpdateError::TooLong)?;
        let begun = Begun(update);
        begun.0.begin(Some(length), false).await?;
        let mut chunk = [0; CHUNK_BYTES_MAX];
        while self.left > 0 {
            let bytes = self.next(&mut chunk).await.ok_or(Untaken::Short)?;
            begun.0.write(bytes).await?;
        }
        Ok(begun.0.finish().await?)
    }

    /// Drops the rest: a client reads the response when it has sent all.
    async fn drop_rest(&mut self) {
        let mut chunk = [0; CHUNK_BYTES_MAX];
        while self.left > 0 && self.next(&mut chunk).await.is_some() {}
    }
}

impl<'a, 'g, S: Store, U: Update, Y: System> Api<'a, 'g, S, U, Y> {
    /// `GET /update`
    pub(super) fn firmware(&self, response: &mut Response<'a, 'g>) {
        let (version, board) = (env!("CARGO_PKG_VERSION"), Quoted(self.system.name()));
        let head = format_args!("\"version\":\"{version}\",\"board\":{board}");
        match self.system.firmware() {
            Some(state) => response.json(200, format_args!("{{{head},\"state\":{}}}", Quoted(state))),
            None => response.json(200, format_args!("{{{head}}}")),
        }
    }

    /// `POST /update`
    pub(super) async fn update<R: Read>(
        &self,
        caller: &Caller,
        body: RequestBody<'_, R>,
        response: &mut Response<'a, 'g>,
    ) -> Result<(), Refused> {
        let left = body.content_length();
        if left > IMAGE_BYTES_MAX {
            return Err(response.error(413, &UpdateError::TooLong));
        }
        self.life.takes_upload(left);
        self.life.lasts(SILENCE_MAX);
        let mut upload = Upload { body: body.reader(), left, life: self.life };
        let taken = upload.write(&mut **self.update.lock().await).await;
        match taken {
            Ok(version) => {
                let (gateway, actor) = (self.gateway, self.actor(caller));
                gateway.audit(Topic::Update, actor, format_args!("update to {version}"));
                self.life.restarts.set(true);
                response.json(200, format_args!("{{\"version\":{}}}", Quoted(version)));
                Ok(())
            }
            Err(why) => {
                self.gateway.audit(Topic::Update, self.actor(caller), format_args!("update failed: {why}"));
                upload.drop_rest().await;
                Err(response.error(why.status(), &why))
            }
        }
    }

    /// `DELETE /update`: a restart reverts firmware on trial.
    pub(super) fn go_back(&self, caller: &Caller, response: &mut Response<'a, 'g>) -> Result<(), Refused> {
        if self.system.firmware() != Some(FirmwareState::OnTrial) {
            return Err(response.error(409, &"nothing is on trial that could be taken back"));
        }
        self.gateway.audit(Topic::Update, self.actor(caller), format_args!("update taken back"));
        self.life.restarts.set(true);
        Ok(())
    }
}
