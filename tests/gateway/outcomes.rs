//! Every pair of framings, every function code, every way in which a response can come: each has its defined outcome.

use mobgate_simulator::client::Reply;
use strum::{EnumIter, IntoEnumIterator};

use crate::matrix::Requester;
use crate::prelude::*;

const UNIT: u8 = 5;
const NO_RESPONSE: u8 = 0x0b;
/// What the device says that refuses.
const DEVICE_FAILURE: u8 = 0x04;
/// Response time-out, and so the late-reply window.
const TIMEOUT: Duration = Duration::from_millis(50);

/// How a response comes.
#[derive(Debug, Clone, Copy, PartialEq, EnumIter)]
enum Coming {
    Normal,
    Exception,
    Truncated,
    BadCheck,
    WrongUnit,
    Late,
    NoiseBefore,
    NoiseAfter,
}

impl Coming {
    fn faults(self, seed: u64) -> Faults {
        let late = TIMEOUT + Duration::from_millis(10);
        let fault = match self {
            Self::Normal => return Faults::none(),
            Self::Exception => Fault::Exception(DEVICE_FAILURE),
            Self::Truncated => Fault::Truncated,
            Self::BadCheck => Fault::BadCrc,
            Self::WrongUnit => Fault::WrongUnit,
            Self::Late => Fault::Late(late, late),
            Self::NoiseBefore => Fault::NoiseBefore(3),
            Self::NoiseAfter => Fault::NoiseAfter(3),
        };
        Faults::new(seed).with(When::Requests(1..=1), fault)
    }

    /// What the requester gets; the device's own response is `response`.
    fn outcome(self, framing: Framing, response: &[u8], cut: bool) -> Response {
        let function = response[0];
        // The end of such an RTU response is told by silence only, so what stands behind it belongs to it. The others have
        // lengths that the request tells (Application Protocol 6).
        let ended_by_silence = !matches!(function, 1..=8 | 11 | 12 | 15..=17 | 20..=24);
        if cut && !ended_by_silence && matches!(self, Self::Truncated | Self::BadCheck) {
            // It was passed on while it came, and nothing can follow it: the requester sees the corruption.
            return Response::Wrong(Reply { transaction: 0, protocol: 0, unit: 0, pdu: Vec::new() });
        }
        Response::Pdu(match self {
            Self::Normal | Self::NoiseBefore => response.to_vec(),
            Self::NoiseAfter if framing == Framing::Ascii || !ended_by_silence => response.to_vec(),
            Self::Exception => vec![function | 0x80, DEVICE_FAILURE],
            _ => vec![function | 0x80, NO_RESPONSE],
        })
    }
}

/// A request of each function, and its response.
pub(crate) fn exchange(function: u8) -> (Vec<u8>, Vec<u8>) {
    let echo = |request: &[u8]| (request.to_vec(), request.to_vec());
    match function {
        1 | 2 => (vec![function, 0, 0, 0, 10], vec![function, 2, 0x55, 1]),
        3 | 4 => (vec![function, 0, 0, 0, 2], vec![function, 4, 1, 2, 3, 4]),
        5 => echo(&[5, 0, 1, 0xff, 0]),
        6 => echo(&[6, 0, 1, 0xab, 0xcd]),
        7 => (vec![7], vec![7, 0x6d]),
        8 => echo(&[8, 0, 0, 0xa5, 0x37]),
        11 => (vec![11], vec![11, 0xff, 0xff, 1, 8]),
        12 => (vec![12], vec![12, 8, 0, 0, 1, 8, 1, 0x21, 0x20, 0]),
        15 => (vec![15, 0, 0, 0, 10, 2, 0xcd, 1], vec![15, 0, 0, 0, 10]),
        16 => (vec![16, 0, 0, 0, 1, 2, 9, 9], vec![16, 0, 0, 0, 1]),
        17 => (vec![17], vec![17, 2, 5, 0xff]),
        20 => (vec![20, 7, 6, 0, 4, 0, 1, 0, 2], vec![20, 6, 5, 6, 0x0d, 0xfe, 0, 0x20]),
        21 => echo(&[21, 9, 6, 0, 4, 0, 7, 0, 1, 6, 0xaf]),
        22 => echo(&[22, 0, 4, 0, 0xf2, 0, 0x25]),
        23 => (vec![23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 1, 2], vec![23, 2, 1, 2]),
        24 => (vec![24, 4, 0xde], vec![24, 0, 6, 0, 2, 1, 0xb8, 0x12, 0x84]),
        43 => (vec![43, 14, 1, 0], vec![43, 14, 1, 1, 0, 0, 1, 0, 1, 65]),
        _ => (vec![function, 1, 2, 3], vec![function, 4, 5]),
    }
}

