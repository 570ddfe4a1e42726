//! Conformance: SDO information, and that everything that describes the device says the same (statements 38 to 41).

use ethercat_subdevice::object::{Access, Entry};

use crate::esi::builder::{child, number, text};
use crate::prelude::*;
use crate::sdo::category;

const INPUT: Access = Access::READ.and(Access::TX_PDO);
const OUTPUT: Access = Access::READ.and(Access::RX_PDO);

/// Asks, and puts the fragments of the response together; or the abort code.
pub(crate) fn ask<A: Application + 'static>(
    rig: &mut Rig<A>,
    operation: u8,
    data: &[u8],
) -> Result<Vec<u8>, u32> {
    assert_eq!(rig.send(&[&[0, 0x80, operation, 0, 0, 0], data].concat()), 1);
    let mut response = Vec::new();
    let mut left_before = None;
    loop {
        let message = rig.receive().expect("a response to the last fragment");
        let body = &message[8..];
        let left = u16::from_le_bytes([body[2], body[3]]);
        if body[0] == 7 {
            return Err(u32::from_le_bytes(body[4..8].try_into().unwrap()));
        }
        assert_eq!(body[0] & 0x7f, operation + 1);
        assert_eq!(body[0] & 0x80 != 0, left > 0, "incomplete as long as fragments are left");
        assert!(left_before.is_none_or(|before| left + 1 == before), "they count down");
        left_before = Some(left);
        response.extend(&body[4..]);
        if left == 0 {
            assert_eq!(rig.receive(), None, "nothing behind the last one");
            return Ok(response);
        }
    }
}

fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.as_chunks::<2>().0.iter().map(|word| u16::from_le_bytes(*word)).collect()
}

/// The objects of one of the lists.
pub(crate) fn list<A: Application + 'static>(rig: &mut Rig<A>, number: u16) -> Vec<u16> {
    let response = words(&ask(rig, 1, &number.to_le_bytes()).unwrap());
    assert_eq!(response[0], number, "the first word repeats which list it is");
    response[1..].to_vec()
}

/// An entry's description: type, bits, access, what is behind.
fn entry(rig: &mut Rig<Bench>, index: u16, sub: u8) -> Result<(u16, u16, Access, Vec<u8>), u32> {
    let [low, high] = index.to_le_bytes();
    let response = ask(rig, 5, &[low, high, sub, 0])?;
    assert_eq!(response[..4], [low, high, sub, 0]);
    let fields = words(&response[4..10]);
    Ok((fields[0], fields[1], Access(fields[2]), response[10..].to_vec()))
}

#[test]
fn statement_38_lists_and_descriptions_cover_the_same_objects() {
    let mut rig = Rig::in_state(&MAILBOX_128, PRE_OP);
    let counts = list(&mut rig, 0);
    let lists: Vec<_> = (1..=5).map(|number| list(&mut rig, number)).collect();
    assert_eq!(counts, lists.iter().map(|list| list.len() as u16).collect::<Vec<_>>());
    assert_eq!((&lists[1][..], &lists[2][..]), (&[0x3000][..], &[0x3001][..]), "what can be mapped");
    assert_eq!(lists[0], MAILBOX_128.objects.iter().map(|object| object.index).collect::<Vec<_>>());
    assert_eq!(ask(&mut rig, 1, &[6, 0]), Err(0x0601_0000));

    for &index in &lists[0] {
        let description = ask(&mut rig, 3, &index.to_le_bytes()).unwrap();
        assert_eq!(words(&description)[0], index);
        let object = MAILBOX_128.object(index).unwrap();
        assert_eq!(description[4..6], [object.sub_max(), object.code()]);
        assert_eq!(&description[6..], object.name.as_bytes());
        for sub in 0..=object.sub_max().saturating_add(1) {
            let described = entry(&mut rig, index, sub).map(drop);
            let uploaded = rig.upload(index, sub).map(drop);
            let absent = Err(0x0609_0011);
            assert_eq!(described == absent, uploaded == absent, "{index:x}:{sub}");
        }
    }
    for index in [0x0000, 0x0fff, 0x5000, 0xffff] {
        assert_eq!(ask(&mut rig, 3, &u16::to_le_bytes(index)), Err(0x0602_0000));
    }
}

#[test]
fn statement_39_long_responses_come_in_fragments() {
    for device in [&MAILBOX_34, &MAILBOX_64, &MAILBOX_128] {
        let mut rig = Rig::in_state(device, PRE_OP);
        let all = list(&mut rig, 1);
        assert!(all.is_sorted() && all.len() == device.objects.len());
    }
}

