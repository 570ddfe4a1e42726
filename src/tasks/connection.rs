//! The task of a TCP connection: serves one client after another for its TCP server.

use core::convert::Infallible;
use core::future::pending;

use embassy_futures::select::select;

use crate::gateway::Gateway;
use crate::hal::TcpHost;
#[cfg(feature = "dial-in")]
use crate::port::server::dial_in::Acceptor;
use crate::port::server::tcp::{self, Terms};

impl Gateway<'_> {
    /// The task of connection `index`: serves one TCP client after another, forever. Not an `async fn`, which would store its
    /// arguments twice per connection.
    pub fn run_connection<H: TcpHost>(&self, index: usize, host: &mut H) -> impl Future<Output = Infallible> {
        let connection = self.connections().get(index);
        async move {
            let Some(connection) = connection else { return pending().await };
            loop {
                // Others have no ports whose devices connect.
                #[cfg(feature = "dial-in")]
                if let Some(acceptor) = Acceptor::of(self, connection) {
                    select(connection.changed.wait(), acceptor.run(host)).await;
                    acceptor.left();
                    continue;
                }
                let served = connection.state().port.and_then(|id| {
                    let terms = self.settings(|settings| settings.tcp_server(id).map(Terms::of))?;
                    Some((id, self.ports().get(id.index())?, terms))
                });
                let Some((id, port_state, terms)) = &served else {
                    connection.changed.wait().await;
                    continue;
                };
                let (id, settings) = (*id, terms);
                let server = tcp::Server { gateway: self, id, port_state, settings, connection, index };
                select(connection.changed.wait(), server.run(host)).await;
                server.left();
            }
        }
    }
}
