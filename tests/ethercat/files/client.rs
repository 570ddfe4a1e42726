//! FoE's messages as a MainDevice sends them, step by step.

use std::cmp::Ordering;

use crate::prelude::*;

/// Operations of FoE.
pub(crate) const READ: u8 = 1;
pub(crate) const WRITE: u8 = 2;
pub(crate) const DATA: u8 = 3;
pub(crate) const ACK: u8 = 4;
pub(crate) const ERR: u8 = 5;
pub(crate) const BUSY: u8 = 6;

pub(crate) const FOE: u8 = 4;
pub(crate) const COE: u8 = 3;

/// Bytes of a file in a message of [`FILES_128`].
pub(crate) const PACKET: usize = 128 - 6 - 6;

pub(crate) fn rig(state: u16) -> Rig<Bench> {
    Rig::in_state(&FILES_128, state)
}

/// A message of the SubDevice: its operation, its number, and the rest.
pub(crate) type Response = (u8, u32, Vec<u8>);

pub(crate) fn received<A: Application + 'static>(rig: &mut Rig<A>) -> Option<Response> {
    let message = rig.receive()?;
    assert_eq!(message[5] & 0x0f, FOE, "{message:02x?}");
    assert_eq!(message[7], 0, "reserved");
    Some((message[6], u32::from_le_bytes(message[8..12].try_into().unwrap()), message[12..].to_vec()))
}

pub(crate) fn send<A: Application + 'static>(rig: &mut Rig<A>, operation: u8, number: u32, rest: &[u8]) {
    send_counted(rig, 0, operation, number, rest);
}

pub(crate) fn send_counted<A: Application + 'static>(
    rig: &mut Rig<A>,
    counter: u8,
    operation: u8,
    number: u32,
    rest: &[u8],
) {
    let payload = [&[operation, 0], &number.to_le_bytes()[..], rest].concat();
    assert_eq!(rig.send_counted(FOE, counter, &payload), 1, "the mailbox takes it");
}

pub(crate) fn ask<A: Application + 'static>(
    rig: &mut Rig<A>,
    operation: u8,
    number: u32,
    rest: &[u8],
) -> Option<Response> {
    send(rig, operation, number, rest);
    // The application is looked at each millisecond.
    rig.pass(3);
    received(rig)
}

pub(crate) fn ack(number: u32) -> Option<Response> {
    Some((ACK, number, Vec::new()))
}

/// The code of an error; there is a text with it.
pub(crate) fn code(response: Option<Response>) -> u32 {
    let (operation, code, text) = response.expect("an error is answered");
    assert_eq!(operation, ERR, "{code:x} {text:02x?}");
    assert!(!text.is_empty() && text.is_ascii(), "{text:02x?}");
    code
}

/// Writes a file; the last response if it is another one than an acknowledgement.
pub(crate) fn write<A: Application + 'static>(
    rig: &mut Rig<A>,
    name: &str,
    password: u32,
    bytes: &[u8],
    packet: usize,
) -> Option<Response> {
    let opened = ask(rig, WRITE, password, name.as_bytes());
    if opened != ack(0) {
        return opened;
    }
    let mut packets: Vec<_> = bytes.chunks(packet).collect();
    if bytes.len().is_multiple_of(packet) {
        packets.push(&[]);
    }
    for (number, packet) in (1..).zip(packets) {
        let response = ask(rig, DATA, number, packet);
        if response != ack(number) {
            return response;
        }
    }
    None
}

pub(crate) fn read<A: Application + 'static>(rig: &mut Rig<A>, name: &str, packet: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut response = ask(rig, READ, 0, name.as_bytes());
    for number in 1.. {
        let (operation, found, data) = response.expect("data");
        assert_eq!((operation, found), (DATA, number));
        bytes.extend(&data);
        response = ask(rig, ACK, number, &[]);
        match data.len().cmp(&packet) {
            Ordering::Less => break,
            Ordering::Equal => {}
            Ordering::Greater => panic!("{} bytes in a packet", data.len()),
        }
    }
    assert_eq!(response, None, "nothing follows the last acknowledgement");
    bytes
}

pub(crate) fn content(length: usize) -> Vec<u8> {
    (0..length).map(|at| (at * 7 + at / 251) as u8).collect()
}