#[test]
fn statement_39_a_dictionary_of_1000_objects_is_listed_through_mailboxes_of_34_bytes() {
    let settings = (0x4000..0x43e8_u16).map(|index| match index % 4 {
        0 => Object::array(index, "Array", 3, Entry::setting("Value", DataType::U8, 0, (0, 9))),
        1 => Object::variable(index, Entry::reading("In", DataType::U8).with_access(INPUT)),
        2 => Object::variable(index, Entry::reading("Out", DataType::U8).with_access(OUTPUT)),
        _ => Object::variable(index, Entry::number("Constant", DataType::U32, 7)),
    });
    let objects: Vec<_> = MAILBOX_34.objects.iter().copied().chain(settings).collect();
    let all: Vec<_> = objects.iter().map(|object| object.index).collect();
    // A device is there for as long as it runs.
    let device: &'static Device = Box::leak(Box::new(Device { objects: objects.leak(), ..MAILBOX_34 }));
    let mut rig = Rig::in_state(device, PRE_OP);
    assert_eq!(list(&mut rig, 1), all);
    at_most("objects_not_listed", 0, &format!("of {}", all.len()), 0);
    let of = |rest: u16, own: &[u16]| {
        let ours = all.iter().copied().filter(move |index| *index >= 0x4000 && index % 4 == rest);
        own.iter().copied().chain(ours).collect::<Vec<_>>()
    };
    assert_eq!(list(&mut rig, 2), of(2, &[0x3000]));
    assert_eq!(list(&mut rig, 3), of(1, &[0x3001]));
    let settings: Vec<u16> = list(&mut rig, 5).into_iter().filter(|index| *index >= 0x4000).collect();
    assert_eq!(settings, of(0, &[]));
    let counts = list(&mut rig, 0);
    assert_eq!(counts, (1..=5).map(|number| list(&mut rig, number).len() as u16).collect::<Vec<_>>());
}

#[test]
fn statement_39_a_request_behind_a_fragmented_response_ends_it() {
    let mut rig = Rig::in_state(&MAILBOX_34, PRE_OP);
    assert_eq!(rig.send(&[0, 0x80, 1, 0, 0, 0, 1, 0]), 1);
    assert_eq!(rig.send(&[0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0]), 1);
    // The fragment that was in the mailbox already, and no other.
    let services: Vec<u8> = std::iter::from_fn(|| rig.receive()).map(|message| message[7] >> 4).collect();
    assert_eq!(services, [8, 3]);
}

#[test]
fn statement_40_sizes_and_rights_are_what_they_are_said_to_be() {
    for (bit, state) in [PRE_OP, SAFE_OP, OP].into_iter().enumerate() {
        let mut rig = Rig::in_state(&MAILBOX_128, state);
        // The values that this writes would stop Op sooner or later.
        rig.write(0x0420, &[0, 0]);
        for object in MAILBOX_128.objects {
            for sub in 0..=object.sub_max().min(6) {
                let (_, bits, access, name) = entry(&mut rig, object.index, sub).unwrap();
                assert_eq!(name, object.entry(sub).unwrap().name.as_bytes());
                let place = format!("{:x}:{sub} in state {state}", object.index);
                let read = rig.upload(object.index, sub);
                assert_eq!(read.is_ok(), access.0 >> bit & 1 != 0, "{place}");
                let value = read.unwrap_or_else(|_| vec![0; usize::from(bits) / 8]);
                assert_eq!(8 * value.len(), usize::from(bits), "{place}");
                let written = rig.download(object.index, sub, &value);
                // An assignment's order of writing is checked behind the rights.
                let allowed = !matches!(written, Err(0x0601_0002 | 0x0800_0022));
                assert_eq!(allowed, access.0 >> (3 + bit) & 1 != 0, "{place}: {written:x?}");
            }
        }
    }
}

#[test]
fn statement_40_an_entrys_default_and_bounds_are_told_when_asked_for() {
    let mut rig = Rig::in_state(&MAILBOX_128, PRE_OP);
    let all = ask(&mut rig, 5, &[0x04, 0x21, 0, 0x7f]).unwrap();
    assert_eq!(all[..10], [0x04, 0x21, 0, 0x70, 5, 0, 8, 0, 0x3f, 0x02]);
    assert_eq!(&all[10..], [&[10, 10, 20][..], b"Ten to twenty"].concat());
    let fixed = ask(&mut rig, 5, &[0x18, 0x10, 1, 0x70]).unwrap();
    assert_eq!(fixed[3], 0x10, "what cannot be written has no bounds");
    assert_eq!(fixed[10..14], 0x1234_5678u32.to_le_bytes());
    assert_eq!(ask(&mut rig, 9, &[0, 0]), Err(0x0504_0001), "no such operation");
}

