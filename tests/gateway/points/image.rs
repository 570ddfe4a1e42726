//! A process image over the same scanner: four devices with all four tables each, and ranges that take several frames.

use mobgate::scanner::{DeviceId, Full, Kind, Reading, Request, Row, Scanner, Writing};

use super::{START, at, device, exchange, row, scanner};

/// A device of the vectors as it is configured, and where its values are in the image.
struct Virtual {
    unit: u8,
    /// Count and first address of coils, discrete inputs, input and holding registers.
    ranges: [(u16, u16); 4],
    inputs: [u16; 4],
    /// Of coils and holding registers.
    outputs: [u16; 2],
    read: (Vec<u8>, Vec<u16>),
    write: (Vec<u8>, Vec<u16>),
    image: Vec<u8>,
    /// What the device holds.
    coils: Vec<u8>,
    holding: Vec<u16>,
}

fn virtual_devices() -> Vec<Virtual> {
    let vectors: toml::Table = include_str!("vectors/virtual_slaves.toml").parse().unwrap();
    let devices = vectors["device"].as_array().unwrap();
    devices.iter().map(Virtual::new).collect()
}

fn numbers<T: TryFrom<i64, Error: std::fmt::Debug>>(value: &toml::Value) -> Vec<T> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| T::try_from(number.as_integer().unwrap()).unwrap())
        .collect()
}

impl Virtual {
    fn new(vector: &toml::Value) -> Self {
        let range = |name: &str| {
            let numbers = numbers(&vector[name]);
            (numbers[0], numbers[1])
        };
        let place = |side: &str, name: &str| vector[side][name].as_integer().unwrap() as u16;
        let ranges = ["coils", "switches", "in_registers", "out_registers"].map(range);
        Self {
            unit: vector["id"].as_integer().unwrap() as u8,
            inputs: ["coils", "switches", "in_registers", "out_registers"].map(|name| place("input", name)),
            outputs: ["coils", "out_registers"].map(|name| place("output", name)),
            read: (numbers(&vector["read"]["switches_bytes"]), numbers(&vector["read"]["in_registers"])),
            write: (numbers(&vector["write"]["coils_bytes"]), numbers(&vector["write"]["out_registers"])),
            image: numbers(&vector["input_image"]),
            coils: vec![0; Kind::Coil.bytes(ranges[0].0).into()],
            holding: vec![0; ranges[3].0.into()],
            ranges,
        }
    }

    fn configure(&self, scanner: &mut Scanner, output: u16) {
        let id = scanner.add_device(device(self.unit)).unwrap();
        for (nth, kind) in Kind::ALL.into_iter().enumerate() {
            let (count, first) = self.ranges[nth];
            let out = self.outputs[nth / 2] + output;
            let write = if kind.is_writable() { Writing::OnChange } else { Writing::Never };
            let range = Row { input: self.inputs[nth], output: out, write, ..row(id, kind, first, count) };
            scanner.add_range(range, START).unwrap();
        }
    }

    /// What the device answers.
    fn answer(&mut self, pdu: &[u8]) -> Vec<u8> {
        let registers = |values: &[u16]| values.iter().flat_map(|value| value.to_be_bytes()).collect();
        let data: Vec<u8> = match pdu[0] {
            1 => self.coils.clone(),
            2 => self.read.0.clone(),
            4 => registers(&self.read.1),
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

fn round(scanner: &mut Scanner, devices: &mut [Virtual], ms: u64) -> Vec<Request> {
    let mut requests = Vec::new();
    while let Some(request) = scanner.next(at(ms)) {
        let device = &mut devices[usize::from(request.device.0)];
        let answer = device.answer(&request.pdu);
        scanner.answered(request.device, at(ms), Ok(&answer));
        requests.push(request);
    }
    requests
}

#[test]
fn the_four_virtual_devices_have_the_images_of_the_vectors_after_two_rounds() {
    let mut devices = virtual_devices();
    let mut scanner = Scanner::new();
    scanner.restart(START);
    let (input, output) = (scanner.allocate(120).unwrap(), scanner.allocate(120).unwrap());
    for device in &devices {
        device.configure(&mut scanner, output);
        let (coils, holding) = (device.outputs[0] + output, device.outputs[1] + output);
        let registers: Vec<u8> = device.write.1.iter().flat_map(|value| value.to_be_bytes()).collect();
        scanner.image_mut(coils, device.write.0.len() as u16).copy_from_slice(&device.write.0);
        // Bits behind the last coil are the master's rubbish.
        if device.ranges[0].0 % 8 != 0 {
            let last = scanner.image_mut(coils + device.write.0.len() as u16 - 1, 1);
            last[0] |= 0x80;
        }
        scanner.image_mut(holding, registers.len() as u16).copy_from_slice(&registers);
    }
    scanner.set_outputs(true);
    let first = round(&mut scanner, &mut devices, 0);
    assert_eq!(first.len(), 4 * 6, "four reads and two writes of each");
    let second = round(&mut scanner, &mut devices, 1_000);
    for (nth, device) in devices.iter().enumerate() {
        let own = second.iter().filter(|request| request.device == DeviceId(nth as u8));
        let functions: Vec<u8> = own.map(|request| request.pdu[0]).collect();
        assert_eq!(functions, [1, 2, 4, 3], "unit {}: nothing is written that is there already", device.unit);
    }
    let whole: Vec<u8> = devices.iter().flat_map(|device| device.image.clone()).collect();
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
        let requests: Vec<_> = std::iter::from_fn(|| exchange(&mut scanner, at(0))).collect();
        assert_eq!(requests.len(), frames);
        let cells = requests.iter().map(|request| u16::from_be_bytes([request.pdu[3], request.pdu[4]]));
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
    for _ in 0..mobgate::scanner::ROWS_MAX - 1 {
        scanner
            .add_row(Row { input: place, output: place, ..row(device, Kind::Input, 0, 1) }, START)
            .unwrap();
    }
    let range = row(DeviceId(0), Kind::Input, 0, 126);
    assert_eq!(scanner.add_range(range, START), Err(Full::Rows));
    assert_eq!(scanner.rows(), mobgate::scanner::ROWS_MAX - 1);
}
