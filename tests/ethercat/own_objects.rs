//! Objects that an application has beside the device's table, as a modular device does (ETG.5001): they are read, described, listed and
//! mapped as those of the table are, and change with what is written.

use ethercat_subdevice::application::Address;
use ethercat_subdevice::assignment::Assignment;
use ethercat_subdevice::object::{Access, Entries, Entry, Mapped, PdoRules, RUNS_MAX, Runs};
use ethercat_subdevice::standard;

use crate::information::{ask, list};
use crate::prelude::*;

/// How many modules there are; what the table has of them.
const MODULES: Object = Object::variable(
    0x2000,
    Entry::setting("Modules", DataType::U8, 0, (0, 4)).with_access(standard::SELECTABLE),
);

static MODULAR: Device = Device { objects: OBJECTS, ..MAILBOX_128 };
static SMALL_MAILBOXES: Device = Device { objects: OBJECTS, ..MAILBOX_34 };

const OBJECTS: &[Object] = &[
    standard::device_type(5001),
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[], Access::READ),
    standard::tx_assignment(&[], Access::READ),
    standard::OUTPUT_SYNCHRONISATION,
    standard::INPUT_SYNCHRONISATION,
    MODULES,
    Object::variable(0x6005, Entry::number("Between the modules", DataType::U8, 5)),
];

/// Switches of a module.
const SWITCHES: u8 = 11;
const SWITCH: Entry = Entry::input("Switch", DataType::Bool);
const LAMP: Entry = Entry::output("Lamp", DataType::I16);
const HEAT: Entry = Entry::input("Heat", DataType::F32);

/// A device of up to four modules: each has eleven switches and a temperature, and takes a number. Its PDOs are 6 and 2 bytes long.
#[derive(Default)]
struct Modular {
    modules: u8,
    /// The numbers that came.
    numbers: [i16; 4],
}

impl Modular {
    fn modules(&self) -> impl Iterator<Item = u16> + use<> {
        0..u16::from(self.modules)
    }

    fn indices(&self, area: u16, step: u16) -> impl Iterator<Item = u16> + use<> {
        self.modules().map(move |nth| area + step * nth)
    }
}

impl Application for Modular {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        match at.index {
            0x2000 => into.copy_from_slice(&[self.modules]),
            // Every third switch is on, beginning with the module's number.
            0x6000..=0x6030 if at.index & 0xf == 0 => {
                into.copy_from_slice(&[u8::from((u16::from(at.sub) + (at.index >> 4)).is_multiple_of(3))]);
            }
            _ => into.copy_from_slice(&(f32::from(at.index >> 4) / 2.0).to_le_bytes()),
        }
        Ok(into.len())
    }

    fn write(&mut self, _at: Address, value: &[u8]) {
        self.modules = value[0];
    }

    fn object(&self, index: u16) -> Option<Object> {
        let nth = if index < 0x6000 { index & 0xf } else { index >> 4 & 0xf };
        let run = |index, count, bits| Mapped { index, sub: 1, count, bits };
        let padding = Mapped { index: 0, sub: 0, count: 1, bits: 5 };
        let pdo = |runs: &[Mapped]| {
            let runs = runs.iter().fold(Runs::NONE, |runs, run| runs.and(*run).unwrap());
            Entries::Mapping(runs, PdoRules::NONE)
        };
        let [switches, heat] = [run(0x6000 + 0x10 * nth, SWITCHES, 1), run(0x6001 + 0x10 * nth, 1, 32)];
        let (name, entries) = match index {
            0x1600..=0x1603 => ("Outputs", pdo(&[run(0x7000 + 0x10 * nth, 1, 16)])),
            0x1a00..=0x1a03 => ("Inputs", pdo(&[switches, padding, heat])),
            0x6000..=0x603f if index & 0xf == 0 => ("Switches", Entries::Array(SWITCHES, SWITCH)),
            0x6000..=0x603f if index & 0xf == 1 => ("Heat", Entries::Array(1, HEAT)),
            0x7000..=0x703f if index & 0xf == 0 => ("Lamps", Entries::Array(1, LAMP)),
            _ => return None,
        };
        (nth < self.modules.into()).then_some(Object { index, name, entries })
    }

    fn next_object(&self, index: u16) -> Option<u16> {
        let all = self.indices(0x1600, 1).chain(self.indices(0x1a00, 1)).chain(self.indices(0x6000, 0x10));
        let all = all.chain(self.indices(0x6001, 0x10)).chain(self.indices(0x7000, 0x10));
        all.filter(|found| *found >= index).min()
    }

    fn assignment(&self, channel: Channel) -> Option<Assignment> {
        let first = if channel == Channel::Outputs { 0x1600 } else { 0x1a00 };
        let bytes = if channel == Channel::Outputs { 2 } else { 6 };
        let present = (1 << self.modules) - 1;
        Some(Assignment::of_modules(channel, first, present, bytes * u16::from(self.modules)))
    }

    fn outputs(&mut self, pdo: u16, bytes: &[u8]) {
        self.numbers[usize::from(pdo & 0xf)] = i16::from_le_bytes(bytes.try_into().unwrap());
    }

    fn inputs(&mut self, pdo: u16, into: &mut [u8]) {
        into.fill(pdo as u8 + 1);
    }

    fn outputs_stopped(&mut self) {}
}

