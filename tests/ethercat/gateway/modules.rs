//! The modular gateway: Modbus devices as modules in slots, configured by a start-up list, with typed values.

use mobgate::fieldbus::{LONG_MODULAR, MODULAR};

use super::bench::MS;
use crate::information::{ask, list};
use crate::prelude::*;

static GATEWAY: Device = MODULAR;
pub(super) const SLAVES: u16 = 32;

pub(super) type Objects = GatewayObjects<'static>;
/// Index, sub-index and value of each SDO.
pub(super) type List = Vec<(u16, u8, Vec<u8>)>;

/// Types of registers by number, in bytes: u16, i16, u32, i32, f32, u64, i64, f64.
pub(super) const TYPE_BYTES: [usize; 8] = [2, 2, 4, 4, 4, 8, 8, 8];

fn rig() -> Rig<Objects> {
    let place = place_with("port ecat ethercat modules");
    let mut rig = Rig::with_application(&GATEWAY, GatewayObjects::modular(place));
    rig.set_up_mailboxes();
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    rig
}

/// Why the configuration is refused.
fn reason(rig: &mut Rig<Objects>) -> String {
    let text = rig.upload(0x2006, 0).unwrap();
    String::from_utf8(text).unwrap().trim_end_matches('\0').to_owned()
}

/// What stands in a slot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Module {
    pub(super) coils: u16,
    pub(super) discrete: u16,
    /// How many values, and of which type.
    pub(super) inputs: (u16, usize),
    pub(super) holding: (u16, usize),
}

impl Module {
    fn drawn(random: &mut Random) -> Self {
        let mut registers = || {
            let kind = random.index(TYPE_BYTES.len());
            (random.index(2) as u16, kind)
        };
        let (inputs, holding) = (registers(), registers());
        // One value at least, or it is no module.
        Self { coils: random.index(12) as u16, discrete: 1 + random.index(20) as u16, inputs, holding }
    }

    /// The SDOs that configure it.
    fn list(&self, slot: u16) -> List {
        let index = 0x8000 + 0x10 * slot;
        let cells = |(values, kind): (u16, usize)| values * TYPE_BYTES[kind] as u16 / 2;
        let counts = [self.coils, self.discrete, cells(self.inputs), cells(self.holding)];
        let mut list = vec![(index, 1, (slot + 1).to_le_bytes().to_vec())];
        for (count, sub) in counts.into_iter().zip([2, 4, 6, 8]) {
            list.push((index, sub, count.to_le_bytes().to_vec()));
            list.push((index, sub + 1, (100 * slot).to_le_bytes().to_vec()));
        }
        list.push((index, 14, vec![self.inputs.1 as u8]));
        list.push((index, 15, vec![self.holding.1 as u8]));
        list.push((index, 16, vec![slot as u8 % 4]));
        list
    }

    /// Bytes of its values in the image, and in its PDO of inputs.
    fn image_bytes(&self) -> usize {
        let bytes = |(values, kind): (u16, usize)| usize::from(values) * TYPE_BYTES[kind];
        usize::from(self.coils.div_ceil(8) + self.discrete.div_ceil(8))
            + bytes(self.inputs)
            + bytes(self.holding)
    }

    pub(super) fn pdo_bytes(&self, channel: Channel) -> usize {
        let bytes = |(values, kind): (u16, usize)| usize::from(values) * TYPE_BYTES[kind];
        match channel {
            Channel::Outputs => 2 * usize::from(self.coils.div_ceil(16)) + bytes(self.holding),
            _ => {
                let bits = self.coils + self.discrete;
                2 * usize::from(bits.div_ceil(16)) + bytes(self.inputs) + bytes(self.holding)
            }
        }
    }
}

pub(super) fn modules(random: &mut Random) -> Vec<Module> {
    (0..SLAVES).map(|_| Module::drawn(random)).collect()
}

pub(super) fn start_up_list(modules: &[Module]) -> List {
    let count = (modules.len() as u16).to_le_bytes().to_vec();
    let of_modules = modules.iter().zip(0..).flat_map(|(module, slot)| module.list(slot));
    [(0x2000, 1, count)].into_iter().chain(of_modules).collect()
}

pub(super) fn send(rig: &mut Rig<Objects>, list: &[(u16, u8, Vec<u8>)]) {
    for (index, sub, value) in list {
        assert_eq!(rig.download(*index, *sub, value), Ok(()), "{index:04x}:{sub:02x}");
    }
}