fn find<'a>(document: &'a Document<'a>, name: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    document.descendants().filter(move |node| node.has_tag_name(name))
}

/// The PDOs of the file: index, SyncManager, mapped entries as the objects have them.
fn pdos_of_file(document: &Document<'_>, name: &str) -> Vec<(u16, u8, Vec<u32>)> {
    let pdo = |pdo: Node<'_, '_>| {
        let entries = pdo.children().filter(|child| child.has_tag_name("Entry"));
        let mapped = entries.map(|entry| {
            let field = |name| number(text(entry, name));
            field("Index") << 16 | field("SubIndex") << 8 | field("BitLen")
        });
        let sync_manager = pdo.attribute("Sm").map_or(0xff, |number| number.parse().unwrap());
        (number(text(pdo, "Index")) as u16, sync_manager, mapped.collect())
    };
    find(document, name).map(pdo).collect()
}

/// The same of the EEPROM.
fn pdos_of_image(mut category: &[u8]) -> Vec<(u16, u8, Vec<u32>)> {
    let mut pdos = Vec::new();
    while let Some((head, rest)) = category.split_at_checked(8) {
        let (entries, behind) = rest.split_at(8 * usize::from(head[2]));
        let mapped = entries.as_chunks::<8>().0.iter().map(|entry| {
            u32::from(u16::from_le_bytes([entry[0], entry[1]])) << 16
                | u32::from(entry[2]) << 8
                | u32::from(entry[5])
        });
        pdos.push((u16::from_le_bytes([head[0], head[1]]), head[3], mapped.collect()));
        category = behind;
    }
    pdos
}

#[test]
fn statement_41_eeprom_esi_file_and_dictionary_say_the_same() {
    let (image, file) = (sii_of(&GATEWAY), esi_of(&GATEWAY));
    let document = Document::parse(&file).unwrap();
    let mut rig = gateway_in(PRE_OP);

    for (name, number) in [("TxPdo", 50), ("RxPdo", 51)] {
        let pdos = pdos_of_file(&document, name);
        assert_eq!(pdos, pdos_of_image(category(&image, number)));
        for (index, _, mapped) in pdos {
            let mapped: Vec<u8> = mapped.into_iter().flat_map(u32::to_le_bytes).collect();
            assert_eq!(rig.upload_complete(index, 1), Ok(mapped), "{index:x}");
        }
    }
    let sync_managers = category(&image, 41).as_chunks::<8>().0;
    for (sync_manager, described) in sync_managers.iter().zip(find(&document, "Sm")) {
        let field = |name| number(described.attribute(name).unwrap()) as u16;
        assert_eq!(field("StartAddress"), u16::from_le_bytes([sync_manager[0], sync_manager[1]]));
        assert_eq!(field("DefaultSize"), u16::from_le_bytes([sync_manager[2], sync_manager[3]]));
        assert_eq!((field("ControlByte"), field("Enable")), (sync_manager[4].into(), sync_manager[6].into()));
    }
    assert_eq!(category(&image, 40), [1, 2, 3, 0], "outputs, inputs, mailbox state; made even");
}

#[test]
fn statement_41_the_files_objects_are_those_of_sdo_information() {
    let file = esi_of(&GATEWAY);
    let document = Document::parse(&file).unwrap();
    let mut rig = gateway_in(PRE_OP);
    let types: std::collections::HashMap<_, _> = find(&document, "DataTypes")
        .flat_map(|types| types.children().filter(Node::is_element))
        .map(|node| (text(node, "Name"), number(text(node, "BitSize"))))
        .collect();
    let objects: Vec<_> = find(&document, "Object").collect();
    let listed = list(&mut rig, 1);
    assert_eq!(objects.iter().map(|node| number(text(*node, "Index")) as u16).collect::<Vec<_>>(), listed);
    for (object, index) in objects.into_iter().zip(listed) {
        let description = ask(&mut rig, 3, &index.to_le_bytes()).unwrap();
        assert_eq!(text(object, "Name").as_bytes(), &description[6..]);
        assert_eq!(number(text(object, "BitSize")), types[text(object, "Type")], "{index:x}");
        // A request and its response differ in size, so nobody could tell where which value begins; and what is only written
        // has no size to be read.
        if let 0x2033 | 0x2034 = index {
            let refused = if index == 0x2033 { 0x0601_0004 } else { 0x0601_0001 };
            assert_eq!(rig.upload_complete(index, 0), Err(refused));
            continue;
        }
        // The size of a complete access from sub-index 0 on is the size of the object's type, as long as the list is full.
        let sized = if description[5] == 7 { rig.upload(index, 0) } else { rig.upload_complete(index, 0) };
        let bits = 8 * sized.unwrap().len() as u32;
        let (is_list, full) = (matches!(index, 0x1c12 | 0x1c13), types[text(object, "Type")]);
        assert!(if is_list { bits < full } else { bits == full }, "{index:x}: {bits} of {full}");
    }
}

