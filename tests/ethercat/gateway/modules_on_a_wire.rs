//! 32 Modbus devices of mixed types on a wire, as modules of the gateway, with ethercrab as its MainDevice.

use ethercrab::subdevice_group::{Op, PreOp};
use mobgate_simulator::Device;

use super::bench::{to_op, with_long_wire, with_rig, with_wire};
use super::modules::{List, Module, SLAVES, TYPE_BYTES, modules, start_up_list};
use crate::prelude::*;

const BAUD: u32 = 115_200;
const SETTINGS: &str = "port bus serial uart1 rtu client 115200 8E1 timeout 1s
    port ecat ethercat line bus modules
    route ecat 1-247 * * bus";

/// Until each device was asked, and has been written to.
const ROUNDS: Duration = Duration::from_secs(6);
const CYCLE: Duration = Duration::from_millis(5);

/// The bytes of a value of 32 or 64 bits in its registers, in the order of a module's settings: 0123, 2301, 1032, 3210.
fn ordered(value: &[u8], slot: usize) -> Vec<u8> {
    let order = [[0, 1, 2, 3], [2, 3, 0, 1], [1, 0, 3, 2], [3, 2, 1, 0]][slot % 4];
    let long = [
        [0, 1, 2, 3, 4, 5, 6, 7],
        [6, 7, 4, 5, 2, 3, 0, 1],
        [1, 0, 3, 2, 5, 4, 7, 6],
        [7, 6, 5, 4, 3, 2, 1, 0],
    ][slot % 4];
    match value.len() {
        4 => order.map(|at| value[at]).to_vec(),
        8 => long.map(|at| value[at]).to_vec(),
        _ => value.to_vec(),
    }
}

/// A value, its high byte first, which is another one in each place.
fn value(slot: usize, place: u32, kind: usize) -> Vec<u8> {
    let number = 1_000 * slot as u32 + place;
    match kind {
        0 => (number as u16).to_be_bytes().to_vec(),
        1 => (-(number as i16)).to_be_bytes().to_vec(),
        2 => (number * 70_001).to_be_bytes().to_vec(),
        3 => (-(number as i32) * 70_001).to_be_bytes().to_vec(),
        4 => (number as f32 / 8.0).to_be_bytes().to_vec(),
        5 => (u64::from(number) * 70_000_000_001).to_be_bytes().to_vec(),
        6 => (-i64::from(number) * 70_000_000_001).to_be_bytes().to_vec(),
        _ => (f64::from(number) / 8.0).to_be_bytes().to_vec(),
    }
}

fn words(bytes: &[u8]) -> impl Iterator<Item = u16> + '_ {
    bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
}

fn bit(slot: usize, place: usize, of: usize) -> bool {
    (7 * slot + 3 * place + of).is_multiple_of(3)
}

/// The device of a slot, which holds what is to be read.
fn device(module: &Module, slot: usize) -> Device {
    let device = Device::new(slot as u8 + 1);
    let first = 100 * slot;
    let mut memory = device.memory();
    memory.coils = vec![false; first + 300];
    memory.holding = vec![0; first + 300];
    memory.discrete_inputs = vec![false; first + 300];
    memory.input = vec![0; first + 300];
    for nth in 0..usize::from(module.discrete) {
        memory.discrete_inputs[first + nth] = bit(slot, nth, 0);
    }
    let (values, kind) = module.inputs;
    let inputs = (0..values).flat_map(|nth| ordered(&value(slot, nth.into(), kind), slot));
    let inputs: Vec<u8> = inputs.collect();
    memory.input.iter_mut().skip(first).zip(words(&inputs)).for_each(|(place, word)| *place = word);
    drop(memory);
    device
}

/// A module's outputs as they lie in its PDO.
fn outputs(module: &Module, slot: usize) -> Vec<u8> {
    let mut pdo = vec![0; 2 * usize::from(module.coils.div_ceil(16))];
    (0..usize::from(module.coils))
        .filter(|nth| bit(slot, *nth, 1))
        .for_each(|nth| pdo[nth / 8] |= 1 << (nth % 8));
    let (values, kind) = module.holding;
    // Low byte first, as a controller has its variables.
    (0..values).for_each(|nth| pdo.extend(value(slot, 500 + u32::from(nth), kind).iter().rev()));
    pdo
}

