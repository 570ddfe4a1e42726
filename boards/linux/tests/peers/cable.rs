//! A TCP connection that is cut without a word, or slow.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// How often it is looked at.
const LOOK: Duration = Duration::from_millis(5);
/// What a slow one passes on at a time, and how often: less than a value each 100 ms.
const PIECE_BYTES: usize = 100;
const PIECE: Duration = Duration::from_millis(200);

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    Whole,
    /// Nothing passes, and nobody is told.
    Cut,
    Slow,
}

struct Ends {
    state: State,
    to: u16,
    open: Vec<TcpStream>,
}

/// Passes connections on.
pub(crate) struct Cable {
    pub(crate) port: u16,
    ends: Arc<Mutex<Ends>>,
}

impl Cable {
    pub(crate) fn new() -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let ends = Arc::new(Mutex::new(Ends { state: State::Whole, to: 0, open: Vec::new() }));
        let own = ends.clone();
        thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let to = own.lock().unwrap().to;
                let Ok(far) = TcpStream::connect((Ipv4Addr::LOCALHOST, to)) else { continue };
                let [near_too, far_too] = [&near, &far].map(|end| end.try_clone().unwrap());
                own.lock().unwrap().open.extend([&near, &far].map(|end| end.try_clone().unwrap()));
                let [one, other] = [own.clone(), own.clone()];
                thread::spawn(move || pass(near, far, &one));
                thread::spawn(move || pass(far_too, near_too, &other));
            }
        });
        Self { port, ends }
    }

    /// Leads connections to this port from now on.
    pub(crate) fn lead_to(&self, port: u16) {
        self.ends.lock().unwrap().to = port;
    }

    pub(crate) fn set(&self, state: State) {
        self.ends.lock().unwrap().state = state;
    }

    /// Ends the connections that there are, with what they hold back.
    pub(crate) fn hang_up(&self) {
        for end in self.ends.lock().unwrap().open.drain(..) {
            // The other side may have ended it.
            let _ = end.shutdown(Shutdown::Both);
        }
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream, ends: &Mutex<Ends>) {
    let mut bytes = [0; PIECE_BYTES];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        if ends.lock().unwrap().state == State::Slow {
            thread::sleep(PIECE);
        }
        while ends.lock().unwrap().state == State::Cut {
            thread::sleep(LOOK);
            if to.peer_addr().is_err() {
                return;
            }
        }
        if to.write_all(&bytes[..count]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
}
