//! Data points: the scanner by itself, with time as a value; its port and the settings in virtual time.

mod bits;
mod config;
mod console;
mod gathering;
mod image;
mod periodic;
mod polling;
mod program;
mod served;
mod status;

use std::iter::from_fn;

use mobgate::scanner::{ByteOrder, Device, Form, Request};

use crate::prelude::*;

const START: Instant = Instant::from_secs(1_000);

/// So many milliseconds after the start.
fn at(ms: u64) -> Instant {
    START + Duration::from_millis(ms)
}

/// A scanner that was started at `START`, with a device of unit 5.
fn scanner() -> (Scanner, DeviceId) {
    let mut scanner = Scanner::new();
    scanner.restart(START);
    let device = scanner.add_device(device(5)).unwrap();
    (scanner, device)
}

/// The same with a row, which has a variable of its own.
fn scanner_with(row: impl FnOnce(DeviceId) -> Row) -> (Scanner, DeviceId, RowId) {
    let (mut scanner, device) = scanner();
    let id = add(&mut scanner, row(device));
    (scanner, device, id)
}

/// The same when all that was due has been read.
fn polled_with(row: impl FnOnce(DeviceId) -> Row) -> (Scanner, DeviceId, RowId) {
    let (mut scanner, device, id) = scanner_with(row);
    while exchange(&mut scanner, at(0)).is_some() {}
    (scanner, device, id)
}

/// A started scanner with such a device, and another one that is checked before each poll.
fn checked_scanner() -> (Scanner, DeviceId) {
    let (mut scanner, _) = scanner();
    let checked = scanner.add_device(Device { check: true, ..device(7) }).unwrap();
    (scanner, checked)
}

fn device(unit: u8) -> Device {
    Device { unit, order: ByteOrder::Order0123, check: false, filling: None }
}

/// `count` cells of `device`, read every second and written automatically where that can be.
fn row(device: DeviceId, kind: Kind, first: u16, count: u16) -> Row {
    Row {
        device: Some(device),
        kind,
        first,
        count,
        input: 0,
        output: 0,
        read: Reading::Normal,
        write: if kind.is_writable() { Writing::Auto } else { Writing::Never },
        multiple: false,
        form: Form::Cells,
        of: None,
        quality: None,
    }
}

/// The same, read only when asked for.
fn manual(device: DeviceId, kind: Kind, first: u16, count: u16) -> Row {
    Row { read: Reading::Manual, ..row(device, kind, first, count) }
}

/// Adds `row` with a variable of its own.
fn add(scanner: &mut Scanner, row: Row) -> RowId {
    let values = scanner.allocate(row.kind.bytes(row.count)).unwrap();
    scanner.add_row(Row { input: values, output: values, ..row }, START).unwrap()
}

/// The response that a device gives whose registers hold their addresses, and whose bits are those of that.
fn response(request: &Request) -> Vec<u8> {
    let pdu = &request.pdu;
    let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
    match pdu[0] {
        1 | 2 => {
            let mut data = vec![0_u8; usize::from(word(3)).div_ceil(8)];
            for nth in 0..word(3) {
                data[usize::from(nth / 8)] |= u8::from(bit_of(word(1) + nth)) << (nth % 8);
            }
            [vec![pdu[0], data.len() as u8], data].concat()
        }
        3 | 4 => {
            let data: Vec<u8> = (0..word(3)).flat_map(|nth| (word(1) + nth).to_be_bytes()).collect();
            [vec![pdu[0], data.len() as u8], data].concat()
        }
        8 => pdu.to_vec(),
        _ => pdu[..5].to_vec(),
    }
}

fn bit_of(address: u16) -> bool {
    address.count_ones() % 2 == 1
}

/// The next request, which the device answers at once.
fn exchange(scanner: &mut Scanner, now: Instant) -> Option<Request> {
    let request = scanner.next(now)?;
    scanner.answered(request.device, now, Ok(&response(&request)));
    Some(request)
}

/// The requests that are made at `ms`, each answered at once.
fn requests(scanner: &mut Scanner, ms: u64) -> Vec<Vec<u8>> {
    from_fn(|| exchange(scanner, at(ms))).map(|request| request.pdu.to_vec()).collect()
}

/// The next request, which gets this response.
fn answered(scanner: &mut Scanner, now: Instant, response: &[u8]) -> Vec<u8> {
    let request = scanner.next(now).unwrap();
    scanner.answered(request.device, now, Ok(response));
    request.pdu.to_vec()
}

/// The next request, which gets no response.
fn lose(scanner: &mut Scanner, now: Instant) -> Option<Request> {
    let request = scanner.next(now)?;
    scanner.answered(request.device, now, Err(ErrorCode::Timeout));
    Some(request)
}

/// A frame and its two repeats get no response.
fn lose_all(scanner: &mut Scanner, now: Instant) {
    (0..3).for_each(|_| assert!(lose(scanner, now).is_some()));
}