/// Sets the SyncManagers and FMMUs up by what the device says that its PDOs are, as MainDevices do; bytes of outputs and inputs.
pub(crate) fn set_up(rig: &mut Rig<Objects>) -> [u16; 2] {
    let mut logical = LOGICAL;
    [(0, Channel::Outputs, 0x1c12, 2), (1, Channel::Inputs, 0x1c13, 1)].map(
        |(nth, channel, index, direction)| {
            let mut bits = 0;
            for at in 1..=rig.upload(index, 0).unwrap()[0] {
                let pdo = rig.upload(index, at).unwrap();
                let pdo = u16::from_le_bytes([pdo[0], pdo[1]]);
                let entries = rig.upload(pdo, 0).unwrap()[0];
                bits += (1..=entries).map(|sub| u16::from(rig.upload(pdo, sub).unwrap()[0])).sum::<u16>();
            }
            let bytes = bits / 8;
            let mut block = rig.sync_manager(channel);
            for active in [0, u8::from(bytes > 0)] {
                block[2..4].copy_from_slice(&bytes.to_le_bytes());
                block[6] = active;
                assert_eq!(rig.write(channel.registers(), &block), 1);
            }
            let [low, high] = MODULAR.memory.start(channel).to_le_bytes();
            let [few, many] = bytes.to_le_bytes();
            let behind = [few, many, 0, 7, low, high, 0, direction, 1, 0, 0, 0];
            rig.write(0x0600 + 16 * nth, &[&logical.to_le_bytes()[..], &behind].concat());
            logical += u32::from(bytes);
            bytes
        },
    )
}

#[test]
fn thirty_two_modules_of_mixed_types_are_configured_by_a_start_up_list_and_read_back_as_typed_entries() {
    let modules = modules(&mut Random::new(7));
    let mut rig = rig();
    let list = start_up_list(&modules);
    // Twice in a row, as a MainDevice that starts again does.
    for _ in 0..2 {
        send(&mut rig, &list);
        for (index, sub, value) in &list {
            assert_eq!(rig.upload(*index, *sub).as_ref(), Ok(value), "{index:04x}:{sub:02x}");
        }
        let [outputs, inputs] = set_up(&mut rig);
        let sum = |channel| modules.iter().map(|module| module.pdo_bytes(channel)).sum::<usize>();
        assert_eq!(usize::from(outputs), sum(Channel::Outputs));
        assert_eq!(usize::from(inputs), sum(Channel::Inputs) + 2, "and the counter");
        assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0), "taken over without 2005h");
        assert_eq!(rig.upload(0x2005, 2), Ok(vec![1, 0]));
        check_values(&mut rig, &modules);
        exchange(&mut rig, &modules, [outputs, inputs]);
        assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    }
}

/// Puts values into the image as devices' responses would, and reads each as an entry.
fn check_values(rig: &mut Rig<Objects>, modules: &[Module]) {
    let place = rig.application().shared();
    let image: Vec<u8> = (0..512).map(|nth| (nth * 37 + 11) as u8).collect();
    place.scanner().with(|scanner| scanner.image_mut(0, 512).copy_from_slice(&image));
    let mut at = 0;
    for (module, slot) in modules.iter().zip(0..) {
        let coils = at;
        let switches = coils + usize::from(module.coils.div_ceil(8));
        for (first, object, count) in [(switches, 0x6000, module.discrete), (coils, 0x6001, module.coils)] {
            for nth in 0..usize::from(count) {
                let bit = image[first + nth / 8] >> (nth % 8) & 1;
                assert_eq!(rig.upload(object + 0x10 * slot, nth as u8 + 1), Ok(vec![bit]));
            }
        }
        let mut registers = switches + usize::from(module.discrete.div_ceil(8));
        for (object, (values, kind)) in [(0x6002, module.inputs), (0x6003, module.holding)] {
            for nth in 0..usize::from(values) {
                let bytes = &image[registers..registers + TYPE_BYTES[kind]];
                let value: Vec<u8> = bytes.iter().rev().copied().collect();
                assert_eq!(rig.upload(object + 0x10 * slot, nth as u8 + 1), Ok(value), "low byte first");
                registers += TYPE_BYTES[kind];
            }
        }
        at += module.image_bytes();
        assert_eq!(at, registers);
    }
}

