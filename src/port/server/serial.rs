//! A server-side serial port: the gateway answers an outside master, on a line that may have other devices.
//!
//! What is heard is judged by [`shared_bus`](crate::port::line::sniffer); a request for a unit that the rules route from here
//! goes to the router, and its response comes back through the port's channel. There is one request at a time. It is over
//! when the response has been sent, when its time is, or as soon as anything else is heard: then the master has gone on,
//! and a response would run into the traffic. Answers to what is over find nobody.

use core::pin::pin;

use crate::hal::SerialHost;
use crate::port::line::{LineLost, Opening};
use crate::port::timer::outlined;

mod server;
mod session;

pub(crate) use self::server::Server;
use self::session::Session;

impl Server<'_, '_> {
    /// Keeps the line open and answers on it, for ever.
    pub(crate) async fn run<H: SerialHost>(&self, host: &mut H) {
        let mut opening = Opening::new(self.port_state, self.settings, false);
        loop {
            let jitter = host.read_jitter();
            let opened = host.open(&self.settings.device, &self.settings.line).await;
            // Lent and not moved: what a future is given it keeps twice.
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
