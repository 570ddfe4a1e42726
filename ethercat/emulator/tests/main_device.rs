//! The small MainDevice against the stack: to each state and back, and what it says when a SubDevice does not come along.

use embassy_futures::block_on;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embedded_hal_async::digital::Wait;
use ethercat_esc::main_device::Refusal;
use ethercat_esc::{Chip, DirectPdi, Interrupt, MainDevice, SharedChip};
use ethercat_subdevice::prelude::*;

const IDENTITY: Identity = Identity { vendor: 1, product: 2, revision: 3, serial: 4 };
static DEVICE: Device = Device {
    identity: IDENTITY,
    vendor_name: "Test",
    name: "Test",
    order: "TEST",
    group: "Tests",
    memory: MemoryPlan::new(128, 2, 1, 4096),
    controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
    emergencies: false,
    files: FileAccess::None,
    ethernet: false,
    texts: &[],
    objects: &[
        standard::device_type(0),
        standard::identity(&standard::identity_entries(IDENTITY)),
        Object::mapping(0x1600, "Outputs", &[Mapped { index: 0x7000, sub: 0, count: 1, bits: 16 }]),
        Object::mapping(0x1a00, "Inputs", &[Mapped { index: 0x6000, sub: 0, count: 1, bits: 8 }]),
        standard::SYNC_MANAGER_TYPES,
        standard::rx_assignment(&[0x1600], standard::FIXED),
        standard::tx_assignment(&[0x1a00], standard::FIXED),
        Object::variable(0x6000, Entry::input("Inputs", DataType::U8)),
        Object::variable(0x7000, Entry::output("Outputs", DataType::U16)),
    ],
};

/// Its input is the sum of its outputs. Some cannot go to SafeOp.
struct Sum {
    outputs: [u8; 2],
    ready: bool,
}

impl Application for Sum {
    fn read(&mut self, _at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        Ok(into.len())
    }

    fn write(&mut self, _at: Address, _value: &[u8]) {}

    fn outputs(&mut self, _pdo: u16, bytes: &[u8]) {
        self.outputs.copy_from_slice(bytes);
    }

    fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
        into[0] = self.outputs[0].wrapping_add(self.outputs[1]);
    }

    fn outputs_stopped(&mut self) {
        self.outputs = [0; 2];
    }

    fn may_enter(&mut self, state: AlState) -> Result<(), AlStatusCode> {
        match state {
            AlState::SafeOp if !self.ready => Err(AlStatusCode::HardwareNotReady),
            _ => Ok(()),
        }
    }
}

/// Runs the device beside what a MainDevice does with it.
fn beside<T>(chip: SharedChip, ready: bool, script: impl AsyncFnOnce(&mut MainDevice<'_>) -> T) -> T {
    let mut interrupt = Interrupt::new(chip.clone());
    let application = Sum { outputs: [0; 2], ready };
    let mut sub_device = SubDevice::new(&DEVICE, DirectPdi::new(chip.clone()), application);
    let mut main_device = MainDevice::new(chip, &DEVICE);
    let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
    match block_on(select(device, script(&mut main_device))) {
        Either::First(never) => never,
        Either::Second(value) => value,
    }
}

#[test]
fn it_brings_a_device_up_and_down_and_exchanges_process_data() {
    let chip = Chip::of(&DEVICE);
    beside(chip.clone(), true, async |main_device| {
        for state in [AlState::PreOp, AlState::Op, AlState::SafeOp, AlState::Op, AlState::Init, AlState::Op] {
            assert_eq!(main_device.bring_to(state).await, Ok(()));
            assert_eq!(chip.borrow().peek::<1>(0x0130), [state as u8]);
        }
        main_device.exchange(&[3, 4]).await.unwrap();
        assert_eq!(main_device.exchange(&[5, 6]).await, Ok(vec![7]));
        assert_eq!(main_device.exchange(&[0, 0]).await, Ok(vec![11]));
    });
}

#[test]
fn it_says_why_a_state_is_refused() {
    beside(Chip::of(&DEVICE), false, async |main_device| {
        let refused = main_device.bring_to(AlState::Op).await;
        assert_eq!(refused, Err(Refusal::Error(AlStatusCode::HardwareNotReady as u16)));
        assert_eq!(main_device.bring_to(AlState::PreOp).await, Ok(()), "which is acknowledged");
    });
}

#[test]
fn it_says_when_nobody_serves_the_controller() {
    let mut main_device = MainDevice::new(Chip::of(&DEVICE), &DEVICE);
    // AL control takes no second request before the first was read.
    assert_eq!(block_on(main_device.bring_to(AlState::PreOp)), Err(Refusal::NotTaken));
}

#[test]
fn it_says_when_a_state_does_not_come() {
    let chip = Chip::of(&DEVICE);
    let mut processor = DirectPdi::new(chip.clone());
    let reads_only = async {
        loop {
            processor.read(0x0120, &mut [0; 2]).await.unwrap();
            yield_now().await;
        }
    };
    let mut main_device = MainDevice::new(chip, &DEVICE);
    let outcome = block_on(select(reads_only, main_device.bring_to(AlState::PreOp)));
    assert!(matches!(outcome, Either::Second(Err(Refusal::Late(1)))), "it is in Init still");
}