/// Its inputs in its PDO, when the device has its outputs.
fn inputs(module: &Module, slot: usize) -> Vec<u8> {
    let discrete = (0..usize::from(module.discrete)).map(|nth| bit(slot, nth, 0));
    let bits: Vec<bool> =
        discrete.chain((0..usize::from(module.coils)).map(|nth| bit(slot, nth, 1))).collect();
    let mut pdo = vec![0; 2 * bits.len().div_ceil(16)];
    bits.iter().enumerate().filter(|(_, on)| **on).for_each(|(nth, _)| pdo[nth / 8] |= 1 << (nth % 8));
    for ((values, kind), place) in [(module.inputs, 0), (module.holding, 500)] {
        (0..values).for_each(|nth| pdo.extend(value(slot, place + u32::from(nth), kind).iter().rev()));
    }
    pdo
}

/// Writes the start-up list, as a MainDevice does in PreOp.
async fn send(dispatcher: &Dispatcher<'_>, group: &Group<PreOp>, list: &List) {
    let gateway = group.subdevice(dispatcher.master, 0).unwrap();
    for (index, sub, value) in list {
        let written = match value[..] {
            [byte] => gateway.sdo_write(*index, *sub, byte).await,
            [low, high] => gateway.sdo_write(*index, *sub, [low, high]).await,
            _ => unreachable!("no value of the list is longer"),
        };
        written.unwrap_or_else(|error| panic!("{index:04x}:{sub:02x}: {error}"));
    }
}

/// Each value by SDO, as the entry of its type.
async fn check_entries(dispatcher: &Dispatcher<'_>, group: &Group<Op>, modules: &[Module]) -> usize {
    let gateway = group.subdevice(dispatcher.master, 0).unwrap();
    let mut checked = 0;
    for (slot, module) in modules.iter().enumerate() {
        checked += usize::from(module.discrete + module.coils + module.inputs.0 + 2 * module.holding.0);
        let at = |first: u16| first + 0x10 * slot as u16;
        for nth in 0..usize::from(module.discrete) {
            let read: u8 = gateway.sdo_read(at(0x6000), nth as u8 + 1).await.unwrap();
            assert_eq!(read, u8::from(bit(slot, nth, 0)), "discrete input {nth} of slot {slot}");
        }
        for nth in 0..usize::from(module.coils) {
            let read: u8 = gateway.sdo_read(at(0x6001), nth as u8 + 1).await.unwrap();
            assert_eq!(read, u8::from(bit(slot, nth, 1)), "coil {nth} of slot {slot}");
        }
        for (index, (values, kind), place) in
            [(0x6002, module.inputs, 0), (0x6003, module.holding, 500), (0x7001, module.holding, 500)]
        {
            for nth in 0..values {
                let mut expected = value(slot, place + u32::from(nth), kind);
                expected.reverse();
                let sub = nth as u8 + 1;
                let read = match TYPE_BYTES[kind] {
                    2 => gateway.sdo_read::<[u8; 2]>(at(index), sub).await.unwrap().to_vec(),
                    8 => gateway.sdo_read::<[u8; 8]>(at(index), sub).await.unwrap().to_vec(),
                    _ => gateway.sdo_read::<[u8; 4]>(at(index), sub).await.unwrap().to_vec(),
                };
                assert_eq!(read, expected, "{index:04x} of slot {slot}, entry {sub}");
            }
        }
    }
    checked
}

fn devices(modules: &[Module]) -> Vec<Device> {
    modules.iter().enumerate().map(|(slot, module)| device(module, slot)).collect()
}

/// What all modules have, behind each other.
fn all(modules: &[Module], part: fn(&Module, usize) -> Vec<u8>) -> Vec<u8> {
    modules.iter().enumerate().flat_map(|(slot, module)| part(module, slot)).collect()
}

