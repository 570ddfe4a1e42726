//! The task of a TCP connection: serves one client after the other, for the TCP server that it belongs to.

use embassy_futures::select::select;

use crate::gateway::Gateway;
use crate::hal::TcpHost;
use crate::port::server::tcp::{self, Terms};

impl Gateway<'_> {
    /// The task of the seat `index`: serves one TCP client after the other, for ever. An `async fn` would keep what it is given
    /// twice, at each seat.
    pub fn run_seat<H: TcpHost>(&self, index: usize, host: &mut H) -> impl Future<Output = ()> {
        let seat = self.seats().get(index);
        async move {
            let Some(seat) = seat else { return };
            loop {
                let served = seat.state().port.and_then(|id| {
                    let terms = self.settings(|settings| settings.tcp_server(id).map(Terms::of))?;
                    Some((id, self.ports().get(id.index())?, terms))
                });
                let Some((id, place, terms)) = &served else {
                    seat.changed.wait().await;
                    continue;
                };
                let (id, settings) = (*id, terms);
                let server = tcp::Server { gateway: self, id, place, settings, seat, index };
                select(seat.changed.wait(), server.run(host)).await;
                server.left();
            }
        }
    }
}
