//! Devices that connect to the gateway, which is their client then: accepts them where client ports listen, tells by their addresses
//! and first bytes whose they are, and hands them over to these ports.
//!
//! Each client port that listens has some connection slots. Where several ports listen at one address, each slot accepts the devices of
//! all. A device that is told by its address is handed over at once. Others are read up to the first bytes that tell, and not further:
//! what follows is the port's. Those that wait for their first bytes occupy a slot each; if all do, a newcomer displaces the one that
//! has waited for longest, so that nobody who says nothing keeps a device out.

use core::convert::Infallible;
use core::net::{IpAddr, SocketAddr};

use embassy_futures::select::{Either3, select3};
use embassy_time::{Duration, Instant, Timer};

use crate::gateway::{Connection, ConnectionState, Gateway, PortState, Status};
use crate::hal::{OpenError, TcpHost, TcpStream};
use crate::port::server::listening;
use crate::port::timer::until;
use crate::settings::{
    ClientRole, DIAL_IN_WAITING_MAX, FIRST_BYTES_MAX, FirstBytes, PortId, PortKind, TcpListen, Whose,
};
use crate::stats::Event;

/// A device whose first bytes have not come by then is disconnected.
const FIRST_BYTES_WITHIN: Duration = Duration::from_secs(10);

/// One slot for devices that have just connected.
pub(crate) struct Acceptor<'s, 'g> {
    gateway: &'s Gateway<'g>,
    id: PortId,
    port_state: &'s PortState,
    listen: TcpListen,
    connection: &'s Connection,
}

impl<'s, 'g> Acceptor<'s, 'g> {
    /// For the slot `connection`, if it is that of a client port that listens.
    pub(crate) fn of(gateway: &'s Gateway<'g>, connection: &'s Connection) -> Option<Self> {
        let id = connection.state().port?;
        let port_state = gateway.ports().get(id.index())?;
        let listen = gateway.settings(|settings| match &settings.port(id)?.kind {
            PortKind::TcpClient(client) => client.listens().copied(),
            _ => None,
        })?;
        Some(Self { gateway, id, port_state, listen, connection })
    }

    /// Accepts one device after another, forever. Not an `async fn`, which would store its arguments twice per connection.
    pub(crate) fn run<H: TcpHost>(&self, host: &mut H) -> impl Future<Output = Infallible> {
        let mut turn = Instant::MIN;
        async move {
            loop {
                let (mut stream, peer) = match self.accept(host, turn).await {
                    Ok(accepted) => accepted,
                    Err(error) => {
                        // A device that is connected already is not affected.
                        if self.port_state.status() != Status::Open {
                            listening::fails(self.port_state, "TCP", self.listen.port, error);
                        }
                        Timer::after(listening::LISTEN_PAUSE).await;
                        continue;
                    }
                };
                self.enter(peer);
                let whose = self.whose(&mut stream, peer.ip()).await;
                self.left();
                match whose {
                    Ok(port) => {
                        turn = Instant::MIN;
                        stream.hand_over(port, peer);
                    }
                    Err(why) => {
                        self.refuse(peer.ip(), why);
                        stream.close().await;
                        turn = self.gateway.turns.take(Instant::now());
                    }
                }
            }
        }
    }

    /// Accepts the next device, after `turn`.
    async fn accept<'h, H: TcpHost>(
        &self,
        host: &'h mut H,
        turn: Instant,
    ) -> Result<(H::Stream<'h>, SocketAddr), OpenError> {
        host.listen(&self.listen)?;
        let public = || host.public_address(&self.listen).filter(|_| self.serves_everybody());
        listening::waits(self.port_state, self.listen.port, public);
        until(turn).await;
        host.accept(&self.listen).await
    }

    /// Whether a device may have any address.
    fn serves_everybody(&self) -> bool {
        self.gateway.settings(|settings| {
            settings.dial_ins(&self.listen).any(|(_, dial_in)| dial_in.allowed.0.is_empty())
        })
    }

    /// Notes that a device has connected. If all slots of the port are taken now, one of the others is vacated.
    fn enter(&self, peer: SocketAddr) {
        self.connection.enter(peer, ClientRole::NONE, false);
        let others = || {
            self.gateway.connections().iter().filter(|other| {
                let ConnectionState { port, peer, leaving, .. } = other.state();
                let waits = port == Some(self.id) && peer.is_some() && !leaving;
                waits && !core::ptr::eq(*other, self.connection)
            })
        };
        if others().count() >= DIAL_IN_WAITING_MAX
            && let Some(oldest) = others().min_by_key(|other| other.state().since)
        {
            oldest.displace();
        }
    }

    /// Marks the slot as free.
    pub(crate) fn left(&self) {
        self.connection.update(|connection| connection.peer = None);
    }

    /// The port whose device has connected, or the event to count for it.
    async fn whose<S: TcpStream>(&self, stream: &mut S, peer: IpAddr) -> Result<PortId, Event> {
        let give_up = Instant::now() + FIRST_BYTES_WITHIN;
        let mut begin = FirstBytes::new();
        loop {
            let missing = match self.gateway.settings(|settings| settings.whose(&self.listen, peer, &begin)) {
                Whose::Port(port) => return Ok(port),
                Whose::After(missing) => missing,
                Whose::Nobody => return Err(Event::Unwelcome),
            };
            let mut piece = [0; FIRST_BYTES_MAX];
            let piece = piece.get_mut(..missing).unwrap_or(&mut []);
            match select3(stream.read(piece), self.connection.leave.wait(), until(give_up)).await {
                Either3::First(Ok(0) | Err(_)) => return Err(Event::Left),
                Either3::First(Ok(count)) => {
                    // Fits: no more is missing.
                    let _ = begin.extend_from_slice(piece.get(..count).unwrap_or(&[]));
                }
                Either3::Second(()) => return Err(Event::Crowded),
                Either3::Third(()) => return Err(Event::Stalled),
            }
        }
    }

    /// Counts a device that is disconnected, at the first port that listens there, and reports it unless it has left.
    fn refuse(&self, peer: IpAddr, why: Event) {
        let first = self.gateway.settings(|settings| Some(settings.dial_ins(&self.listen).next()?.0));
        let id = first.unwrap_or(self.id);
        let port_state = self.gateway.ports().get(id.index()).unwrap_or(self.port_state);
        port_state.stats.count(why);
        if why != Event::Left {
            listening::refuses_device(self.gateway, id, peer, why);
        }
    }
}
