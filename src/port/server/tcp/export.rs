//! A client of a TCP server that receives a capture: the frames of all ports as they occur, instead of responses.

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer, with_timeout};

use super::{End, Server, WRITE_PATIENCE};
use crate::hal::TcpStream;

/// Polling interval for frames. The ring is large enough for busy lines meanwhile.
const EXPORT_PAUSE: Duration = Duration::from_millis(5);

impl Server<'_, '_> {
    /// Sends a client the frames of all ports as they occur.
    pub(super) async fn export<S: TcpStream>(&self, stream: &mut S) -> End {
        let leave = pin!(self.connection.leave.wait());
        let export = pin!(async {
            let mut export = match with_timeout(WRITE_PATIENCE, self.gateway.export(stream)).await {
                Ok(Ok(Some(export))) => export,
                Ok(_) => return End::Left,
                Err(_) => return End::Stalled,
            };
            loop {
                // A client that accepts no frame for this long is stuck.
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
