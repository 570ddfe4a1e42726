//! A client, or a master on a serial line, whose responses are taken in as they come, each with its time of arrival.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_time::{Duration, Instant};
use embedded_io_async::Write;
use mobgate::settings::Framing;

use super::{FRAME_BYTES_MAX, Reply, frame, rtu, take_frame};
use crate::framing::{self, Listener};
use crate::net::{ClientStream, Pipe, UdpClient};
use crate::wire::LineEnd;
use crate::world::World;

/// A connected client that sends and receives independently.
pub struct Session {
    way: ReplyTo,
    inbox: Rc<RefCell<Inbox>>,
    transaction: u16,
}

/// What a session sends by.
enum ReplyTo {
    Stream(ClientStream),
    RtuStream(ClientStream),
    Datagrams(Rc<UdpClient>),
    Line(LineEnd, Framing),
}

/// Something that came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival {
    /// When.
    pub at: Instant,
    /// The frame; none is the end of the connection.
    pub reply: Option<Reply>,
}

#[derive(Default)]
struct Inbox {
    arrivals: VecDeque<Arrival>,
    waiting: Option<Waker>,
}

impl Session {
    /// Starts to receive on `stream`.
    pub fn start(stream: ClientStream, world: &World<'_>) -> Self {
        let inbox = Rc::<RefCell<Inbox>>::default();
        world.spawn(receive(stream.reader(), take_frame, inbox.clone()));
        Self { way: ReplyTo::Stream(stream), inbox, transaction: 0 }
    }

    /// Starts to receive RTU frames on `stream`. What comes bears no transaction id: it has 0.
    pub fn rtu(stream: ClientStream, world: &World<'_>) -> Self {
        let inbox = Rc::<RefCell<Inbox>>::default();
        world.spawn(receive(stream.reader(), rtu::take_frame, inbox.clone()));
        Self { way: ReplyTo::RtuStream(stream), inbox, transaction: 0 }
    }

    /// Starts to receive datagrams at `client`.
    pub fn datagrams(client: UdpClient, world: &World<'_>) -> Self {
        let (inbox, client) = (Rc::<RefCell<Inbox>>::default(), Rc::new(client));
        world.spawn(collect(client.clone(), inbox.clone()));
        Self { way: ReplyTo::Datagrams(client), inbox, transaction: 0 }
    }

    /// Starts to receive on a serial line, as a master. What comes bears no transaction id: it has 0. A corrupt frame has
    /// no PDU.
    pub fn on_line(line: LineEnd, framing: Framing, world: &World<'_>) -> Self {
        let inbox = Rc::<RefCell<Inbox>>::default();
        world.spawn(hear(Listener::new(line.clone(), framing), framing, inbox.clone()));
        Self { way: ReplyTo::Line(line, framing), inbox, transaction: 0 }
    }

    /// A session on `stream` that never receives anything.
    pub fn deaf(stream: ClientStream) -> Self {
        Self { way: ReplyTo::Stream(stream), inbox: Rc::default(), transaction: 0 }
    }

    /// Sends a request; its transaction id, or nothing when the connection has ended.
    pub async fn send(&mut self, unit: u8, pdu: &[u8]) -> Option<u16> {
        let frame = match &self.way {
            ReplyTo::Stream(_) | ReplyTo::Datagrams(_) => {
                self.transaction = self.transaction.wrapping_add(1);
                frame(self.transaction, unit, pdu)
            }
            ReplyTo::RtuStream(_) => framing::frame(Framing::Rtu, unit, pdu),
            ReplyTo::Line(_, framing) => framing::frame(*framing, unit, pdu),
        };
        self.send_bytes(&frame).await.then_some(self.transaction)
    }

    /// Sends `bytes` as they are; false when the connection has ended.
    pub async fn send_bytes(&mut self, bytes: &[u8]) -> bool {
        match &mut self.way {
            ReplyTo::Stream(stream) | ReplyTo::RtuStream(stream) => stream.write_all(bytes).await.is_ok(),
            ReplyTo::Datagrams(client) => {
                client.send(bytes);
                true
            }
            ReplyTo::Line(line, _) => line.write_all(bytes).await.is_ok(),
        }
    }

    /// The next arrival that was not taken yet, if it has come.
    pub fn try_next(&self) -> Option<Arrival> {
        self.inbox.borrow_mut().arrivals.pop_front()
    }

    /// Waits for the next arrival.
    pub async fn next(&self) -> Arrival {
        poll_fn(|context| {
            let mut inbox = self.inbox.borrow_mut();
            match inbox.arrivals.pop_front() {
                Some(arrival) => Poll::Ready(arrival),
                None => {
                    inbox.waiting = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }

    /// The connection, to end it in one of its ways; a line or a socket for datagrams has none.
    pub fn into_stream(self) -> Option<ClientStream> {
        match self.way {
            ReplyTo::Stream(stream) | ReplyTo::RtuStream(stream) => Some(stream),
            ReplyTo::Line(..) | ReplyTo::Datagrams(_) => None,
        }
    }
}

async fn hear(mut listener: Listener, framing: Framing, inbox: Rc<RefCell<Inbox>>) {
    loop {
        let heard = listener.hear().await;
        let (unit, pdu) = framing::open(framing, &heard.bytes).unwrap_or_default();
        // The frame was there with its last bit; in RTU the listener knows so after the silence.
        let at = Instant::from_micros(heard.end_ns.div_ceil(1_000));
        let mut inbox = inbox.borrow_mut();
        let reply = Some(Reply { transaction: 0, protocol: 0, unit, pdu });
        inbox.arrivals.push_back(Arrival { at, reply });
        inbox.waiting.take().into_iter().for_each(Waker::wake);
    }
}

async fn collect(client: Rc<UdpClient>, inbox: Rc<RefCell<Inbox>>) {
    loop {
        let Some(mut datagram) = client.receive(Duration::from_secs(3_600)).await else { continue };
        let mut inbox = inbox.borrow_mut();
        inbox.arrivals.push_back(Arrival { at: Instant::now(), reply: take_frame(&mut datagram) });
        inbox.waiting.take().into_iter().for_each(Waker::wake);
    }
}

async fn receive(stream: Pipe, take: fn(&mut Vec<u8>) -> Option<Reply>, inbox: Rc<RefCell<Inbox>>) {
    let mut received = Vec::new();
    loop {
        let mut buffer = [0; FRAME_BYTES_MAX];
        let count = stream.read(&mut buffer).await.unwrap_or(0);
        received.extend_from_slice(&buffer[..count]);
        let mut inbox = inbox.borrow_mut();
        let at = Instant::now();
        while let Some(reply) = take(&mut received) {
            inbox.arrivals.push_back(Arrival { at, reply: Some(reply) });
        }
        if count == 0 {
            inbox.arrivals.push_back(Arrival { at, reply: None });
        }
        inbox.waiting.take().into_iter().for_each(Waker::wake);
        if count == 0 {
            return;
        }
    }
}
