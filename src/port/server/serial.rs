//! A server-side serial port: the gateway is one of the slaves on a master's line, which may have other devices.
//!
//! The [`sniffer`](crate::port::line::sniffer) classifies received frames. A request for a unit that the rules route from here goes
//! to the router, and its response returns through the port's channel. One request is open at a time. It ends when the response has
//! been sent, at its deadline, or as soon as anything else is received: then the master has moved on, and a response would collide
//! with its traffic. Responses to ended requests are dropped.

use core::pin::pin;

use crate::hal::SerialHost;
use crate::port::line::{LineLost, Opening};
use crate::port::timer::outlined;

mod server;
mod session;

pub(crate) use self::server::Server;
use self::session::Session;

impl Server<'_, '_> {
    /// Keeps the line open and serves it, forever.
    pub(crate) async fn run<H: SerialHost>(&self, host: &mut H) -> ! {
        let mut opening = Opening::new(self.port_state, self.settings, false);
        loop {
            let jitter = host.read_jitter();
            let opened = host.open(&self.settings.device, &self.settings.line).await;
            // Borrowed, not moved: a future stores a moved argument twice.
            let mut session = opening.opened(opened, jitter).map(|line| Session::new(self, line));
            if let Some(session) = &mut session {
                let Err(LineLost) = outlined(pin!(session.serve())).await;
            }
            if session.take().is_some() {
                self.close();
                opening.lost();
            }
            opening.pause().await;
        }
    }
}
