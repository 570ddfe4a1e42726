//! A client of a TCP server who gets a capture: the frames of all ports as they come, and no responses.

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer, with_timeout};

use super::{End, Server, WRITE_PATIENCE};
use crate::capture::Export;
use crate::hal::TcpStream;

/// How often it is looked whether there are frames: what a busy line brings meanwhile fits into the ring.
const EXPORT_PAUSE: Duration = Duration::from_millis(5);

impl Server<'_, '_> {
    /// Gives a client the frames of all ports as they come.
    pub(super) async fn export<S: TcpStream>(&self, stream: &mut S) -> End {
        let leave = pin!(self.connection.leave.wait());
        let export = pin!(async {
            let mut export = match with_timeout(WRITE_PATIENCE, Export::begin(self.gateway, stream)).await {
                Ok(Ok(Some(export))) => export,
                Ok(_) => return End::Left,
                Err(_) => return End::Stalled,
            };
            loop {
                // Whoever takes no frame for so long takes none at all.
                match with_timeout(WRITE_PATIENCE, export.write_next(stream)).await {
                    Ok(Ok(true)) => continue,
                    Ok(Ok(false)) => {}
                    Ok(Err(_)) => return End::Left,
                    Err(_) => return End::Stalled,
                }
                let mut said = [0; 16];
                match select(stream.read(&mut said), Timer::after(EXPORT_PAUSE)).await {
                    Either::First(Ok(0) | Err(_)) => return End::Left,
                    Either::First(Ok(_)) | Either::Second(()) => {}
                }
            }
        });
        match select(leave, export).await {
            Either::First(()) => End::Crowded,
            Either::Second(end) => end,
        }
    }
}
