//! A Modbus TCP client.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

use crate::{PATIENCE, wait_for};

/// A connection to the board.
pub struct Client {
    stream: TcpStream,
    transaction: u16,
}

impl Client {
    /// Connects to the board behind `port` of this host.
    pub fn connect(port: u16) -> Self {
        let stream = wait_for("a connection", || TcpStream::connect((Ipv4Addr::LOCALHOST, port)).ok());
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_nodelay(true).unwrap();
        Self { stream, transaction: 0 }
    }

    /// Sends a request and does not wait.
    pub fn send(&mut self, unit: u8, pdu: &[u8]) -> io::Result<()> {
        self.transaction = self.transaction.wrapping_add(1);
        let [id_high, id_low] = self.transaction.to_be_bytes();
        let [high, low] = (pdu.len() as u16 + 1).to_be_bytes();
        self.stream.write_all(&[&[id_high, id_low, 0, 0, high, low, unit], pdu].concat())
    }

    /// The next response: its transaction, unit and PDU.
    pub fn receive(&mut self) -> io::Result<(u16, u8, Vec<u8>)> {
        let mut head = [0; 7];
        self.stream.read_exact(&mut head)?;
        let length = usize::from(u16::from_be_bytes([head[4], head[5]]));
        let mut pdu = vec![0; length.saturating_sub(1)];
        self.stream.read_exact(&mut pdu)?;
        Ok((u16::from_be_bytes([head[0], head[1]]), head[6], pdu))
    }

    /// Sends a request and gives the response's PDU.
    pub fn try_ask(&mut self, unit: u8, pdu: &[u8]) -> io::Result<Vec<u8>> {
        self.send(unit, pdu)?;
        let (transaction, from, response) = self.receive()?;
        if (transaction, from) != (self.transaction, unit) {
            return Err(io::Error::other("a response to another request"));
        }
        Ok(response)
    }

    /// [`try_ask`](Self::try_ask), where nothing may go wrong.
    pub fn ask(&mut self, unit: u8, pdu: &[u8]) -> Vec<u8> {
        self.try_ask(unit, pdu).unwrap_or_else(|error| panic!("unit {unit}, {pdu:?}: {error}"))
    }

    /// Reads `count` holding registers.
    pub fn read(&mut self, unit: u8, address: u16, count: u16) -> Vec<u8> {
        let ([ah, al], [ch, cl]) = (address.to_be_bytes(), count.to_be_bytes());
        self.ask(unit, &[3, ah, al, ch, cl])
    }

    /// Sends bytes as they are.
    pub fn send_raw(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).unwrap();
    }

    /// Whether the board ends the connection.
    pub fn is_closed(&mut self) -> bool {
        matches!(self.stream.read(&mut [0; 1]), Ok(0) | Err(_))
    }

    /// Ends the connection by a reset.
    pub fn reset(self) {
        let socket = socket2::SockRef::from(&self.stream);
        socket.set_linger(Some(Duration::ZERO)).unwrap();
    }
}
