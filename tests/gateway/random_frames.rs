//! Random frames on every kind of server: whatever comes, each well-formed request among them has its response, and all frames of
//! the pool come home.

use embassy_time::with_deadline;
use mobgate_simulator::client::frame as mbap;
use mobgate_simulator::net::{ClientStream, UdpClient};
use mobgate_simulator::random::chosen;
use mobgate_simulator::wire::LineEnd;

use crate::prelude::*;

const FRAMES: u32 = 13_000;
/// The unit that responds; those from 6 to 9 have a rule, and do not.
const UNIT: u8 = 5;
/// Longer than the gateway waits for a response, and than a pause that ends a frame.
const QUIET: Duration = Duration::from_millis(400);
const SETTINGS: &str = "port plc tcp client 10.0.1.1:502 timeout 100ms
    port tcp tcp server 502
    port rtu tcp server 503 rtu
    port udp udp server 504
    port line-rtu serial uart1 rtu server 115200 8N1
    port line-ascii serial uart2 ascii server 115200 7E1
    route tcp 5-9 * * plc
    route rtu 5-9 * * plc
    route udp 5-9 * * plc
    route line-rtu 5-9 * * plc
    route line-ascii 5-9 * * plc";

/// How a frame is told from what is around it.
#[derive(Clone, Copy)]
enum Envelope {
    Mbap,
    Serial(Framing),
}

impl Envelope {
    fn frame(self, transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
        match self {
            Self::Mbap => mbap(transaction, unit, pdu),
            Self::Serial(framing) => framing::frame(framing, unit, pdu),
        }
    }
}

/// A way to a server.
enum ReplyTo {
    Stream(ClientStream),
    Datagrams(UdpClient),
    Line(LineEnd),
}

impl ReplyTo {
    fn stream(rig: &Rig<'_>, port: u16) -> Self {
        Self::Stream(rig.network.connect(machine(1), port).unwrap())
    }

    fn line(rig: &Rig<'_>, device: &str) -> Self {
        Self::Line(rig.wire(device).tap(rig.end(device).line()))
    }

    /// Sends `bytes`; says whether the way is open still.
    async fn send(&mut self, bytes: &[u8]) -> bool {
        match self {
            Self::Stream(stream) => stream.write_all(bytes).await.is_ok(),
            Self::Datagrams(client) => {
                client.send(bytes);
                true
            }
            Self::Line(line) => line.write_all(bytes).await.is_ok(),
        }
    }

    /// What comes next; nothing when nothing does until `deadline`, or ever again.
    async fn receive(&mut self, deadline: Instant) -> Option<Vec<u8>> {
        let mut bytes = [0; 600];
        let count = match self {
            Self::Stream(stream) => with_deadline(deadline, stream.read(&mut bytes)).await.ok()?.ok()?,
            Self::Datagrams(client) => {
                return client.receive(deadline.saturating_duration_since(Instant::now())).await;
            }
            Self::Line(line) => with_deadline(deadline, line.read(&mut bytes)).await.ok()?.ok()?,
        };
        (count > 0).then(|| bytes[..count].to_vec())
    }

    /// Takes what comes until nothing has for long enough.
    async fn drain(&mut self) {
        while self.receive(Instant::now() + QUIET).await.is_some() {}
    }
}

/// A read of input registers, and its response.
fn read(random: &mut Random) -> (Vec<u8>, Vec<u8>) {
    let most = if random.chance(0.1) { 125 } else { 8 };
    let (address, count) = (random.within(0..=9_000) as u16, random.within(1..=most) as u16);
    let request = [&[4][..], &address.to_be_bytes(), &count.to_be_bytes()].concat();
    let registers =
        (address..address + count).flat_map(|at| (!(u16::from(UNIT) << 8 | at & 0xff)).to_be_bytes());
    (request, [4, 2 * count as u8].into_iter().chain(registers).collect())
}

fn bytes(random: &mut Random, lengths: std::ops::RangeInclusive<u64>) -> Vec<u8> {
    (0..random.within(lengths)).map(|_| random.byte()).collect()
}

