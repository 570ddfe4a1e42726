//! The load: clients that ask one question after the other, by Modbus TCP or at the line itself, and what came of it.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::ops::AddAssign;
use std::thread;
use std::time::{Duration, Instant};

use mobgate::modbus::rtu;
use serial2::SerialPort;

use crate::line::{NO_SUCH_ADDRESS, Pace, request, response_to, sleep_until};

/// No gateway has a reason to take longer.
const PATIENCE: Duration = Duration::from_secs(5);
const MBAP_BYTES: usize = 7;

/// What a client asks.
#[derive(Clone, Copy)]
pub(crate) struct Habit {
    pub(crate) unit: u8,
    /// The first address.
    pub(crate) address: u16,
    /// From one to the next.
    pub(crate) step: u16,
    /// Pause behind each response.
    pub(crate) think: Duration,
}

impl Habit {
    /// The client `nth` of many: a unit and addresses of its own, as fast as it is answered.
    pub(crate) fn of(nth: usize) -> Self {
        Self { unit: nth as u8 + 1, address: 100 * nth as u16, step: 10, think: Duration::ZERO }
    }

    fn next(self, address: u16) -> u16 {
        // Without a step it stays where it is, be it where no register is.
        if self.step == 0 { address } else { (address + self.step) % NO_SUCH_ADDRESS }
    }
}

/// What came of a load.
#[derive(Default, Clone)]
pub(crate) struct Load {
    /// Of each transaction that brought what the device answers.
    pub(crate) times: Vec<Duration>,
    /// When the last of them ended.
    pub(crate) last: Option<Instant>,
    /// Responses by the gateway's own exceptions, or for something else.
    pub(crate) refused: u64,
    pub(crate) wrong: u64,
    /// No response in time, or a closed connection.
    pub(crate) lost: u64,
}

impl Load {
    fn note(&mut self, asked: Instant) {
        let now = Instant::now();
        self.times.push(now - asked);
        self.last = Some(now);
    }
}

impl AddAssign for Load {
    fn add_assign(&mut self, other: Self) {
        self.times.extend(other.times);
        self.last = self.last.max(other.last);
        self.refused += other.refused;
        self.wrong += other.wrong;
        self.lost += other.lost;
    }
}

/// A client of a TCP server on this machine.
pub(crate) struct Client {
    port: u16,
    stream: TcpStream,
    transaction: u16,
}

impl Client {
    pub(crate) fn connect(port: u16) -> io::Result<Self> {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_nodelay(true)?;
        Ok(Self { port, stream, transaction: 0 })
    }

    /// Waits so long for each response, until it has to connect anew.
    pub(crate) fn be_patient(&self, patience: Duration) -> io::Result<()> {
        self.stream.set_read_timeout(Some(patience))
    }

    /// Asks by `habit` while `more` of so many questions are to be asked.
    pub(crate) fn run(&mut self, habit: Habit, more: impl Fn(usize) -> bool) -> Load {
        let mut load = Load::default();
        let mut address = habit.address;
        for _ in (0..).take_while(|count| more(*count)) {
            let asked = Instant::now();
            match self.ask(habit.unit, address) {
                Ok(pdu) if pdu == response_to(address) => load.note(asked),
                Ok(pdu) if pdu.len() == 2 => load.refused += 1,
                Ok(_) => load.wrong += 1,
                Err(_) => {
                    load.lost += 1;
                    self.reconnect();
                }
            }
            address = habit.next(address);
            sleep_until(Instant::now() + habit.think);
        }
        load
    }

    /// Asks for the registers at `address`; the PDU that came, or nothing when it belongs to another question.
    fn ask(&mut self, unit: u8, address: u16) -> io::Result<Vec<u8>> {
        self.transaction = self.transaction.wrapping_add(1);
        let [high, low] = self.transaction.to_be_bytes();
        self.stream.write_all(&[&[high, low, 0, 0, 0, 6, unit], &request(address)[..]].concat())?;
        let mut header = [0; MBAP_BYTES];
        self.stream.read_exact(&mut header)?;
        let length = u16::from_be_bytes([header[4], header[5]]);
        let mut pdu = vec![0; usize::from(length).saturating_sub(1)];
        self.stream.read_exact(&mut pdu)?;
        let ours = header[..4] == [high, low, 0, 0] && header[6] == unit;
        Ok(if ours { pdu } else { Vec::new() })
    }

    fn reconnect(&mut self) {
        match Self::connect(self.port) {
            Ok(anew) => *self = anew,
            Err(_) => thread::sleep(Duration::from_millis(100)), // before the next attempt, which is counted as lost too
        }
    }
}

/// All of `clients` at the same time, each by its habit, until `until`.
pub(crate) fn ask_together(clients: &mut [Client], habits: &[Habit], until: Instant) -> Vec<Load> {
    ask_while(clients, habits, |_| Instant::now() < until)
}

/// All of `clients` at the same time, each by its habit, while `more` of so many questions are to be asked by each.
pub(crate) fn ask_while(
    clients: &mut [Client],
    habits: &[Habit],
    more: impl Fn(usize) -> bool + Sync,
) -> Vec<Load> {
    thread::scope(|scope| {
        let asking: Vec<_> = clients
            .iter_mut()
            .zip(habits)
            .map(|(client, habit)| scope.spawn(|| client.run(*habit, &more)))
            .collect();
        asking.into_iter().map(|client| client.join().unwrap()).collect()
    })
}

/// One client at the line itself, which keeps the silence between frames.
pub(crate) fn ask_directly(line: &mut SerialPort, pace: Pace, habit: Habit, until: Instant) -> Load {
    let mut load = Load::default();
    let mut frame = [0; rtu::FRAME_BYTES_MAX];
    let mut response = [0; rtu::FRAME_BYTES_MAX];
    let mut address = habit.address;
    while Instant::now() < until {
        let asked = Instant::now();
        let expected = response_to(address);
        let response = &mut response[..expected.len() + 3];
        line.write_all(rtu::encode(habit.unit, &request(address), &mut frame).unwrap()).unwrap();
        line.read_exact(response).unwrap();
        assert_eq!(rtu::decode(response), Ok((habit.unit, &expected[..])));
        load.note(asked);
        sleep_until(Instant::now() + pace.silence.max(habit.think));
        address = habit.next(address);
    }
    load
}
