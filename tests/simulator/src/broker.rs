//! An MQTT broker as the gateway sees it, 3.1.1 or 5, written from the OASIS standards and not from the gateway's codec. It remembers what
//! it was sent, acknowledges it or not, and passes commands on. What begins with `spBv1.0/` it wants as Sparkplug B 3.0 says.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};

use crate::net::{ClientStream, Server};

/// How often it looks whether it has something to send, or is to end the connection.
const LOOK: Duration = Duration::from_millis(1);

/// A message that it was sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Published {
    /// When it came.
    pub at: Instant,
    /// Its topic.
    pub topic: String,
    /// What it carries,
    pub payload: Vec<u8>,
    /// and as text.
    pub text: String,
    /// Whether it is to be retained,
    pub retained: bool,
    /// or was sent before.
    pub again: bool,
    /// Its id; 0 if it is not to be acknowledged.
    pub id: u16,
}

/// What it publishes when a connection breaks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Will {
    /// Its topic.
    pub topic: String,
    /// What it carries.
    pub payload: Vec<u8>,
}

/// Topics of Sparkplug.
fn is_sparkplug(topic: &str) -> bool {
    topic.starts_with("spBv1.0/")
}

#[derive(Default)]
struct State {
    published: Vec<Published>,
    /// Levels of the protocol, of each connection.
    connections: Vec<u8>,
    /// Of each connection.
    wills: Vec<Will>,
    filters: Vec<String>,
    pings: usize,
    commands: Vec<(String, Vec<u8>)>,
    is_mute: bool,
    keeps_sessions: bool,
    /// The connection is to end.
    hangs_up: bool,
}

/// The broker.
#[derive(Clone, Default)]
pub struct Broker(Rc<RefCell<State>>);

impl Broker {
    /// All that it was sent, in order.
    pub fn published(&self) -> Vec<Published> {
        self.0.borrow().published.clone()
    }

    /// The texts of a topic.
    pub fn texts(&self, topic: &str) -> Vec<String> {
        let published = self.published().into_iter().filter(|message| message.topic == topic);
        published.map(|message| message.text).collect()
    }

    /// The levels of the protocol (4, 5) of the connections so far.
    pub fn connections(&self) -> Vec<u8> {
        self.0.borrow().connections.clone()
    }

    /// The wills of the connections so far.
    pub fn wills(&self) -> Vec<Will> {
        self.0.borrow().wills.clone()
    }

    /// What was subscribed to.
    pub fn filters(&self) -> Vec<String> {
        self.0.borrow().filters.clone()
    }

    /// How often it was asked whether it is there.
    pub fn pings(&self) -> usize {
        self.0.borrow().pings
    }

    /// Passes a message on.
    pub fn command(&self, topic: &str, payload: impl AsRef<[u8]>) {
        self.0.borrow_mut().commands.push((topic.to_owned(), payload.as_ref().to_owned()));
    }

    /// Says nothing any more, or speaks again.
    pub fn set_mute(&self, is_mute: bool) {
        self.0.borrow_mut().is_mute = is_mute;
    }

    /// Whether it knows a client again.
    pub fn set_keeps_sessions(&self, keeps: bool) {
        self.0.borrow_mut().keeps_sessions = keeps;
    }

    /// Ends the connection.
    pub fn hang_up(&self) {
        self.0.borrow_mut().hangs_up = true;
    }

    /// Serves one connection after the other, for ever.
    pub async fn serve(self, server: Server) {
        loop {
            let stream = server.accept().await;
            self.0.borrow_mut().hangs_up = false;
            self.converse(stream).await;
        }
    }

    async fn converse(&self, mut stream: ClientStream) {
        let (mut received, mut level) = (Vec::new(), 4);
        loop {
            let mut buffer = [0; 256];
            match select(stream.read(&mut buffer), Timer::after(LOOK)).await {
                Either::First(Ok(0) | Err(_)) => return,
                Either::First(Ok(count)) => received.extend_from_slice(&buffer[..count]),
                Either::Second(()) => {}
            }
            let mut out = Vec::new();
            while let Some((first, body)) = packet(&mut received) {
                out.extend(self.take(first, &body, &mut level));
            }
            if self.0.borrow().hangs_up {
                return stream.reset();
            }
            let commands = std::mem::take(&mut self.0.borrow_mut().commands);
            for (topic, payload) in commands {
                let none = if level == 5 { &[0][..] } else { &[] };
                let body = [&text_of(&topic)[..], none, &payload].concat();
                out.extend([0x30, body.len() as u8]);
                out.extend(body);
            }
            if stream.write_all(&out).await.is_err() {
                return;
            }
        }
    }

