//! Floods of requests that are refused, and of connections that bring nothing: what they leave of a line's goodput.
//!
//! ```text
//! 8 clients, 127.0.0.1 --> mobgate --> PTY --> device
//! flood,     127.0.0.2 -----^
//! ```
//!
//! The clients ask all the time; the flood comes and goes, second by second, so that whatever else the machine does meets both
//! alike.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use rustix::event::Timespec;
use rustix::event::epoll::{self, CreateFlags, EventData, EventFlags};
use socket2::{Domain, Protocol, Socket, Type};

use crate::Effort;
use crate::common::{PATIENCE, Program, wait_for};
use crate::figure::{Target, figure};
use crate::line::{Device, Line, Pace};
use crate::load::{Client, Habit, Load, ask_together};
use crate::statistics::median;
use crate::usage::Usage;

/// Connections that ask in a flood, and requests that each has open at a time.
const CONNECTIONS: usize = 200;
const OPEN: usize = 16;
/// Threads that connect again and again in a flood of connections.
const CONNECTING: usize = 4;
const CLIENTS: usize = 8;
/// A network whose every address is this machine.
const FLOODER: Ipv4Addr = Ipv4Addr::new(127, 0, 0, 2);
/// Longer than it takes to send a flood's first requests.
const SETTLE: Duration = Duration::from_millis(200);

/// A flood, by what its requests get.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    /// One request, again and again: a unit, and a PDU.
    Asks(u8, [u8; 5]),
    /// A connection that is opened and gets these bytes, of which the server closes it; without bytes the client does.
    Connects(&'static [u8]),
}

const READ: [u8; 5] = [3, 0, 0, 0, 10];
const WRITE: [u8; 5] = [6, 0, 0, 0, 10];

pub(crate) const KINDS: [(&str, Kind); 8] = [
    ("queue_full_06", Kind::Asks(1, READ)),
    ("forbidden_01", Kind::Asks(20, WRITE)),
    ("bad_address_02", Kind::Asks(21, READ)),
    ("bad_value_03", Kind::Asks(1, [3, 0, 0, 0, 0])),
    ("no_rule_0a", Kind::Asks(99, READ)),
    ("unit_down_0b", Kind::Asks(30, READ)),
    ("malformed", Kind::Connects(&[0, 1, 0, 0, 0xff, 0xff, 1])),
    ("connects", Kind::Connects(&[])),
];

/// A flood that can be turned on and off.
struct Flood {
    on: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
    /// Responses, or connections.
    refused: Arc<AtomicU64>,
    threads: Vec<JoinHandle<()>>,
}

impl Flood {
    fn new(kind: Kind, port: u16) -> Self {
        let mut flood =
            Self { on: Arc::default(), over: Arc::default(), refused: Arc::default(), threads: Vec::new() };
        match kind {
            Kind::Asks(unit, pdu) => {
                let mut crowd = Crowd::connect(port, unit, pdu).unwrap();
                flood.spawn(move |on, refused| crowd.ask(on, refused).unwrap());
            }
            Kind::Connects(bytes) => {
                for _ in 0..CONNECTING {
                    flood.spawn(move |on, refused| {
                        if on {
                            // A full backlog is a flood's own business.
                            refused.fetch_add(come_and_go(port, bytes).is_ok().into(), Relaxed);
                        } else {
                            thread::sleep(Duration::from_millis(5)); // until it is turned on again
                        }
                    });
                }
            }
        }
        flood
    }

    fn spawn(&mut self, mut round: impl FnMut(bool, &AtomicU64) + Send + 'static) {
        let (on, over, refused) = (self.on.clone(), self.over.clone(), self.refused.clone());
        self.threads.push(thread::spawn(move || {
            while !over.load(Relaxed) {
                round(on.load(Relaxed), &refused);
            }
        }));
    }

    fn end(self) {
        self.over.store(true, Relaxed);
        self.threads.into_iter().for_each(|thread| thread.join().unwrap());
    }
}