#[test]
fn statement_41_defaults_in_the_file_are_what_is_read_after_power_on() {
    let file = esi_of(&GATEWAY);
    let document = Document::parse(&file).unwrap();
    let mut rig = gateway_in(PRE_OP);
    let mut compared = 0;
    for object in find(&document, "Object") {
        let index = number(text(object, "Index")) as u16;
        let info = child(object, "Info").unwrap();
        let items: Vec<_> = info.children().filter(|node| node.has_tag_name("SubItem")).collect();
        let of_items = items.iter().map(|item| child(*item, "Info").unwrap());
        let infos: Vec<_> = if items.is_empty() { vec![info] } else { of_items.collect() };
        let table = GATEWAY.object(index).unwrap();
        // In their order, without the sub-indices that are left out.
        let subs = (0..=table.sub_max()).filter(|sub| table.entry(*sub).is_some());
        for (sub, info) in subs.zip(infos) {
            let default = text(info, "DefaultData");
            // The time goes on.
            if index == 0x10f8 {
                continue;
            }
            if matches!((index, sub), (0x1c32 | 0x1c33, 5 | 6)) {
                assert!(child(info, "DefaultData").is_none(), "times are what the bus makes them");
                let told = ask(&mut rig, 5, &[index as u8, 0x1c, sub, 0x10]).unwrap();
                assert_eq!(told[3], 0, "no default by SDO information either");
                continue;
            }
            if matches!((index, sub), (0x2033, 1 | 5) | (0x2034, 1..)) {
                assert_eq!(rig.upload(index, sub), Err(0x0601_0001), "it is only written");
                continue;
            }
            let read = rig.upload(index, sub).unwrap();
            let hex: String = read.iter().map(|byte| format!("{byte:02X}")).collect();
            assert_eq!(hex, default, "{index:x}:{sub}");
            compared += 1;
        }
    }
    assert!(compared > 600, "{compared}");
}

#[test]
fn any_message_is_survived() {
    let mut rig = Rig::in_state(&MAILBOX_34, PRE_OP);
    let mut random = Random::new(5);
    for _ in 0..20_000 {
        let mut payload: Vec<u8> = (0..random.within(0..=28)).map(|_| random.byte()).collect();
        // Mostly services that exist.
        if let Some(service) = payload.get_mut(1) {
            *service = if random.chance(0.9) { [0x20, 0x80][random.index(2)] } else { *service };
        }
        rig.send(&payload);
        while rig.receive().is_some() {}
    }
    assert!(rig.upload(0x1000, 0).is_ok());
}

#[test]
fn the_files_names_count_from_0_as_physical_addresses_do() {
    let file = esi_of(&GATEWAY);
    let document = Document::parse(&file).unwrap();
    let names = |kind, index, name| -> Vec<String> {
        let pdo = find(&document, kind).find(|pdo| number(text(*pdo, "Index")) == index).unwrap();
        let entries = pdo.children().filter(|node| node.has_tag_name("Entry"));
        entries.map(|entry| text(entry, name).to_owned()).collect()
    };
    let comments = |kind, index| names(kind, index, "Comment");
    assert_eq!(comments("RxPdo", 0x1601)[..2], ["Output bytes 0 to 7", "Output bytes 8 to 15"]);
    assert_eq!(comments("TxPdo", 0x1a04)[0], "Input bytes 120 to 127");
    assert_eq!(names("TxPdo", 0x1a02, "Name"), ["InputCounter"]);
    assert_eq!(comments("TxPdo", 0x1a06)[31], "State 31");
}