/// A modular device in PreOp with so many modules.
fn modular(device: &'static Device, modules: u8) -> Rig<Modular> {
    let mut rig = Rig::with_application(device, Modular::default());
    rig.set_up_mailboxes();
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    rig.download(0x2000, 0, &[modules]).unwrap();
    rig
}

/// Sets up a SyncManager of process data with so many bytes; it takes them while it is off.
fn set_up(rig: &mut Rig<Modular>, channel: Channel, bytes: u8) {
    let mut block = rig.sync_manager(channel);
    for active in [0, 1] {
        (block[2], block[6]) = (bytes, active);
        assert_eq!(rig.write(channel.registers(), &block), 1);
    }
}

/// Gives two modules their numbers, and checks the inputs that come back.
fn exchange(rig: &mut Rig<Modular>, numbers: [i16; 2]) {
    let mut data: Vec<_> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    data.resize(4 + 12, 0);
    let response = rig.segment.send_logical(Command::Lrw, LOGICAL, &data);
    rig.pass(1);
    assert_eq!((response.counter, &response.data[4..]), (3, &[[1; 6], [2; 6]].concat()[..]));
}

#[test]
fn objects_of_the_application_are_listed_among_those_of_the_table() {
    for device in [&MODULAR, &SMALL_MAILBOXES] {
        let mut rig = modular(device, 2);
        let table = [0x1000, 0x1600, 0x1601, 0x1a00, 0x1a01, 0x1c00, 0x1c12, 0x1c13, 0x1c32, 0x1c33, 0x2000];
        let modules = [0x6000, 0x6001, 0x6005, 0x6010, 0x6011, 0x7000, 0x7010];
        assert_eq!(list(&mut rig, 1), [&table[..], &modules[..]].concat());
        assert_eq!(list(&mut rig, 2), [0x7000, 0x7010], "those that an RxPDO may carry");
        assert_eq!(list(&mut rig, 3), [0x6000, 0x6001, 0x6010, 0x6011]);
        assert_eq!(list(&mut rig, 0), [18, 2, 4, 0, 0]);
        rig.download(0x2000, 0, &[0]).unwrap();
        assert_eq!(list(&mut rig, 1).len(), OBJECTS.len(), "they go with their modules");
    }
}

#[test]
fn a_list_whose_objects_go_while_it_is_sent_ends() {
    let mut rig = modular(&SMALL_MAILBOXES, 4);
    assert_eq!(rig.send(&[0, 0x80, 1, 0, 0, 0, 1, 0]), 1);
    rig.application().modules = 0;
    let mut left = Vec::new();
    while let Some(message) = rig.receive() {
        left.push(u16::from_le_bytes([message[10], message[11]]));
    }
    assert_eq!(left.last(), Some(&0), "the last fragment says that it is: {left:?}");
    assert!(rig.upload(0x2000, 0).is_ok());
}

#[test]
fn objects_of_the_application_are_described_and_read() {
    let mut rig = modular(&MODULAR, 2);
    let description = ask(&mut rig, 3, &0x6010_u16.to_le_bytes()).unwrap();
    assert_eq!(description[..6], [0x10, 0x60, 0x01, 0x00, SWITCHES, 8], "an ARRAY of BOOL");
    assert_eq!(&description[6..], b"Switches");
    let entry = ask(&mut rig, 5, &[0x11, 0x60, 1, 0]).unwrap();
    assert_eq!(entry[4..10], [0x08, 0x00, 32, 0, 0x87, 0x00], "REAL, 32 bits, readable, for a TxPDO");
    let entry = ask(&mut rig, 5, &[0x00, 0x70, 1, 0]).unwrap();
    assert_eq!(entry[4..10], [0x03, 0x00, 16, 0, 0x47, 0x00], "INT, 16 bits, readable, for an RxPDO");

    assert_eq!(rig.upload(0x6011, 1), Ok((f32::from(0x601_u16) / 2.0).to_le_bytes().to_vec()));
    assert_eq!(rig.upload(0x6010, 1).unwrap().len(), 1, "a bit by itself takes a byte");
    assert_eq!(rig.upload(0x6020, 1), Err(0x0602_0000), "the third module is none");
    assert_eq!(ask(&mut rig, 3, &0x6020_u16.to_le_bytes()), Err(0x0602_0000));
    assert_eq!(rig.upload(0x6010, SWITCHES + 1), Err(0x0609_0011));
}