/// All functions and all ways of one pair of framings; `cut`: frames are passed on while they arrive.
fn all_outcomes(server: &str, client: &str, cut: bool) {
    let word = if cut { "on" } else { "off" };
    let timeout = TIMEOUT.as_millis();
    let settings = format!(
        "port S {server}\nport C serial down {client} timeout {timeout}ms down-after 0\n\
         route S * * * C cut {word}\n"
    );
    rig::with_gateway(1, &settings, |world, rig| {
        let device = Device::new(UNIT);
        rig.attach(world, "down", [device.clone()]);
        let mut requester = match server.starts_with("tcp") {
            true => Requester::Stream(rig.client(machine(1), 502)),
            false => Requester::Line(rig.master("up")),
        };
        let framing = rig.framing("down");
        // Who is switched on hears a silence first.
        world.run_for(Duration::from_millis(10));
        for (function, coming) in
            (1..=127).flat_map(|function| Coming::iter().map(move |coming| (function, coming)))
        {
            let (request, response) = exchange(function);
            device.set_response(&response);
            device.set_faults(coming.faults(u64::from(function)));
            let case = format!("{server} to {client}, function {function}, {coming:?}");
            let outcome = requester.ask(world, &request);
            assert_eq!(outcome, coming.outcome(framing, &response, cut), "{case}");
            // Whatever came, what comes next is the response to what is asked next.
            let (request, response) = exchange(if function == 6 { 3 } else { 6 });
            device.set_response(&response);
            world.run_for(MS);
            assert_eq!(requester.ask(world, &request), Response::Pdu(response), "after {case}");
        }
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.frames_in_use(), 0);
    });
}

const RTU_SERVER: &str = "serial up rtu server 115200 8E1";
const ASCII_SERVER: &str = "serial up ascii server 115200 7E1";
const TCP_SERVER: &str = "tcp server 502";
const RTU_CLIENT: &str = "rtu client 115200 8E1";
const ASCII_CLIENT: &str = "ascii client 115200 7E1";

#[test]
fn all_outcomes_from_rtu_to_rtu() {
    all_outcomes(RTU_SERVER, RTU_CLIENT, false);
}

#[test]
fn all_outcomes_from_rtu_to_rtu_while_frames_arrive() {
    all_outcomes(RTU_SERVER, RTU_CLIENT, true);
}

#[test]
fn all_outcomes_from_rtu_to_ascii() {
    all_outcomes(RTU_SERVER, ASCII_CLIENT, false);
}

#[test]
fn all_outcomes_from_ascii_to_rtu() {
    all_outcomes(ASCII_SERVER, RTU_CLIENT, false);
}

#[test]
fn all_outcomes_from_ascii_to_ascii() {
    all_outcomes(ASCII_SERVER, ASCII_CLIENT, false);
}

#[test]
fn all_outcomes_from_tcp_to_rtu() {
    all_outcomes(TCP_SERVER, RTU_CLIENT, false);
}

#[test]
fn all_outcomes_from_tcp_to_ascii() {
    all_outcomes(TCP_SERVER, ASCII_CLIENT, false);
}
