//! The port task: plays the part that the settings say, and begins anew when they change.

use core::pin::pin;

use embassy_futures::select::select;

use crate::gateway::Gateway;
use crate::hal::{SerialHost, TcpConnect, UdpHost};
use crate::port::client::dispatcher::{Desk, Part};
use crate::port::client::servers::{LINKS_MAX, Servers};
use crate::port::timer::apart;
use crate::port::{client, scanner, server};
use crate::settings::{PortId, PortKind, Side, StreamFraming};

impl Gateway<'_> {
    /// The port task of place `id`: plays the part that the settings say, for ever.
    ///
    /// `lines` opens serial lines, `connector` makes connections, `datagrams` opens UDP sockets. An `async fn` would keep what it
    /// is given twice, at each port.
    pub fn run_port<H: SerialHost, C: TcpConnect, U: UdpHost>(
        &self,
        id: PortId,
        lines: &mut H,
        connector: &C,
        datagrams: &mut U,
    ) -> impl Future<Output = ()> {
        let at = self.place(id);
        async move {
            let Some(at) = at else { return };
            let place = at.place();
            loop {
                let mut kind = self.settings(|settings| settings.port(id).cloned()).map(|port| port.kind);
                let alone = self.asking.try_on(id, kind.as_mut());
                at.units(|units| units.freeze(alone));
                place.renew();
                match &kind {
                    Some(PortKind::Serial(settings)) if settings.side == Side::Server => {
                        let never_underruns = lines.never_underruns();
                        let server =
                            server::serial::Server { gateway: self, place, id, settings, never_underruns };
                        select(place.changed.wait(), server.run(lines)).await;
                        server.close();
                    }
                    Some(PortKind::UdpServer(settings)) => {
                        let server = server::udp::Server::new(self, place, id, settings);
                        select(place.changed.wait(), apart(pin!(server.run(datagrams)))).await;
                        server.close();
                    }
                    Some(PortKind::Scanner | PortKind::Ethercat(_)) => {
                        let ethercat = self.ethercat().filter(|_| kind != Some(PortKind::Scanner));
                        scanner::run(self, place, id, ethercat).await;
                    }
                    kind => {
                        let desk = Desk::new(self, at, id, self.part(id, kind), alone);
                        let part = play(&desk, kind.as_ref(), lines, connector);
                        select(place.changed.wait(), select(desk.take_in(), part)).await;
                        desk.close();
                        place.sockets.iter().for_each(|socket| self.socket_closed(socket));
                    }
                }
            }
        }
    }

    /// What the client-side port `id` is besides its line.
    fn part(&self, id: PortId, kind: &Option<PortKind>) -> Part {
        match kind {
            Some(PortKind::TcpClient(client)) => {
                let servers = match client.server {
                    Some(_) => Servers::one(),
                    None => self.settings(|settings| {
                        Servers::new(settings.servers_of(id).map(|(_, server)| (server.units, server.tag)))
                    }),
                };
                let links = usize::from(client.sockets).min(LINKS_MAX).min(servers.len()) as u8;
                let transaction_ids = client.framing == StreamFraming::Mbap;
                Part { servers, links, unit: client.unit, transaction_ids }
            }
            _ => Part { servers: Servers::line(), links: 1, unit: None, transaction_ids: false },
        }
    }
}

/// The part that a client-side port plays besides taking orders in.
async fn play<H: SerialHost, C: TcpConnect>(
    desk: &Desk<'_>,
    kind: Option<&PortKind>,
    lines: &mut H,
    connector: &C,
) {
    match kind {
        Some(PortKind::Serial(settings)) => {
            client::serial::run(desk, settings, lines).await;
        }
        Some(PortKind::TcpClient(settings)) => {
            apart(pin!(client::tcp::run(desk, settings, connector))).await;
        }
        Some(PortKind::TcpServer(_) | PortKind::UdpServer(_) | PortKind::Scanner | PortKind::Ethercat(_))
        | None => {
            desk.close();
            core::future::pending().await
        }
    }
}
