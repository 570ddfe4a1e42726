//! Eight digital outputs and eight inputs, and in place of a controller chip one in software: its MainDevice counts.
use embassy_futures::{block_on, select::select};
use embedded_hal_async::digital::Wait;
use ethercat_esc::{Chip, DirectPdi, Interrupt, MainDevice};
use ethercat_subdevice::prelude::*;
const IDENTITY: Identity = Identity { vendor: 0xe000_0000, product: 1, revision: 1, serial: 0 };
static DEVICE: Device = Device {
    identity: IDENTITY,
    vendor_name: "Example",
    name: "Digital I/O",
    order: "DIO-8-8",
    group: "I/O",
    memory: MemoryPlan::new(128, 1, 1, 4096),
    controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
    emergencies: false,
    files: FileAccess::None,
    ethernet: false,
    texts: &[],
    objects: &[
        standard::device_type(401),
        standard::identity(&standard::identity_entries(IDENTITY)),
        Object::mapping(0x1600, "Outputs", &[Mapped { index: 0x7000, sub: 0, count: 1, bits: 8 }]),
        Object::mapping(0x1a00, "Inputs", &[Mapped { index: 0x6000, sub: 0, count: 1, bits: 8 }]),
        standard::SYNC_MANAGER_TYPES,
        standard::rx_assignment(&[0x1600], standard::FIXED),
        standard::tx_assignment(&[0x1a00], standard::FIXED),
        Object::variable(0x6000, Entry::input("Inputs", DataType::U8)),
        Object::variable(0x7000, Entry::output("Outputs", DataType::U8)),
    ],
};
struct Pins(u8); // The outputs. Each leads through an inverter to the input of its number.
impl Application for Pins {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        into.fill(if at.index == 0x6000 { !self.0 } else { self.0 });
        Ok(into.len())
    }
    fn write(&mut self, _at: Address, _value: &[u8]) {}
    fn outputs(&mut self, _pdo: u16, bytes: &[u8]) {
        self.0 = bytes[0];
    }
    fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
        into.fill(!self.0);
    }
    fn outputs_stopped(&mut self) {
        self.0 = 0;
    }
}

fn main() {
    let chip = Chip::of(&DEVICE);
    let mut interrupt = Interrupt::new(chip.clone());
    let mut main_device = MainDevice::new(chip.clone(), &DEVICE);
    let mut sub_device = SubDevice::new(&DEVICE, DirectPdi::new(chip), Pins(0));
    let counting = async {
        main_device.bring_to(AlState::Op).await.expect("Op");
        for outputs in 1..=5 {
            println!("out {outputs:08b}, in {:08b}", main_device.exchange(&[outputs]).await.expect("Op")[0]);
        }
    };
    block_on(select(sub_device.run(async || interrupt.wait_for_high().await.unwrap()), counting));
}