/// Outputs come out as typed values, and inputs are those that SDO reads.
fn exchange(rig: &mut Rig<Objects>, modules: &[Module], [outputs, inputs]: [u16; 2]) {
    let mut data: Vec<u8> = (0..outputs).map(|nth| (nth * 29 + 3) as u8).collect();
    data.resize(usize::from(outputs + inputs), 0);
    let cycle = |rig: &mut Rig<Objects>| {
        let response = rig.segment.send_logical(Command::Lrw, LOGICAL, &data);
        rig.pass(1);
        assert_eq!(response.counter, 3);
        response.data
    };
    cycle(rig);
    assert_eq!(rig.request(OP), (OP, 0));
    let response = cycle(rig);
    let (mut output, mut input) = (0, usize::from(outputs));
    for (module, slot) in modules.iter().zip(0..) {
        for nth in 0..usize::from(module.coils) {
            let bit = data[output + nth / 8] >> (nth % 8) & 1;
            assert_eq!(rig.upload(0x7000 + 0x10 * slot, nth as u8 + 1), Ok(vec![bit]));
        }
        let (values, kind) = module.holding;
        let registers = output + module.pdo_bytes(Channel::Outputs) - usize::from(values) * TYPE_BYTES[kind];
        if values == 1 {
            let value = data[registers..registers + TYPE_BYTES[kind]].to_vec();
            assert_eq!(rig.upload(0x7001 + 0x10 * slot, 1), Ok(value));
        }
        for nth in 0..usize::from(module.discrete) {
            let bit = response[input + nth / 8] >> (nth % 8) & 1;
            assert_eq!(rig.upload(0x6000 + 0x10 * slot, nth as u8 + 1), Ok(vec![bit]));
        }
        let end = input + module.pdo_bytes(Channel::Inputs);
        if values == 1 {
            let value = response[end - TYPE_BYTES[kind]..end].to_vec();
            assert_eq!(rig.upload(0x6003 + 0x10 * slot, 1), Ok(value));
        }
        (output, input) = (output + module.pdo_bytes(Channel::Outputs), end);
    }
}

#[test]
fn modules_that_the_main_device_does_not_expect_keep_it_from_safe_op() {
    let modules = modules(&mut Random::new(8));
    let mut rig = rig();
    send(&mut rig, &start_up_list(&modules));
    for slot in 1..=SLAVES as u8 {
        let ident = rig.upload(0xf050, slot).unwrap();
        assert_ne!(ident, [0; 4]);
        assert_eq!(rig.upload(0x9000 + 0x10 * (u16::from(slot) - 1), 1).as_ref(), Ok(&ident));
        rig.download(0xf030, slot, &ident).unwrap();
    }
    set_up(&mut rig);
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0), "as expected");
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));

    let ident = rig.upload(0xf030, 5).unwrap();
    for wrong in [[0; 4], [1, 2, 3, 4]] {
        rig.download(0xf030, 5, &wrong).unwrap();
        assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0070));
        assert_eq!(reason(&mut rig), "slot 4: not the module that is expected");
        let newest = rig.upload(0x10f3, 2).unwrap()[0];
        let message = rig.upload(0x10f3, newest).unwrap();
        assert_eq!((message[6], message[18]), (7, 4), "its own text, and which slot: {message:?}");
        assert_eq!(rig.request(PRE_OP | ERROR), (PRE_OP, 0));
    }
    rig.download(0xf030, 5, &ident).unwrap();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    assert_eq!(rig.download(0xf030, 5, &ident), Err(0x0800_0022), "they stay as long as process data do");
    assert_eq!(rig.download(0x8000, 2, &[9, 0]), Err(0x0800_0022));
    assert_eq!(rig.download(0x2000, 1, &[1, 0]), Err(0x0800_0022));
}

#[test]
fn what_does_not_fit_is_refused_with_its_reason() {
    let registers = |sub: u8, count: u16| vec![(0x8000, sub, count.to_le_bytes().to_vec())];
    let mut three_of_each: List = registers(6, 3);
    three_of_each.push((0x8000, 14, vec![4]));
    let mut many = registers(2, 200);
    many.extend(registers(4, 200));
    let long: List = (0..3).map(|slot| (0x8000 + 0x10 * slot, 6, 90_u16.to_le_bytes().to_vec())).collect();
    for (list, code, told) in [
        (three_of_each, 0x26, "slave 0: half a value of input"),
        (registers(4, 255), 0x26, "slave 0: over 254 entries in a PDO"),
        (many, 0x26, "slave 0: over 254 entries in a PDO"),
        (registers(8, 65_535), 0x26, "slave 0: over 254 entries in a PDO"),
        (long, 0x24, "slave 2 ends past the 512 input bytes"),
    ] {
        let mut rig = rig();
        send(&mut rig, &list);
        assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, code), "{told}");
        assert_eq!(reason(&mut rig), told, "{code}");
        assert_eq!(rig.download(0x8000, 14, &[8]), Err(0x0609_0031), "no such type");
    }
}

