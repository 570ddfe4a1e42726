//! Every way in x every way out over TCP x every function code x every fault of the device: each has its
//! outcome, and the request behind it its own response.

use mobgate_simulator::client::frame;
use mobgate_simulator::device::Memory;
use mobgate_simulator::net::UdpClient;

use crate::outcomes::exchange;
use crate::prelude::*;

const UNIT: u8 = 5;
const FRESH: u16 = 100;
const READ_FRESH: [u8; 5] = [3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8];

#[derive(Debug, Clone, Copy, PartialEq)]
enum In {
    Tcp,
    Rtu,
    Udp,
    RtuLine,
    AsciiLine,
}

impl In {
    const ALL: [Self; 5] = [Self::Tcp, Self::Rtu, Self::Udp, Self::RtuLine, Self::AsciiLine];
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Out {
    Tcp,
    Rtu,
}

/// What the requester gets.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Outcome {
    /// What the device answers.
    Response,
    Exception(u8),
}

/// The functions that change nothing in a device, as they are asked here.
const READS: [u8; 11] = [1, 2, 3, 4, 7, 11, 12, 17, 20, 24, 43];

/// The outcome of `function` when the device's response suffers `fault`; nothing where there is no such fault.
fn outcome(out: Out, function: u8, fault: Option<Fault>) -> Option<Outcome> {
    Some(match (out, fault) {
        (_, None) => Outcome::Response,
        (_, Some(Fault::Exception(code))) => Outcome::Exception(code),
        // Modbus TCP has no check, and RTU no transaction id.
        (Out::Tcp, Some(Fault::BadCrc)) | (Out::Rtu, Some(Fault::WrongTransaction)) => return None,
        (Out::Tcp, Some(Fault::NoiseAfter(_))) => Outcome::Response,
        (Out::Rtu, Some(Fault::NoiseBefore(_))) => Outcome::Response,
        // Such a connection has answered before: a read goes again by the next one, if only the first one has none.
        (_, Some(Fault::Close | Fault::Reset)) if function > 1 && READS.contains(&function) => {
            Outcome::Response
        }
        // Where only a pause ends the response, the noise is a part of it.
        (Out::Rtu, Some(Fault::NoiseAfter(_))) if !is_ended_by_pause(function) => Outcome::Response,
        _ => Outcome::Exception(0x0b),
    })
}

/// The device answers these with data, and nothing tells how much of it; the other unknown ones with an exception.
fn is_ended_by_pause(function: u8) -> bool {
    (65..=72).contains(&function)
}

/// Whether a connection on which that is the response is given up.
fn ends_the_connection(fault: Option<Fault>) -> bool {
    let ends = matches!(fault, Some(Fault::Half | Fault::Close | Fault::Reset));
    // With MBAP the borders between frames are lost.
    ends || matches!(fault, Some(Fault::Truncated | Fault::NoiseBefore(_)))
}

const FAULTS: [Option<Fault>; 13] = [
    None,
    Some(Fault::Exception(4)),
    Some(Fault::Truncated),
    Some(Fault::Half),
    Some(Fault::BadCrc),
    Some(Fault::WrongUnit),
    Some(Fault::WrongTransaction),
    // Behind the response time, and within the time in which that is expected.
    Some(Fault::Late(Duration::from_millis(150), Duration::from_millis(350))),
    Some(Fault::NoiseBefore(3)),
    Some(Fault::NoiseAfter(3)),
    Some(Fault::Close),
    Some(Fault::Reset),
    Some(Fault::Dead),
];

#[test]
fn every_way_in_and_out_with_every_function_and_fault_has_its_outcome() {
    let mut cases = 0;
    for way_in in In::ALL {
        for out in [Out::Tcp, Out::Rtu] {
            for fault in FAULTS {
                cases += play(way_in, out, fault);
            }
        }
    }
    assert_eq!(cases, In::ALL.len() * 127 * (2 * FAULTS.len() - 2));
}

