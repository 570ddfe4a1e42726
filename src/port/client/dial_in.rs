//! A client-side TCP port whose device connects to the gateway: a modem or a data logger behind a network that cannot be reached from
//! outside, or a serial device server that is configured so.
//!
//! [`port::server::dial_in`](crate::port::server::dial_in) accepts the connection and hands it over. From then on the port is a client
//! as any other: [`TcpConnection`] serves the requests. While no device is connected, requests get 0Ah at once. A further connection
//! of the device replaces the one that there is: a device that lost its network, or was reset, does not end the old one, which would
//! look open for minutes.

use core::pin::pin;

use embassy_futures::poll_once;
use embassy_futures::select::{Either, select};

use crate::hal::{TcpConnect, TcpStream};
use crate::port::client::connection::{End, TcpConnection};
use crate::port::client::dispatcher::Dispatcher;
use crate::port::client::tcp::ID_STRIDE;
use crate::port::timer::outlined;
use crate::settings::{Endpoint, PortId, TcpClientSettings};
use crate::stats::Event;

/// The only connection, to the only server.
const CONNECTION: (u8, usize) = (0, 0);

/// Lets a connection fall that still waits when the port has begun and ends: it was accepted by settings that are no longer in force.
struct Last<'c, C: TcpConnect> {
    connector: &'c C,
    port: PortId,
}

impl<C: TcpConnect> Drop for Last<'_, C> {
    fn drop(&mut self) {
        let _ = poll_once(self.connector.handed_over(self.port));
    }
}

/// Serves the dispatcher's requests forever.
pub(crate) async fn run<C: TcpConnect>(
    dispatcher: &Dispatcher<'_>,
    settings: &TcpClientSettings,
    connector: &C,
) -> ! {
    let port_state = dispatcher.port_state().state();
    let [socket, ..] = &port_state.sockets;
    let _last = Last { connector, port: dispatcher.id() };
    dispatcher.close();
    let mut first_id = ID_STRIDE;
    let mut next = None;
    loop {
        let (stream, peer) = match next.take() {
            Some(connection) => connection,
            None => connector.handed_over(dispatcher.id()).await,
        };
        log_info!("device {} has connected", Endpoint(peer));
        port_state.stats.count(Event::Connected);
        port_state.set_device(Some(peer));
        socket.opened();
        dispatcher.open();
        let mut open = TcpConnection::new(dispatcher, settings, stream, first_id, CONNECTION, socket);
        let handed_over = pin!(connector.handed_over(dispatcher.id()));
        let end = match select(outlined(pin!(open.serve())), handed_over).await {
            Either::First(Err(end)) => end,
            Either::Second(connection) => {
                next = Some(connection);
                End::Lost
            }
        };
        open.ended(end);
        dispatcher.gateway().socket_closed(socket);
        first_id = first_id.wrapping_add(ID_STRIDE);
        if next.is_some() {
            log_info!("device {} has connected again", Endpoint(peer));
            // Not closed in order, for which its peer would have to be there.
            continue;
        }
        dispatcher.close();
        port_state.set_device(None);
        open.into_stream().close().await;
    }
}
