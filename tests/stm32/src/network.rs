//! A station at the other end of the board's Ethernet cable: a TCP/IP stack with Modbus TCP clients and servers of datagrams, on the
//! board's clock.

use std::collections::VecDeque;
use std::time::Duration;

use smoltcp::iface::{Config, Interface, SocketHandle, SocketSet};
use smoltcp::phy::{Device, DeviceCapabilities, Medium, RxToken, TxToken};
use smoltcp::socket::{tcp, udp};
use smoltcp::time::Instant;
use smoltcp::wire::{EthernetAddress, HardwareAddress, IpAddress, IpCidr, IpEndpoint};

use crate::machine::{Machine, Stop};

/// How long the board runs before frames are exchanged.
const STEP: Duration = Duration::from_micros(50);
const BUFFER_BYTES: usize = 4096;

/// The cable's end: frames from the board and to it.
#[derive(Default)]
struct Cable {
    received: VecDeque<Vec<u8>>,
    sent: Vec<Vec<u8>>,
}

struct Received(Vec<u8>);

impl RxToken for Received {
    fn consume<R, F: FnOnce(&[u8]) -> R>(self, take: F) -> R {
        take(&self.0)
    }
}

struct Sending<'a>(&'a mut Vec<Vec<u8>>);

impl TxToken for Sending<'_> {
    fn consume<R, F: FnOnce(&mut [u8]) -> R>(self, length: usize, fill: F) -> R {
        let mut frame = vec![0; length];
        let result = fill(&mut frame);
        self.0.push(frame);
        result
    }
}

impl Device for Cable {
    type RxToken<'a> = Received;
    type TxToken<'a> = Sending<'a>;

    fn receive(&mut self, _: Instant) -> Option<(Received, Sending<'_>)> {
        let frame = self.received.pop_front()?;
        Some((Received(frame), Sending(&mut self.sent)))
    }

    fn transmit(&mut self, _: Instant) -> Option<Sending<'_>> {
        Some(Sending(&mut self.sent))
    }

    fn capabilities(&self) -> DeviceCapabilities {
        let mut capabilities = DeviceCapabilities::default();
        capabilities.medium = Medium::Ethernet;
        capabilities.max_transmission_unit = 1514;
        capabilities
    }
}

/// The station.
pub struct Network {
    cable: Cable,
    interface: Interface,
    sockets: SocketSet<'static>,
    next_port: u16,
}

/// A connection of the station's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Client {
    socket: SocketHandle,
}

/// A server of datagrams at the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagrams {
    socket: SocketHandle,
}

/// Who has sent a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender(IpEndpoint);

impl Network {
    /// A station with this address in a network of 256.
    pub fn new(address: [u8; 4]) -> Self {
        let mut cable = Cable::default();
        let own = EthernetAddress([2, 0, 0, 0, 0, 1]);
        let mut interface =
            Interface::new(Config::new(HardwareAddress::Ethernet(own)), &mut cable, Instant::ZERO);
        let [a, b, c, d] = address;
        interface.update_ip_addrs(|addresses| {
            // There is room for one at least.
            let _ = addresses.push(IpCidr::new(IpAddress::v4(a, b, c, d), 24));
        });
        Self { cable, interface, sockets: SocketSet::new(Vec::new()), next_port: 40_000 }
    }

    /// Lets the board and the station run until `done`, at most for so long. False: it was not.
    pub fn run(
        &mut self,
        machine: &mut Machine,
        at_most: Duration,
        mut done: impl FnMut(&mut Self) -> bool,
    ) -> Result<bool, Stop> {
        let end = machine.now() + at_most;
        while !done(self) {
            if machine.now() >= end {
                return Ok(false);
            }
            self.exchange(machine);
            machine.run(STEP)?;
        }
        Ok(true)
    }

    fn exchange(&mut self, machine: &mut Machine) {
        let mut bus = machine.bus.borrow_mut();
        self.cable.received.extend(bus.ethernet.sent.drain(..));
        let now = Instant::from_micros(crate::time::duration(bus.now).as_micros() as i64);
        self.interface.poll(now, &mut self.cable, &mut self.sockets);
        for frame in self.cable.sent.drain(..) {
            let now = bus.now;
            bus.ethernet.arrive(frame, now);
        }
    }

