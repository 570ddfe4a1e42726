//! Writes frames to a PCAPNG file as they arrive, from the start or on the console's command.
//!
//! A pipe works as well: `mobgate --capture >(wireshark -k -i -)`. A slow reader stalls the file, not the gateway.

use std::convert::Infallible;
use std::fs::File;
use std::io;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Write;
use mobgate::capture::Export;
use mobgate::gateway::Gateway;
use mobgate::hal::{OpenError, OpenErrorKind};

use crate::sink::Sink;

/// Interval at which the ring is emptied; a busy line does not fill it in this time.
const PAUSE: Duration = Duration::from_millis(10);

/// The file requested next; `None` ends the capture.
pub type Wanted = Signal<CriticalSectionRawMutex, Option<File>>;

/// Creates or truncates the file.
pub fn create(path: &Path) -> Result<File, String> {
    File::create(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Creates a file for a console session, which may belong to anybody on this machine: never overwrites one.
pub fn create_new(path: &str) -> Result<File, OpenError> {
    File::create_new(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => OpenError::new(OpenErrorKind::NotFound, "no such folder"),
        io::ErrorKind::PermissionDenied => OpenError::new(OpenErrorKind::Denied, ""),
        io::ErrorKind::AlreadyExists => OpenError::new(OpenErrorKind::Failed, "there is such a file already"),
        _ => OpenError::new(OpenErrorKind::Failed, ""),
    })
}

/// Writes frames into the `wanted` file; never returns.
pub async fn run(gateway: &Gateway<'_>, wanted: &Wanted) {
    let mut file = None;
    loop {
        let Some(current) = file.take() else {
            file = wanted.wait().await;
            continue;
        };
        match select(write(gateway, current), wanted.wait()).await {
            Either::First(Err(error)) => log::error!("the capture has ended: {error}"),
            Either::First(Ok(never)) => match never {},
            Either::Second(next) => file = next,
        }
    }
}

async fn write(gateway: &Gateway<'_>, file: File) -> io::Result<Infallible> {
    let mut sink = Sink::new(file)?;
    let export = Export::begin(gateway, &mut sink).await?;
    let mut export = export.ok_or(io::Error::other("no frames are kept"))?;
    loop {
        while export.write_next(&mut sink).await? {}
        sink.flush().await?;
        Timer::after(PAUSE).await;
    }
}

/// The gateway's start in microseconds since 1970.
// Wall-clock time is used only for the time stamps in captures.
#[allow(clippy::disallowed_methods)]
pub fn epoch_us() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64);
    now.saturating_sub(Instant::now().as_micros())
}