fn connect(port: u16) -> io::Result<TcpStream> {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, Some(Protocol::TCP))?;
    socket.bind(&SocketAddr::new(IpAddr::V4(FLOODER), 0).into())?;
    // No port is kept back when it is closed: there are not enough of them.
    socket.set_linger(Some(Duration::ZERO))?;
    socket.connect_timeout(&SocketAddr::from((Ipv4Addr::LOCALHOST, port)).into(), PATIENCE)?;
    socket.set_tcp_nodelay(true)?;
    Ok(socket.into())
}

fn come_and_go(port: u16, bytes: &[u8]) -> io::Result<()> {
    let mut stream = connect(port)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    if !bytes.is_empty() {
        stream.write_all(bytes)?;
        // Until the server has closed it.
        while stream.read(&mut [0; 64]).is_ok_and(|count| count > 0) {}
    }
    Ok(())
}

/// Connections that keep their requests open.
struct Crowd {
    epoll: rustix::fd::OwnedFd,
    members: Vec<Member>,
}

struct Member {
    stream: TcpStream,
    /// Its own: what all ask for would be asked for once.
    request: Vec<u8>,
    open: usize,
    /// Bytes of responses that are not whole yet.
    input: Vec<u8>,
}

impl Crowd {
    fn connect(port: u16, unit: u8, pdu: [u8; 5]) -> io::Result<Self> {
        let epoll = epoll::create(CreateFlags::CLOEXEC)?;
        let mut members = Vec::new();
        for key in 0..CONNECTIONS {
            let stream = connect(port)?;
            stream.set_nonblocking(true)?;
            epoll::add(&epoll, &stream, EventData::new_u64(key as u64), EventFlags::IN)?;
            let [function, _, _, rest @ ..] = pdu;
            let [high, low] = (10 * key as u16).to_be_bytes();
            let request = [&[0, 1, 0, 0, 0, 6, unit, function, high, low], &rest[..]].concat();
            members.push(Member { stream, request, open: 0, input: Vec::new() });
        }
        Ok(Self { epoll, members })
    }

    /// Keeps everybody's requests open while it is `on`, and counts the responses.
    fn ask(&mut self, on: bool, responses: &AtomicU64) -> io::Result<()> {
        let mut events = Vec::with_capacity(CONNECTIONS);
        let while_on_or_off = Timespec { tv_sec: 0, tv_nsec: 5_000_000 };
        let buffer = rustix::buffer::spare_capacity(&mut events);
        epoll::wait(&self.epoll, buffer, Some(&while_on_or_off))?;
        for event in events {
            if let Some(member) = self.members.get_mut(event.data.u64() as usize) {
                responses.fetch_add(member.take_responses()?, Relaxed);
            }
        }
        if on {
            self.members.iter_mut().try_for_each(Member::ask)?;
        }
        Ok(())
    }
}

impl Member {
    /// Opens as many requests as may be open.
    fn ask(&mut self) -> io::Result<()> {
        if self.open < OPEN {
            // There is room: what is open fits into the smallest buffer of a socket.
            self.stream.write_all(&self.request.repeat(OPEN - self.open))?;
            self.open = OPEN;
        }
        Ok(())
    }