    /// Begins to connect to a TCP port of the board, and waits for it for 5 s at most.
    pub fn connect(&mut self, machine: &mut Machine, board: [u8; 4], port: u16) -> Result<Client, Stop> {
        let buffer = || tcp::SocketBuffer::new(vec![0; BUFFER_BYTES]);
        let mut socket = tcp::Socket::new(buffer(), buffer());
        socket.set_nagle_enabled(false);
        let handle = self.sockets.add(socket);
        self.next_port += 1;
        let [a, b, c, d] = board;
        let socket = self.sockets.get_mut::<tcp::Socket<'_>>(handle);
        socket
            .connect(self.interface.context(), (IpAddress::v4(a, b, c, d), port), self.next_port)
            .map_err(|error| Stop::Fault(error.to_string()))?;
        let client = Client { socket: handle };
        if self.run(machine, Duration::from_secs(5), |network| network.is_open(client))? {
            return Ok(client);
        }
        Err(Stop::Fault(format!("no connection; the program is {}", machine.place())))
    }

    /// Opens a UDP port.
    pub fn datagrams(&mut self, port: u16) -> Datagrams {
        let buffer = || udp::PacketBuffer::new(vec![udp::PacketMetadata::EMPTY; 8], vec![0; BUFFER_BYTES]);
        let mut socket = udp::Socket::new(buffer(), buffer());
        // It is new, and the port is not 0.
        let _ = socket.bind(port);
        Datagrams { socket: self.sockets.add(socket) }
    }

    /// The next datagram that a server has got, and by whom.
    pub fn receive_datagram(&mut self, server: Datagrams) -> Option<(Vec<u8>, Sender)> {
        let (bytes, from) = self.sockets.get_mut::<udp::Socket<'_>>(server.socket).recv().ok()?;
        Some((bytes.to_vec(), Sender(from.endpoint)))
    }

    /// Sends a datagram from a server.
    pub fn send_datagram(&mut self, server: Datagrams, bytes: &[u8], to: Sender) {
        // Its buffer is larger than what is ever waiting.
        let _ = self.sockets.get_mut::<udp::Socket<'_>>(server.socket).send_slice(bytes, to.0);
    }

    /// Whether bytes can be sent.
    pub fn is_open(&self, client: Client) -> bool {
        self.sockets.get::<tcp::Socket<'_>>(client.socket).may_send()
    }

    /// Sends bytes; returns how many there was room for.
    pub fn send_bytes(&mut self, client: Client, bytes: &[u8]) -> usize {
        self.sockets.get_mut::<tcp::Socket<'_>>(client.socket).send_slice(bytes).unwrap_or(0)
    }

    /// Appends the bytes that have come; false: the board has closed the connection, and there are no more.
    pub fn receive_bytes(&mut self, client: Client, bytes: &mut Vec<u8>) -> bool {
        let socket = self.sockets.get_mut::<tcp::Socket<'_>>(client.socket);
        // It has failed when the connection is closed.
        let _ = socket.recv(|come| (come.len(), bytes.extend_from_slice(come)));
        socket.may_recv()
    }

    /// Sends a Modbus TCP request.
    pub fn send(&mut self, client: Client, transaction: u16, unit: u8, pdu: &[u8]) {
        let [id_high, id_low] = transaction.to_be_bytes();
        let [high, low] = (pdu.len() as u16 + 1).to_be_bytes();
        let frame = [&[id_high, id_low, 0, 0, high, low, unit], pdu].concat();
        // Its buffer is larger than what is ever waiting.
        let _ = self.sockets.get_mut::<tcp::Socket<'_>>(client.socket).send_slice(&frame);
    }

    /// The next response of a connection, if all of it is there: its transaction, unit and PDU.
    pub fn receive(&mut self, client: Client) -> Option<(u16, u8, Vec<u8>)> {
        let socket = self.sockets.get_mut::<tcp::Socket<'_>>(client.socket);
        let mut head = [0; 7];
        if socket.peek_slice(&mut head).ok()? < head.len() {
            return None;
        }
        let length = 6 + usize::from(u16::from_be_bytes([head[4], head[5]]));
        if socket.recv_queue() < length {
            return None;
        }
        let mut frame = vec![0; length];
        socket.recv_slice(&mut frame).ok()?;
        Some((u16::from_be_bytes([head[0], head[1]]), head[6], frame.split_off(7)))
    }
}
