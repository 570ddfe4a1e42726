//! The four virtual devices of the vectors: what is configured, where their values lie, and what they hold.

use mobgate_simulator::Device;

/// Long enough for the addresses of the vectors.
const TABLE_LENGTH: usize = 45_000;

/// One of them.
pub(crate) struct Virtual {
    pub(crate) unit: u16,
    /// Count and first address of coils, discrete inputs, input and holding registers.
    pub(crate) ranges: [(u16, u16); 4],
    /// The entries of its layout object.
    pub(crate) layout: [u16; 10],
    /// What it holds: discrete inputs and input registers.
    pub(crate) read: (Vec<u8>, Vec<u16>),
    /// Its part of the input buffer once it has what is written.
    pub(crate) input_image: Vec<u8>,
    /// Its part of the output buffer.
    pub(crate) output_image: Vec<u8>,
}

/// All four.
pub(crate) fn virtual_devices() -> Vec<Virtual> {
    let vectors: toml::Table =
        include_str!("../../gateway/points/vectors/virtual_slaves.toml").parse().unwrap();
    vectors["device"].as_array().unwrap().iter().map(Virtual::new).collect()
}

fn numbers<T: TryFrom<i64, Error: std::fmt::Debug>>(value: &toml::Value) -> Vec<T> {
    let numbers = value.as_array().unwrap().iter();
    numbers.map(|number| T::try_from(number.as_integer().unwrap()).unwrap()).collect()
}

impl Virtual {
    fn new(vector: &toml::Value) -> Self {
        let range = |name: &str| {
            let numbers = numbers(&vector[name]);
            (numbers[0], numbers[1])
        };
        let entry = |(side, name): (&str, &str)| vector[side][name].as_integer().unwrap() as u16;
        let coils: Vec<u8> = numbers(&vector["write"]["coils_bytes"]);
        let registers: Vec<u16> = numbers(&vector["write"]["out_registers"]);
        Self {
            unit: vector["id"].as_integer().unwrap() as u16,
            ranges: ["coils", "switches", "in_registers", "out_registers"].map(range),
            layout: [
                ("input", "start"),
                ("input", "coils"),
                ("input", "switches"),
                ("input", "in_registers"),
                ("input", "out_registers"),
                ("input", "end"),
                ("output", "start"),
                ("output", "coils"),
                ("output", "out_registers"),
                ("output", "end"),
            ]
            .map(entry),
            read: (numbers(&vector["read"]["switches_bytes"]), numbers(&vector["read"]["in_registers"])),
            input_image: numbers(&vector["input_image"]),
            output_image: coils.into_iter().chain(registers.into_iter().flat_map(u16::to_be_bytes)).collect(),
        }
    }

    /// The values of 2001h and following, in the order of its entries.
    pub(crate) fn settings(&self) -> Vec<u16> {
        let ranges = self.ranges.iter().flat_map(|&(count, first)| [count, first]);
        std::iter::once(self.unit).chain(ranges).collect()
    }

    /// The device, which holds what is to be read; coils and holding registers are 0.
    pub(crate) fn device(&self) -> Device {
        let device = Device::new(self.unit as u8);
        let mut memory = device.memory();
        memory.coils = vec![false; TABLE_LENGTH];
        memory.holding = vec![0; TABLE_LENGTH];
        memory.discrete_inputs = vec![false; TABLE_LENGTH];
        memory.input = vec![0; TABLE_LENGTH];
        let [_, switches, in_registers, _] = self.ranges;
        for nth in 0..usize::from(switches.0) {
            memory.discrete_inputs[usize::from(switches.1) + nth] =
                self.read.0[nth / 8] >> (nth % 8) & 1 == 1;
        }
        let first = usize::from(in_registers.1);
        memory.input[first..first + self.read.1.len()].copy_from_slice(&self.read.1);
        drop(memory);
        device
    }
}
