//! The port task: runs the port's configured role, and restarts it when the settings change.

use core::convert::Infallible;
use core::future::pending;
use core::pin::pin;

use embassy_futures::select::select;

use crate::gateway::Gateway;
use crate::hal::{SerialHost, TcpConnect, UdpHost};
use crate::port::client::dispatcher::{Dispatcher, Upstream};
use crate::port::client::servers::{CONNECTIONS_MAX, Servers};
use crate::port::timer::outlined;
use crate::port::{client, scanner, server};
use crate::settings::{PortId, PortKind, Side, StreamFraming};

impl Gateway<'_> {
    /// The task of port `id`: runs its configured role, forever.
    ///
    /// `lines` opens serial lines, `connector` makes TCP connections, `datagrams` opens UDP sockets. Not an `async fn`, which
    /// would store its arguments twice per port.
    pub fn run_port<H: SerialHost, C: TcpConnect, U: UdpHost>(
        &self,
        id: PortId,
        lines: &mut H,
        connector: &C,
        datagrams: &mut U,
    ) -> impl Future<Output = Infallible> {
        let at = self.port_state(id);
        async move {
            let Some(at) = at else { return pending().await };
            let port_state = at.state();
            loop {
                let mut kind = self.settings(|settings| settings.port(id).map(|port| port.kind.clone()));
                let alone = self.direct_request.try_on(id, kind.as_mut());
                at.units(|units| units.freeze(alone));
                port_state.renew();
                match &kind {
                    Some(PortKind::Serial(settings)) if settings.side == Side::Server => {
                        let never_underruns = lines.never_underruns();
                        let server = server::serial::Server {
                            gateway: self,
                            port_state,
                            id,
                            settings,
                            never_underruns,
                        };
                        select(port_state.changed.wait(), server.run(lines)).await;
                        server.close();
                    }
                    Some(PortKind::UdpServer(settings)) => {
                        let server = server::udp::Server::new(self, port_state, id, settings);
                        select(port_state.changed.wait(), outlined(pin!(server.run(datagrams)))).await;
                        server.close();
                    }
                    Some(PortKind::Scanner | PortKind::Ethercat(_)) => {
                        let ethercat = self.ethercat().filter(|_| kind != Some(PortKind::Scanner));
                        scanner::run(self, port_state, id, ethercat).await;
                    }
                    kind => {
                        let dispatcher = Dispatcher::new(self, at, id, self.upstream(id, kind), alone);
                        let part = play(&dispatcher, kind.as_ref(), lines, connector);
                        select(port_state.changed.wait(), select(dispatcher.receive_requests(), part)).await;
                        dispatcher.close();
                        port_state.sockets.iter().for_each(|socket| self.socket_closed(socket));
                    }
                }
            }
        }
    }

    /// The servers of the client-side port `id`.
    fn upstream(&self, id: PortId, kind: &Option<PortKind>) -> Upstream {
        match kind {
            Some(PortKind::TcpClient(client)) => {
                let servers = match client.server {
                    _ if client.listens().is_some() => Servers::line(),
                    Some(_) => Servers::one(),
                    None => self.settings(|settings| {
                        Servers::new(settings.servers_of(id).map(|(_, server)| (server.units, server.tag)))
                    }),
                };
                let connections = usize::from(client.sockets).min(CONNECTIONS_MAX).min(servers.len()) as u8;
                let transaction_ids = client.framing == StreamFraming::Mbap;
                Upstream { servers, connections, unit: client.unit, transaction_ids }
            }
            _ => Upstream { servers: Servers::line(), connections: 1, unit: None, transaction_ids: false },
        }
    }
}

/// The role of a client-side port, besides receiving requests.
async fn play<H: SerialHost, C: TcpConnect>(
    dispatcher: &Dispatcher<'_>,
    kind: Option<&PortKind>,
    lines: &mut H,
    connector: &C,
) -> ! {
    match kind {
        Some(PortKind::Serial(settings)) => client::serial::run(dispatcher, settings, lines).await,
        // Others have no such devices.
        #[cfg(feature = "dial-in")]
        Some(PortKind::TcpClient(settings)) if settings.listens().is_some() => {
            outlined(pin!(client::dial_in::run(dispatcher, settings, connector))).await
        }
        Some(PortKind::TcpClient(settings)) => {
            outlined(pin!(client::tcp::run(dispatcher, settings, connector))).await
        }
        // Served by other tasks, or no port.
        _ => {
            dispatcher.close();
            pending().await
        }
    }
}
