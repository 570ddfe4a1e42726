//! A process image over the same scanner: four devices with all four tables each, and ranges that take several frames.

// With more than is needed here.
#[allow(dead_code)]
#[path = "../../ethercat/gateway/virtual_devices.rs"]
mod virtual_devices;

use mobgate::scanner::{Full, Request};

use virtual_devices::{Virtual, virtual_devices};

use super::{START, at, device, requests, row, scanner};
use crate::prelude::*;

/// A device of the vectors, and what it holds.
struct Station {
    of: Virtual,
    coils: Vec<u8>,
    holding: Vec<u16>,
}

impl Station {
    fn new(of: Virtual) -> Self {
        let [(coils, _), .., (holding, _)] = of.ranges;
        Self { coils: vec![0; Kind::Coil.bytes(coils).into()], holding: vec![0; holding.into()], of }
    }

    /// Where its coils and holding registers are in the image of outputs.
    fn outputs(&self) -> [u16; 2] {
        [self.of.layout[7], self.of.layout[8]]
    }

    fn configure(&self, scanner: &mut Scanner, output: u16) {
        let id = scanner.add_device(device(self.of.unit as u8)).unwrap();
        for (nth, kind) in Kind::ALL.into_iter().enumerate() {
            let (count, first) = self.of.ranges[nth];
            let (input, output) = (self.of.layout[1 + nth], self.outputs()[nth / 2] + output);
            let write = if kind.is_writable() { Writing::OnChange } else { Writing::Never };
            let range = Row { input, output, write, ..row(id, kind, first, count) };
            scanner.add_range(range, START).unwrap();
        }
    }

    /// What the device answers.
    fn response(&mut self, pdu: &[u8]) -> Vec<u8> {
        let registers = |values: &[u16]| values.iter().flat_map(|value| value.to_be_bytes()).collect();
        let data: Vec<u8> = match pdu[0] {
            1 => self.coils.clone(),
            2 => self.of.read.0.clone(),
            4 => registers(&self.of.read.1),
            3 => registers(&self.holding),
            15 => {
                self.coils = pdu[6..].to_vec();
                return pdu[..5].to_vec();
            }
            16 => {
                self.holding = pdu[6..].as_chunks().0.iter().map(|word| u16::from_be_bytes(*word)).collect();
                return pdu[..5].to_vec();
            }
            function => panic!("function {function}"),
        };
        [vec![pdu[0], data.len() as u8], data].concat()
    }
}

fn round(scanner: &mut Scanner, devices: &mut [Station], ms: u64) -> Vec<Request> {
    let mut requests = Vec::new();
    while let Some(request) = scanner.next(at(ms)) {
        let device = &mut devices[usize::from(request.device.0)];
        let response = device.response(&request.pdu);
        scanner.answered(request.device, at(ms), Ok(&response));
        requests.push(request);
    }
    requests
}

#[test]
fn the_four_virtual_devices_have_the_images_of_the_vectors_after_two_rounds() {
    let mut devices: Vec<Station> = virtual_devices().into_iter().map(Station::new).collect();
    let mut scanner = Scanner::new();
    scanner.restart(START);
    let (input, output) = (scanner.allocate(120).unwrap(), scanner.allocate(120).unwrap());
    for device in &devices {
        device.configure(&mut scanner, output);
        let (coils, registers) = device.of.output_image.split_at(device.coils.len());
        for (place, bytes) in device.outputs().into_iter().zip([coils, registers]) {
            scanner.image_mut(place + output, bytes.len() as u16).copy_from_slice(bytes);
        }
        // Bits behind the last coil are the master's rubbish.
        if device.of.ranges[0].0 % 8 != 0 {
            scanner.image_mut(device.outputs()[0] + output, coils.len() as u16)[coils.len() - 1] |= 0x80;
        }
    }
    scanner.set_outputs(true);
    assert_eq!(round(&mut scanner, &mut devices, 0).len(), 4 * 6, "four reads and two writes of each");
    let second = round(&mut scanner, &mut devices, 1_000);
    for (nth, device) in devices.iter().enumerate() {
        let own = second.iter().filter(|request| request.device == DeviceId(nth as u8));
        let functions: Vec<u8> = own.map(|request| request.pdu[0]).collect();
        assert_eq!(
            functions,
            [1, 2, 4, 3],
            "unit {}: nothing is written that is there already",
            device.of.unit
        );
    }
    let whole: Vec<u8> = devices.iter().flat_map(|device| device.of.input_image.clone()).collect();
    assert_eq!(scanner.image(input, whole.len() as u16), whole);
}

#[test]
fn a_range_that_no_frame_holds_is_split_and_read_and_written_whole() {
    for (kind, count, frames) in
        [(Kind::Holding, 256, 3), (Kind::Input, 256, 3), (Kind::Coil, 4_000, 3), (Kind::Discrete, 4_000, 2)]
    {
        let (mut scanner, device) = scanner();
        let bytes = kind.bytes(count);
        let (input, output) = (scanner.allocate(bytes).unwrap(), scanner.allocate(bytes).unwrap());
        let write = if kind.is_writable() { Writing::OnChange } else { Writing::Never };
        let range = Row { input, output, write, read: Reading::Every(50), ..row(device, kind, 100, count) };
        scanner.add_range(range, START).unwrap();
        let requests = requests(&mut scanner, 0);
        assert_eq!(requests.len(), frames);
        let cells = requests.iter().map(|pdu| u16::from_be_bytes([pdu[3], pdu[4]]));
        assert_eq!(cells.sum::<u16>(), count, "and nothing behind it");
        let image = scanner.image(input, bytes).to_vec();
        for nth in 0..count {
            let address = 100 + nth;
            let at = usize::from(nth);
            if kind.is_bits() {
                assert_eq!(image[at / 8] >> (at % 8) & 1 == 1, super::bit_of(address));
            } else {
                assert_eq!(image[2 * at..2 * at + 2], address.to_be_bytes());
            }
        }
    }
}

#[test]
fn a_range_without_room_adds_nothing() {
    let (mut scanner, device) = scanner();
    let place = scanner.allocate(2).unwrap();
    let cell = Row { input: place, output: place, ..row(device, Kind::Input, 0, 1) };
    for _ in 0..mobgate::scanner::ROWS_MAX - 1 {
        scanner.add_row(cell, START).unwrap();
    }
    let range = row(DeviceId(0), Kind::Input, 0, 126);
    assert_eq!(scanner.add_range(range, START), Err(Full::Rows));
    assert_eq!(scanner.rows(), mobgate::scanner::ROWS_MAX - 1);
}