/// Starts the gateway twice with the same start-up list: each value is right in the process data, whose frames count `counter`
/// together, and as an entry.
async fn start_twice(dispatcher: Dispatcher<'_>, modules: &[Module], counter: u16) -> usize {
    let (outputs, inputs) = (all(modules, outputs), all(modules, inputs));
    let mut checked = 0;
    for round in 0..2 {
        let group = dispatcher.to_pre_op().await.unwrap();
        let mut list = start_up_list(modules);
        // Nine bits with an even parity, as the line has it.
        list.extend([(0x2020, 2, vec![1, 0]), (0x2020, 3, vec![2, 0])]);
        send(&dispatcher, &group, &list).await;
        let group = to_op(&dispatcher, group, &outputs, CYCLE).await;
        assert_eq!(group.subdevice(dispatcher.master, 0).unwrap().outputs_raw().len(), outputs.len());
        let begin = Instant::now();
        while begin.elapsed() < ROUNDS {
            assert_eq!(group.tx_rx(dispatcher.master).await.unwrap().working_counter, counter);
            Timer::after(CYCLE).await;
        }
        let read = group.subdevice(dispatcher.master, 0).unwrap().inputs_raw().to_vec();
        let mut at = 0;
        for (slot, module) in modules.iter().enumerate() {
            let end = at + module.pdo_bytes(Channel::Inputs);
            assert_eq!(read[at..end], inputs[at..end], "slot {slot}, start {round}");
            at = end;
        }
        assert_eq!(read.len(), at + 2, "and the counter");
        checked += check_entries(&dispatcher, &group, modules).await;
        // Without cycles its outputs have stopped meanwhile: the next start begins from SafeOp with that error.
    }
    checked
}

#[test]
fn thirty_two_devices_of_mixed_types_are_modules_by_their_start_up_list_alone_twice_in_a_row() {
    let modules = modules(&mut Random::new(11));
    assert_eq!(modules.len(), usize::from(SLAVES));
    with_wire(BAUD, SETTINGS, devices(&modules), async |dispatcher, _| {
        let checked = start_twice(dispatcher, &modules, 3).await;
        at_most("module_entries_wrong", 0, &format!("of {checked}"), 0);
    });
}

/// 32 modules with more than 512 bytes each way, of types that fit a frame so often.
fn long_modules() -> Vec<Module> {
    let kinds = (0..usize::from(SLAVES)).map(|slot| slot % 5);
    kinds.map(|kind| Module { coils: 5, discrete: 5, inputs: (5, kind), holding: (6, kind) }).collect()
}

#[test]
fn thirty_two_modules_have_more_than_512_bytes_behind_a_controller_with_the_memory() {
    let modules = long_modules();
    assert_eq!([outputs, inputs].map(|part| all(&modules, part).len()), [664, 1_164]);
    with_long_wire(Kind::IP_CORE, BAUD, SETTINGS, devices(&modules), async |dispatcher, _| {
        // Two frames: one writes and reads, the other one reads the rest.
        start_twice(dispatcher, &modules, 4).await;
    });
}

#[test]
fn modules_that_are_exchanged_stay_until_the_main_device_has_left_them() {
    let module = Module { discrete: 8, ..Module::default() };
    with_rig(BAUD, SETTINGS, vec![device(&module, 0)], async |dispatcher, rig| {
        let type_line = |line: &str| rig.console(line);
        type_line("slave 0 unit 1 discrete 0 count 8").unwrap();
        let group = dispatcher.to_pre_op().await.unwrap();
        type_line("slave 0 unit 1 discrete 0 count 16").unwrap();
        let group = to_op(&dispatcher, group, &[], CYCLE).await;
        assert_eq!(group.subdevice(dispatcher.master, 0).unwrap().inputs_raw().len(), 4);
        let refused = type_line("slave 0 unit 1 discrete 0 count 24").unwrap_err();
        assert_eq!(refused, "the modules are in use by the MainDevice");
        assert!(group.tx_rx(dispatcher.master).await.unwrap().all_op());
        let group = group.into_safe_op(dispatcher.master).await.unwrap();
        assert!(type_line("slave 0 unit 1 discrete 0 count 24").is_err(), "nor in SafeOp");
        group.into_pre_op(dispatcher.master).await.unwrap();
        type_line("slave 0 unit 1 discrete 0 count 24").unwrap();
    });
}