fn play(way_in: In, out: Out, fault: Option<Fault>) -> usize {
    let rtu = if out == Out::Rtu { "rtu" } else { "" };
    let line = if way_in == In::AsciiLine { "ascii server 115200 7E1" } else { "rtu server 115200 8E1" };
    let settings = format!(
        "port plc tcp client 10.0.1.1:502 {rtu} timeout 150ms late-window 400ms down-after 0
         port T tcp server 502
         port R tcp server 5000 rtu
         port U udp server 5020
         port L serial up {line}
         route T * * * plc
         route R * * * plc
         route U * * * plc
         route L * * * plc"
    );
    with_gateway(7, &settings, |world, rig| {
        let device = Device::new(UNIT).with_fresh(FRESH);
        rig.attach_at(world, "10.0.1.1:502", out == Out::Rtu, [device.clone()]);
        // What the device's memory holds: it carries out every request, whatever becomes of its response.
        let mut mirror = Memory::new(UNIT);
        let mut requester = Requester::new(way_in, rig);
        let mut cases = 0;
        // Who is switched on at a line hears a silence first.
        world.run_for(10 * MS);
        for function in 1..=127 {
            let Some(expected) = outcome(out, function, fault) else { continue };
            cases += 1;
            let tell = || format!("{way_in:?} to {out:?}, function {function}, {fault:?}");
            let (request, _) = exchange(function);
            let faults =
                fault.map_or(Faults::none(), |fault| Faults::new(3).with(When::Requests(1..=1), fault));
            device.set_faults(faults);
            let executed = mirror.execute(&request);
            let response = requester.ask(world, &request);
            let expected = match expected {
                Outcome::Response => executed.unwrap_or_else(|code| vec![function | 0x80, code]),
                Outcome::Exception(code) => vec![function | 0x80, code],
            };
            assert_eq!(response, Response::Pdu(expected), "{}", tell());
            let asked = Instant::now();
            let mut response = requester.ask(world, &READ_FRESH);
            if response.exception() == Some(0x0a) && ends_the_connection(fault) {
                // Its first response broke it, so it is not connected again at once.
                world.run_for(600 * MS);
                response = requester.ask(world, &READ_FRESH);
            }
            let Response::Pdu(response) = response else { panic!("behind {}", tell()) };
            let fresh = Fresh::from_response(&response)
                .unwrap_or_else(|| panic!("{response:02x?} behind {}", tell()));
            assert!(u64::from(fresh.at_us) >= asked.as_micros(), "stale behind {}", tell());
        }
        world.run_for(Duration::from_secs(5));
        assert_eq!(rig.frames_in_use(), 0, "{way_in:?} to {out:?}, {fault:?}");
        cases
    })
}

/// Who asks.
pub(crate) enum Requester {
    Stream(Client),
    Udp(UdpClient, u16),
    Line(Master),
}

impl Requester {
    fn new(way_in: In, rig: &Rig<'_>) -> Self {
        let connect = |port| rig.network.connect(machine(1), port).unwrap();
        match way_in {
            In::Tcp => Self::Stream(Client::new(connect(502))),
            In::Rtu => Self::Stream(Client::rtu(connect(5_000))),
            In::Udp => Self::Udp(rig.network.udp_client(machine(1), 5_020), 0),
            In::RtuLine | In::AsciiLine => Self::Line(rig.master("up")),
        }
    }

    pub(crate) fn ask(&mut self, world: &mut World<'_>, pdu: &[u8]) -> Response {
        match self {
            Self::Stream(client) => world.run_until(client.request(UNIT, pdu)),
            Self::Line(master) => world.run_until(master.request(UNIT, pdu)),
            Self::Udp(client, transaction) => {
                *transaction += 1;
                client.send(&frame(*transaction, UNIT, pdu));
                let response = world.run_until(client.receive(5_000 * MS)).expect("a response");
                assert_eq!(response, frame(*transaction, UNIT, &response[7..]));
                Response::Pdu(response[7..].to_vec())
            }
        }
    }
}
