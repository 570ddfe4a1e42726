//! Images as long as the controller's memory holds them three times, and those that it does not hold.

use ethercat_subdevice::device::Identity;
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::object::{Entry, Mapped};
use ethercat_subdevice::standard;
use ethercat_subdevice::sync_manager::MemoryPlan;
use mobgate_simulator::esc::bench::{PRE_OP, Rig, Start};
use mobgate_simulator::esc::main_device::{MainDevice, Refusal};
use mobgate_simulator::sub_device::exchange_images_on;

use crate::prelude::*;

const CYCLES: u64 = 10_000;
/// The most that the processor pauses between two accesses.
const PAUSE_US: u64 = 20;
/// The longest images.
const OUTPUTS: usize = 1_500;
const INPUTS: usize = 1_486;

const IDENTITY: Identity = Identity { vendor: 1, product: 2, revision: 3, serial: 4 };
/// One PDO each way, since an image is known again as a whole. The short ones are for a choice.
const OBJECTS: &[Object] = &[
    standard::device_type(0),
    standard::identity(&standard::identity_entries(IDENTITY)),
    Object::mapping(0x1600, "1500 outputs", &[all_of(0x7000, 75, 160)]),
    Object::mapping(0x1601, "1152 outputs", &[all_of(0x7001, 64, 144)]),
    Object::mapping(0x1602, "8 outputs", &[all_of(0x7002, 1, 64)]),
    Object::mapping(
        0x1a00,
        "1486 inputs",
        &[all_of(0x6000, 74, 160), Mapped { index: 0x6001, sub: 0, count: 1, bits: 48 }],
    ),
    Object::mapping(0x1a01, "8 inputs", &[all_of(0x6002, 1, 64)]),
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[0x1600], standard::SELECTABLE),
    standard::tx_assignment(&[0x1a00], standard::SELECTABLE),
    Object::array(0x6000, "Inputs", 74, Entry::input("Inputs", DataType::Octets(20))),
    Object::variable(0x6001, Entry::input("Last inputs", DataType::Octets(6))),
    Object::array(0x6002, "Few inputs", 1, Entry::input("Inputs", DataType::Octets(8))),
    Object::array(0x7000, "Outputs", 75, Entry::output("Outputs", DataType::Octets(20))),
    Object::array(0x7001, "Less outputs", 64, Entry::output("Outputs", DataType::Octets(18))),
    Object::array(0x7002, "Few outputs", 1, Entry::output("Outputs", DataType::Octets(8))),
];

/// 1152 bytes of outputs after power-on.
const LESS_OUTPUTS: &[Object] = &{
    let mut objects = [standard::SYNC_MANAGER_TYPES; OBJECTS.len()];
    let mut nth = 0;
    while nth < OBJECTS.len() {
        objects[nth] = match OBJECTS[nth].index {
            0x1c12 => standard::rx_assignment(&[0x1601], standard::SELECTABLE),
            _ => OBJECTS[nth],
        };
        nth += 1;
    }
    objects
};

const fn all_of(index: u16, count: u8, bits: u8) -> Mapped {
    Mapped { index, sub: 1, count, bits }
}

const fn device(memory: MemoryPlan, objects: &'static [Object]) -> Device {
    Device {
        identity: IDENTITY,
        vendor_name: "Large",
        name: "Large",
        order: "LARGE",
        group: "Large",
        memory,
        controller: [0x80, 0, 0, 0, 0, 0, 0, 0],
        emergencies: false,
        files: FileAccess::None,
        ethernet: false,
        texts: &[],
        objects,
    }
}

static LARGEST: Device = device(MemoryPlan::new(128, OUTPUTS as u16, INPUTS as u16, 10 * 1024), OBJECTS);
/// As much as 8 KiB hold with so many inputs.
static FOR_8_KIB: Device = device(MemoryPlan::new(128, 1_152, INPUTS as u16, 8 * 1024), LESS_OUTPUTS);

#[test]
fn statement_62_images_of_1486_and_1500_bytes_are_whole_on_a_chip_with_the_memory() {
    for (kind, device) in [(Kind::IP_CORE, &LARGEST), (Kind::ET1100, &FOR_8_KIB)] {
        let exchanged = exchange_images_on::<OUTPUTS, INPUTS>(kind, device, CYCLES, PAUSE_US).unwrap();
        println!("{} KiB: {exchanged:?}", kind.ram_kib);
        assert_eq!((exchanged.short, exchanged.lost, exchanged.wrong), (0, 0, 0));
    }
}

/// The way of [`LARGEST`] to SafeOp on a chip, with buffers for so many bytes.
fn to_safe_op<const OUT: usize, const IN: usize>(kind: Kind) -> Result<(), Refusal> {
    let mut world = World::new(1);
    let chip = Rc::new(Chip::with_sii(kind, &LARGEST).into());
    let (esc, interrupt) = direct(Rc::clone(&chip));
    let sub_device = SubDevice::<_, _, OUT, IN>::with_buffers(&LARGEST, esc, SharedEcho::default());
    spawn(&world, sub_device, interrupt);
    world.run_for(Duration::from_millis(1));
    let mut main_device = MainDevice::new(chip, &LARGEST);
    world.run_until(main_device.bring_to(AlState::SafeOp))
}

#[test]
fn statement_62_an_image_that_the_memory_or_a_buffer_does_not_hold_is_refused_on_the_way_to_safe_op() {
    let (outputs, inputs) = (Err(Refusal::Error(0x0025)), Err(Refusal::Error(0x0024)));
    assert_eq!(to_safe_op::<OUTPUTS, INPUTS>(Kind::IP_CORE), Ok(()));
    assert_eq!(to_safe_op::<OUTPUTS, INPUTS>(Kind { ram_kib: 10, ..Kind::IP_CORE }), Ok(()));
    assert_eq!(to_safe_op::<OUTPUTS, INPUTS>(Kind { ram_kib: 9, ..Kind::IP_CORE }), inputs);
    assert_eq!(to_safe_op::<OUTPUTS, INPUTS>(Kind::ET1100), inputs);
    assert_eq!(to_safe_op::<OUTPUTS, INPUTS>(Kind::LAN9252), outputs);
    assert_eq!(to_safe_op::<{ OUTPUTS - 1 }, INPUTS>(Kind::IP_CORE), outputs);
    assert_eq!(to_safe_op::<OUTPUTS, { INPUTS - 1 }>(Kind::IP_CORE), inputs);
}

#[test]
fn statement_62_pdos_that_the_memory_does_not_hold_cannot_be_assigned() {
    let start = Start { kind: Kind::ET1100, pause: Duration::from_micros(50), edges: false };
    let mut rig = Rig::start(&LARGEST, SharedEcho::default(), start, direct);
    rig.bring_to(PRE_OP);
    let mut assign = |index: u16, pdo: u16| {
        rig.download(index, 0, &[0]).unwrap();
        rig.download(index, 1, &pdo.to_le_bytes()).unwrap();
        rig.download(index, 0, &[1])
    };
    // 1486 bytes of inputs behind 1500 of outputs: 1144 are left.
    assert_eq!(assign(0x1c13, 0x1a00), Err(0x0604_0042));
    assert_eq!((assign(0x1c13, 0x1a01), assign(0x1c12, 0x1602)), (Ok(()), Ok(())));
}