    /// Handles a packet, and gives the response.
    fn take(&self, first: u8, body: &[u8], level: &mut u8) -> Vec<u8> {
        let mut state = self.0.borrow_mut();
        let none = |level: u8| if level == 5 { vec![0] } else { Vec::new() };
        let respond = |first: u8, body: Vec<u8>| [vec![first, body.len() as u8], body].concat();
        match first >> 4 {
            1 => {
                assert_eq!(&body[..6], b"\0\x04MQTT");
                *level = body[6];
                let will = will(body);
                let is_clean = body[7] & 0x02 != 0;
                // Sparkplug: 2.5 and 5.4.
                assert_eq!(is_clean, is_sparkplug(&will.topic), "who wants to be forgotten");
                assert_eq!(body[7] & 0x3c, if is_clean { 0x0c } else { 0x2c }, "a will, at least once");
                if is_clean && *level == 5 {
                    assert_eq!(body[11..16], [0x11, 0, 0, 0, 0], "the session ends with the connection");
                }
                state.wills.push(will);
                let has_session = state.keeps_sessions && !is_clean && !state.connections.is_empty();
                state.connections.push(*level);
                respond(0x20, [vec![u8::from(has_session), 0], none(*level)].concat())
            }
            3 => {
                let end = 2 + usize::from(u16::from_be_bytes([body[0], body[1]]));
                let topic = String::from_utf8(body[2..end].to_vec()).unwrap();
                // Sparkplug: 6.4.19 and 6.4.21.
                let is_once = is_sparkplug(&topic);
                assert_eq!(first & 0x06, if is_once { 0 } else { 0x02 }, "the QoS");
                let (id, end) = if is_once { ([0; 2], end) } else { ([body[end], body[end + 1]], end + 2) };
                let properties = if *level == 5 { 1 + usize::from(body[end]) } else { 0 };
                let payload = body[end + properties..].to_vec();
                state.published.push(Published {
                    at: Instant::now(),
                    topic,
                    text: String::from_utf8_lossy(&payload).into_owned(),
                    payload,
                    retained: first & 1 == 1,
                    again: first & 8 == 8,
                    id: u16::from_be_bytes(id),
                });
                if state.is_mute || is_once { Vec::new() } else { respond(0x40, id.to_vec()) }
            }
            8 => {
                let at = if *level == 5 { 3 } else { 2 };
                let end = body.len() - 1;
                let filter = String::from_utf8(body[at + 2..end].to_vec()).unwrap();
                // Nothing waits for a client that is gone; Sparkplug (5.4) wants QoS 1 in a session that ends.
                assert_eq!(body[end] & 3, u8::from(is_sparkplug(&filter)), "the QoS");
                state.filters.push(filter);
                respond(0x90, [body[..2].to_vec(), none(*level), vec![0]].concat())
            }
            12 => {
                state.pings += 1;
                if state.is_mute { Vec::new() } else { vec![0xd0, 0] }
            }
            other => panic!("a client does not send packets of type {other}"),
        }
    }
}

/// The will in a CONNECT, behind the client's name.
fn will(body: &[u8]) -> Will {
    let is_five = body[6] == 5;
    let skip_properties = |at: usize| if is_five { at + 1 + usize::from(body[at]) } else { at };
    let next = |at: usize| {
        let end = at + 2 + usize::from(u16::from_be_bytes([body[at], body[at + 1]]));
        (body[at + 2..end].to_vec(), end)
    };
    let (_, end) = next(skip_properties(10));
    let (topic, end) = next(skip_properties(end));
    Will { topic: String::from_utf8(topic).unwrap(), payload: next(end).0 }
}

/// A text with its length.
fn text_of(text: &str) -> Vec<u8> {
    [&(text.len() as u16).to_be_bytes()[..], text.as_bytes()].concat()
}

/// Takes the first packet out of what was received, if it is whole.
fn packet(received: &mut Vec<u8>) -> Option<(u8, Vec<u8>)> {
    let (mut length, mut head) = (0, 1);
    loop {
        let byte = *received.get(head)?;
        length |= usize::from(byte & 0x7f) << (7 * (head - 1));
        head += 1;
        if byte < 0x80 {
            break;
        }
    }
    let whole: Vec<u8> =
        (received.len() >= head + length).then(|| received.drain(..head + length).collect())?;
    Some((whole[0], whole[head..].to_vec()))
}