#[test]
fn modules_that_the_controllers_memory_does_not_hold_are_refused() {
    static LONG: Device = LONG_MODULAR;
    let place = place_with("port ecat ethercat modules");
    // 4 KiB hold no inputs behind 1500 bytes of outputs.
    let mut rig = Rig::reached_by(&LONG, GatewayObjects::modular(place), MS, direct);
    rig.bring_to(PRE_OP);
    send(&mut rig, &start_up_list(&[Module { discrete: 8, ..Module::default() }]));
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x24));
    // A status of two bytes and the module's eight bits, in a PDO of whole words.
    assert_eq!(reason(&mut rig), "the controller holds 0 of 4 input bytes");
}

#[test]
fn a_start_up_list_that_is_cut_anywhere_can_be_followed_by_the_whole() {
    let mut random = Random::new(9);
    let mut rig = rig();
    for _ in 0..10 {
        let modules = modules(&mut random);
        let list_of_sdos = start_up_list(&modules);
        send(&mut rig, &list_of_sdos[..random.index(list_of_sdos.len())]);
        // Whatever has come of it, the objects are those that are listed.
        let listed = list(&mut rig, 1);
        assert!(listed.is_sorted());
        assert!(listed.iter().all(|&index| rig.upload(index, 0).is_ok()));
        send(&mut rig, &list_of_sdos);
        set_up(&mut rig);
        assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
        check_values(&mut rig, &modules);
        assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    }
}

#[test]
fn a_list_of_expected_modules_may_be_shorter_than_there_are_slots() {
    let modules = vec![Module { discrete: 8, ..Module::default() }, Module { coils: 8, ..Module::default() }];
    let mut rig = rig();
    send(&mut rig, &start_up_list(&modules));
    let idents = [1, 2].map(|slot| rig.upload(0xf050, slot).unwrap());
    rig.download(0xf030, 3, &[1, 2, 3, 4]).unwrap();
    // A count of 16 bits, and as many idents: what is behind them is expected to be empty. Any variant of an ident is the same module.
    let [[_, rest @ ..], _] = &idents.each_ref().map(|ident| <[u8; 4]>::try_from(&ident[..]).unwrap());
    let list = [&[2, 0, 9][..], rest, &idents[1]].concat();
    rig.download_complete(0xf030, 0, &list).unwrap();
    assert_eq!(rig.upload(0xf030, 3), Ok(vec![0; 4]));
    set_up(&mut rig);
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    rig.download_complete(0xf030, 0, &list[..6]).expect_err("half a list");
    rig.download_complete(0xf030, 0, &[&[1, 0][..], &list[2..6]].concat()).unwrap();
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0070), "the second one is not expected");
}

#[test]
fn entries_of_a_table_are_numbered_in_sdo_information() {
    let modules = vec![Module { coils: 9, holding: (1, 4), ..Module::default() }; 2];
    let mut rig = rig();
    send(&mut rig, &start_up_list(&modules));
    let mut name = |index: u16, sub: u8| {
        let [low, high] = index.to_le_bytes();
        String::from_utf8(ask(&mut rig, 5, &[low, high, sub, 0]).unwrap()[10..].to_vec()).unwrap()
    };
    assert_eq!(name(0x7010, 9), "Coil 9");
    assert_eq!(name(0x6013, 1), "Holding register 1");
    assert_eq!(name(0xf030, 32), "Module ident 32");
    assert_eq!(name(0x8010, 1), "Id", "a record's have names of their own");
}

#[test]
fn the_promised_cycle_grows_with_the_modules() {
    let mut rig = rig();
    let cycle =
        |rig: &mut Rig<Objects>| u32::from_le_bytes(rig.upload(0x1c32, 5).unwrap().try_into().unwrap());
    let none = cycle(&mut rig);
    let module = Module { discrete: 1, ..Module::default() };
    send(&mut rig, &start_up_list(&[module; 10]));
    let ten = cycle(&mut rig);
    send(&mut rig, &start_up_list(&[module; 20]));
    assert!(ten > none && cycle(&mut rig) - ten == ten - none, "{none}, then {ten}");
}