/// Something that is no well-formed read; whether the next frame's beginning can be found behind it in an MBAP stream.
fn noise(random: &mut Random, envelope: Envelope, transaction: u16) -> (Vec<u8>, bool) {
    let unit = if random.chance(0.5) { random.within(5..=9) as u8 } else { random.byte() };
    match random.index(3) {
        0 => {
            let longest = if random.chance(0.1) { 300 } else { 20 };
            (bytes(random, 1..=longest), false)
        }
        1 => {
            let longest = if random.chance(0.1) { 253 } else { 12 };
            (envelope.frame(transaction, unit, &bytes(random, 1..=longest)), true)
        }
        _ => {
            let mut frame = envelope.frame(transaction, UNIT, &read(random).0);
            match random.index(3) {
                0 => frame.truncate(random.index(frame.len())),
                1 => frame.extend(bytes(random, 1..=20)),
                _ => {
                    let at = random.index(frame.len());
                    frame[at] ^= 1 << random.index(8);
                }
            }
            (frame, false)
        }
    }
}

/// Sends random frames to a server; every third one is a read and has its response.
fn torture(name: &str, envelope: Envelope, open: impl Fn(&Rig<'_>) -> ReplyTo) {
    let seed = chosen("MOBGATE_SEED").unwrap_or(14);
    println!("random frames on {name}: MOBGATE_SEED={seed}");
    with_gateway(seed, SETTINGS, |world: &mut World<'_>, rig| {
        rig.attach_tcp(world, PLC, [Device::new(UNIT)]);
        let mut random = Random::new(seed);
        let mut way = open(rig);
        world.run_for(QUIET);
        let mut answered = 0;
        for nth in 0..FRAMES {
            let transaction = nth as u16;
            if nth % 3 != 2 {
                let (frame, stays) = noise(&mut random, envelope, transaction);
                let sent = world.run_until(async { way.send(&frame).await });
                world.run_until(async { way.drain().await });
                // An MBAP stream has no other way back than a new connection.
                if !sent || (matches!((&way, envelope), (ReplyTo::Stream(..), Envelope::Mbap)) && !stays) {
                    way = open(rig);
                }
                continue;
            }
            let (request, response) = read(&mut random);
            let request = envelope.frame(transaction, UNIT, &request);
            let expected = envelope.frame(transaction, UNIT, &response);
            let deadline = Instant::now() + Duration::from_secs(2);
            let mut got = Vec::new();
            // A connection that a frame has ended is found out now.
            let mut sent = world.run_until(async { way.send(&request).await });
            while sent && got.len() < expected.len() {
                match world.run_until(async { way.receive(deadline).await }) {
                    Some(bytes) => got.extend(bytes),
                    None => sent = false,
                }
            }
            if got.is_empty() && matches!(way, ReplyTo::Stream(..)) && Instant::now() < deadline {
                way = open(rig);
                continue;
            }
            assert_eq!(got, expected, "{name}, MOBGATE_SEED={seed}: frame {nth}");
            answered += 1;
        }
        assert!(answered > FRAMES / 4, "{name}: {answered} reads of {FRAMES} frames");
        drop(way);
        world.run_for(Duration::from_secs(60));
        assert_eq!(rig.frames_in_use(), 0, "{name}, MOBGATE_SEED={seed}");
    });
}

#[test]
fn a_tcp_server_answers_what_is_well_formed_among_random_frames() {
    torture("Modbus TCP", Envelope::Mbap, |rig| ReplyTo::stream(rig, 502));
}

#[test]
fn a_server_of_rtu_over_tcp_answers_what_is_well_formed_among_random_frames() {
    torture("RTU over TCP", Envelope::Serial(Framing::Rtu), |rig| ReplyTo::stream(rig, 503));
}

#[test]
fn a_udp_server_answers_what_is_well_formed_among_random_frames() {
    torture("Modbus UDP", Envelope::Mbap, |rig| ReplyTo::Datagrams(rig.network.udp_client(machine(1), 504)));
}

#[test]
fn an_rtu_server_answers_what_is_well_formed_among_random_frames() {
    torture("RTU", Envelope::Serial(Framing::Rtu), |rig| ReplyTo::line(rig, "uart1"));
}

#[test]
fn an_ascii_server_answers_what_is_well_formed_among_random_frames() {
    torture("ASCII", Envelope::Serial(Framing::Ascii), |rig| ReplyTo::line(rig, "uart2"));
}
