//! Frames of the serial lines into a PCAPNG file, as they come.
//!
//! A pipe will do as well: `mobgate --capture >(wireshark -k -i -)`. Who reads it slowly stops the file, not the gateway.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use embassy_time::{Duration, Instant, Timer};
use mobgate::capture::{Capture, pcapng};
use mobgate::config::PORTS_MAX;

/// How often the ring is emptied: what a busy line brings meanwhile fits into it.
const PAUSE: Duration = Duration::from_millis(10);

/// Opens the file, new or anew.
pub fn create(path: &Path) -> Result<File, String> {
    File::create(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes what comes into `file`, until that fails.
pub async fn run(capture: &Capture, file: File) {
    match write(capture, Arc::new(file)).await {
        Err(error) => log::error!("the capture has ended: {error}"),
        Ok(never) => match never {},
    }
}

async fn write(capture: &Capture, file: Arc<File>) -> io::Result<std::convert::Infallible> {
    let mut blocks = pcapng::header().to_vec();
    // Every port place is an interface, whatever is there.
    (1..=PORTS_MAX).for_each(|port| blocks.extend(pcapng::interface(&format!("port {port}"))));
    let epoch_us = epoch_us();
    let mut cursor = capture.end();
    loop {
        while let Some(frame) = capture.next(&mut cursor) {
            if frame.missed > 0 {
                log::warn!("the capture has missed {} frames", frame.missed);
            }
            blocks.extend(pcapng::packet(&frame, frame.head.port.0.into(), epoch_us));
        }
        if !blocks.is_empty() {
            let (mut file, part) = (file.clone(), std::mem::take(&mut blocks));
            // A disk or a pipe may take its time; the ports go on.
            blocking::unblock(move || file.write_all(&part)).await?;
        }
        Timer::after(PAUSE).await;
    }
}

/// When the gateway's clock began, in microseconds since the year 1970 did.
fn epoch_us() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64);
    now.saturating_sub(Instant::now().as_micros())
}
