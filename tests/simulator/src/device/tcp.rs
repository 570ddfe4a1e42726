//! Devices behind TCP, by Modbus TCP or RTU over TCP, written from the specification and not from the gateway's codecs.
//!
//! Each connection is served by itself. Requests are executed as they come and answered after the device's turnaround time:
//! in Modbus TCP each by itself, so that the responses of slow requests come behind those of quick ones; in RTU over TCP a device
//! responses in order. A device whose unit id is not asked for says nothing.

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};

use super::{Device, Outbox, rtu};
use crate::client::{frame, take_frame};
use crate::fault::Sent;
use crate::net::{ClientStream, Server};
use crate::world::Spawner;

/// How frames look in the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Modbus TCP.
    Mbap,
    /// RTU over TCP.
    Rtu,
}

/// Accepts connections to `devices`, for ever.
pub async fn serve(server: Server, framing: Stream, devices: Vec<Device>, spawner: Spawner<'_>) {
    loop {
        let stream = server.accept().await;
        spawner.spawn(converse(stream, framing, devices.clone()));
    }
}

/// Serves one connection to its end.
pub async fn converse(mut stream: ClientStream, framing: Stream, devices: Vec<Device>) {
    let mut outbox = Outbox::new();
    let mut received = Vec::new();
    loop {
        let mut buffer = [0; 260];
        match select(stream.read(&mut buffer), outbox.due()).await {
            Either::First(Ok(0) | Err(_)) => return,
            Either::First(Ok(count)) => {
                received.extend_from_slice(&buffer[..count]);
                hear(framing, &mut received, &devices, &mut outbox);
            }
            // Streams have neither parity nor stop bits.
            Either::Second(Sent::Bytes(bytes) | Sent::Flawed(bytes, _)) => {
                if stream.write_all(&bytes).await.is_err() {
                    return;
                }
            }
            Either::Second(Sent::Close) => return,
            Either::Second(Sent::Reset) => return stream.reset(),
        }
    }
}

/// Takes the requests that are whole.
fn hear(framing: Stream, received: &mut Vec<u8>, devices: &[Device], outbox: &mut Outbox) {
    let asked = |unit| devices.iter().find(move |device| device.unit() == unit);
    match framing {
        Stream::Mbap => {
            while let Some(request) = take_frame(received) {
                assert_eq!(request.protocol, 0, "the gateway speaks Modbus");
                let response = |unit, pdu: &[u8], wrong| {
                    frame(request.transaction ^ if wrong { 0x5a5a } else { 0 }, unit, pdu)
                };
                if let Some(device) = asked(request.unit) {
                    device.asked(&request.pdu, false, response, outbox);
                }
            }
        }
        // One request at a time: what has come is one, as soon as it is long enough and its CRC is right.
        Stream::Rtu => {
            if let Some((unit, pdu)) = rtu::open(received).filter(|(_, pdu)| pdu.len() >= shortest(pdu)) {
                if let Some(device) = asked(unit) {
                    device.asked(pdu, true, |unit, pdu, _| rtu::frame(unit, pdu), outbox);
                }
                received.clear();
            }
        }
    }
}

/// Bytes that a request with this beginning has at least: the beginning of one may have a right CRC by chance.
fn shortest(pdu: &[u8]) -> usize {
    match *pdu {
        [1..=6, ..] => 5,
        [15 | 16, _, _, _, _, count, ..] => 6 + usize::from(count),
        [15 | 16, ..] => usize::MAX,
        [22, ..] => 7,
        [23, ..] => 10,
        _ => 1,
    }
}
