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
use mobgate::gateway::Gateway;
use mobgate::hal::{OpenError, OpenErrorKind};
use rustix::fs::{Mode, OFlags, ResolveFlags, open, openat2};
use rustix::io::Errno;

use crate::sink::Sink;

/// Interval at which the ring is emptied; a busy line does not fill it in this time.
const PAUSE: Duration = Duration::from_millis(10);

const ELSEWHERE: &str = "captures are files below the folder that the program was started in";

/// The file requested next; `None` ends the capture.
pub type Wanted = Signal<CriticalSectionRawMutex, Option<File>>;

/// Creates or truncates the file.
pub fn create(path: &Path) -> Result<File, String> {
    File::create(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Creates a file for a console session, whose user may not be one of this machine: below one folder, and never over another file. The
/// folder is the service's own (`StateDirectory=`), or the one that the program was started in.
pub fn create_new(path: &str) -> Result<File, OpenError> {
    let folder = std::env::var_os("STATE_DIRECTORY").unwrap_or(".".into());
    let create = || {
        let folder = open(folder, OFlags::PATH | OFlags::CLOEXEC, Mode::empty())?;
        let flags = OFlags::CREATE | OFlags::EXCL | OFlags::WRONLY | OFlags::CLOEXEC;
        let below = ResolveFlags::BENEATH | ResolveFlags::NO_SYMLINKS;
        openat2(folder, path, flags, Mode::from_raw_mode(0o640), below)
    };
    create().map(File::from).map_err(|error| match error {
        Errno::NOENT => OpenError::new(OpenErrorKind::NotFound, "no such folder"),
        Errno::ACCESS | Errno::PERM | Errno::ROFS => OpenError::new(OpenErrorKind::Denied, ""),
        Errno::EXIST => OpenError::new(OpenErrorKind::Failed, "there is such a file already"),
        Errno::XDEV | Errno::LOOP => OpenError::new(OpenErrorKind::Denied, ELSEWHERE),
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
    let export = gateway.export(&mut sink).await?;
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