#[test]
fn bits_are_packed_in_a_complete_access() {
    let mut rig = modular(&MODULAR, 1);
    let single: Vec<_> = (1..=SWITCHES).map(|sub| rig.upload(0x6000, sub).unwrap()[0]).collect();
    assert!(single.contains(&1) && single.contains(&0));
    let packed = rig.upload_complete(0x6000, 1).unwrap();
    let bits: Vec<_> = (0..16).map(|nth| packed[nth / 8] >> (nth % 8) & 1).collect();
    assert_eq!((packed.len(), &bits[..11], &bits[11..]), (2, &single[..], &[0; 5][..]));
    let with_count = Ok([&[SWITCHES, 0][..], &packed].concat());
    assert_eq!(rig.upload_complete(0x6000, 0), with_count, "with the count in front");
}

#[test]
fn what_the_sync_managers_carry_follows_the_modules() {
    let mut rig = modular(&MODULAR, 0);
    assert_eq!(rig.upload(0x1c12, 0), Ok(vec![0]));
    for modules in [3, 1, 2] {
        rig.download(0x2000, 0, &[modules]).unwrap();
        assert_eq!(rig.upload(0x1c12, 0), Ok(vec![modules]));
        assert_eq!(rig.upload(0x1c13, modules), Ok(vec![modules - 1, 0x1a]));
        let all: Vec<_> = (0..modules).flat_map(|nth| [nth, 0x1a]).collect();
        assert_eq!(rig.upload_complete(0x1c13, 1), Ok(all));
    }
    assert_eq!(rig.download(0x1c12, 0, &[0]), Err(0x0601_0002), "no MainDevice decides it");
    assert_eq!(rig.upload(0x1a01, 0), Ok(vec![SWITCHES + 2]));
    assert_eq!(rig.upload(0x1a01, 1), Ok(vec![1, 1, 0x10, 0x60]));
    assert_eq!(rig.upload(0x1a01, SWITCHES + 1), Ok(vec![5, 0, 0, 0]), "padding up to the word");
    assert_eq!(rig.upload(0x1a01, SWITCHES + 2), Ok(vec![32, 1, 0x11, 0x60]));
}

#[test]
fn process_data_are_handed_out_module_by_module() {
    let mut rig = modular(&MODULAR, 2);
    set_up(&mut rig, Channel::Outputs, 4);
    set_up(&mut rig, Channel::Inputs, 6);
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | 0x10, 0x1e), "six bytes are one module's inputs");
    assert_eq!(rig.request(PRE_OP | 0x10), (PRE_OP, 0));
    set_up(&mut rig, Channel::Inputs, 12);
    for (nth, channel, logical, bytes, direction) in
        [(0, Channel::Outputs, LOGICAL, 4, 2), (1, Channel::Inputs, LOGICAL + 4, 12, 1)]
    {
        let [low, high] = MODULAR.memory.start(channel).to_le_bytes();
        let behind = [bytes, 0, 0, 7, low, high, 0, direction, 1, 0, 0, 0];
        assert_eq!(rig.write(0x0600 + 16 * nth, &[&logical.to_le_bytes()[..], &behind].concat()), 1);
    }
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    exchange(&mut rig, [7, 7]);
    assert_eq!(rig.application().numbers, [0; 4], "outputs have no effect in SafeOp");
    assert_eq!(rig.request(OP), (OP, 0));
    exchange(&mut rig, [-42, 1337]);
    assert_eq!(rig.application().numbers, [-42, 1337, 0, 0]);
    let refused = rig.download(0x2000, 0, &[3]);
    assert_eq!(refused, Err(0x0800_0022), "modules stay as long as there are process data");
}

#[test]
fn a_pdo_of_more_entries_than_a_sub_index_can_count_is_not_miscounted() {
    let run = Mapped { index: 0x6000, sub: 1, count: 255, bits: 1 };
    let full = (0..RUNS_MAX).fold(Runs::NONE, |runs, _| runs.and(run).unwrap());
    assert!(full.and(run).is_none(), "no room");
    let pdo = Object { index: 0x1a00, name: "Full", entries: Entries::Mapping(full, PdoRules::NONE) };
    // Six runs of 255 bits.
    assert_eq!((pdo.sub_max(), pdo.pdo_bytes()), (255, 192));
    assert!(pdo.entry(255).is_some());
}