    fn take_responses(&mut self) -> io::Result<u64> {
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(count) => self.input.extend_from_slice(&bytes[..count]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        let mut responses = 0;
        while let Some(&[high, low]) = self.input.get(4..6) {
            let length = 6 + usize::from(u16::from_be_bytes([high, low]));
            if self.input.len() < length {
                break;
            }
            self.input.drain(..length);
            self.open -= 1;
            responses += 1;
        }
        Ok(responses)
    }
}

/// A gateway with a line for its clients and a silent one.
struct Gateway {
    line: Line,
    _silent: Line,
    program: Program,
    clients: Vec<Client>,
}

/// What a second brought.
struct Second {
    /// Requests at the device, per second.
    line: f64,
    /// What the clients have of it.
    clients: f64,
    /// Of the program's time.
    cpu: f64,
    refused: f64,
}

/// Of a gateway with a line whose units respond or not within `timeout`, and one with a unit 30 that never responds. `{port}` is the TCP
/// server's.
pub(crate) fn settings(line: &Line, silent: &Line, baud: u32, timeout: &str) -> String {
    format!(
        "port P502 tcp server {{port}} clients 250\n\
         port P1 serial {} rtu client {baud} 8N2 timeout {timeout} late-window 100ms\n\
         port P2 serial {} rtu client {baud} 8N2 timeout 50ms down-after 1\n\
         route P502 1-8 * * P1\n\
         route P502 20 * * P1 readonly\n\
         route P502 21 * * P1 addresses 10000-20000\n\
         route P502 30 * * P2\n",
        line.device(),
        silent.device()
    )
}

impl Gateway {
    fn start(device: Device) -> Self {
        let (line, silent) = (Line::with(device), Line::with(Device { dead: Some(30), ..device }));
        let program = Program::configured(&settings(&line, &silent, device.pace.baud, "500ms"));
        wait_for("the lines", || (program.log().matches("is open").count() == 2).then_some(()));
        let clients = (0..CLIENTS).map(|_| Client::connect(program.port).unwrap()).collect();
        Self { line, _silent: silent, program, clients }
    }

    fn second(&mut self, flood: &Flood, on: bool, length: Duration) -> Second {
        let habits: Vec<Habit> = (0..CLIENTS).map(Habit::of).collect();
        flood.on.store(on, Relaxed);
        ask_together(&mut self.clients, &habits, Instant::now() + SETTLE);
        let (start, usage) = (Instant::now(), Usage::of(self.program.id()));
        let (requests, refused) = (self.line.heard.requests.load(Relaxed), flood.refused.load(Relaxed));
        let loads = ask_together(&mut self.clients, &habits, start + length);
        let took = start.elapsed().as_secs_f64();
        let good: usize = loads.iter().map(|load: &Load| load.times.len()).sum();
        Second {
            line: (self.line.heard.requests.load(Relaxed) - requests) as f64 / took,
            clients: good as f64 / took,
            cpu: (Usage::of(self.program.id()) - usage).cpu.as_secs_f64() / took,
            refused: (flood.refused.load(Relaxed) - refused) as f64 / took,
        }
    }
}

pub(crate) fn figures(effort: Effort) {
    let pace = Pace::of(115_200);
    let mut gateway = Gateway::start(Device { pace, strict: false, dead: None });
    println!("\nfloods beside {CLIENTS} clients, per second");
    println!(
        "  {:16}{:>9}{:>9}{:>10}{:>10}{:>9}{:>10}",
        "", "line", "flooded", "clients", "flooded", "CPU %", "refused"
    );
    for (name, kind) in KINDS {
        let flood = Flood::new(kind, gateway.program.port);
        let rounds: Vec<(Second, Second)> = (0..effort.rounds(9))
            .map(|_| {
                let alone = gateway.second(&flood, false, effort.length(1_000));
                (alone, gateway.second(&flood, true, effort.length(1_000)))
            })
            .collect();
        flood.end();
        let of = |value: fn(&(Second, Second)) -> f64| median(rounds.iter().map(value));
        println!(
            "  {name:16}{:>9.0}{:>9.0}{:>10.0}{:>10.0}{:>9.0}{:>10.0}",
            of(|(alone, _)| alone.line),
            of(|(_, flooded)| flooded.line),
            of(|(alone, _)| alone.clients),
            of(|(_, flooded)| flooded.clients),
            of(|(_, flooded)| 100.0 * flooded.cpu),
            of(|(_, flooded)| flooded.refused)
        );
        let kept = of(|(alone, flooded)| flooded.line / alone.line);
        figure(&format!("flood_goodput_{name}"), kept, "ratio", Target::AtLeast(0.95));
    }
}
