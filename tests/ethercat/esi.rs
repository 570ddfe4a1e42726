//! The ESI file as tools by others take it: its schema, its types, and the EEPROM image that is made from it.

pub(crate) mod builder;
mod readers;
mod schema;

use std::collections::BTreeMap;

use mobgate::fieldbus::{LONG_MODULAR, MODULAR, long_device, updatable_device};
use mobgate::settings::SlaveSettings;
use mobgate_description::write_esi;

use crate::prelude::*;
use crate::sdo::category;
use builder::{build, child, number, text};

/// The smallest EEPROM that is common.
const EEPROM_BYTES_MAX: usize = 2_048;

/// The slaves of some settings: two of one form, one of many tables, and one that asks for nothing.
const SLAVES: &str = "port ecat ethercat modules
slave 0 unit 17 coil 10 count 3 discrete 0 count 10 input 100 count 4 as f32 holding 7 count 3 as i16 order 2301
slave 1 unit 18 coil 0 count 8
slave 2 unit 19 coil 32 count 8 read 50ms
slave 3 unit 20";

/// The devices of the gateway's file, in order: boards take new firmware, and the others have Ethernet.
fn devices() -> [&'static Device; 4] {
    [updatable_device(false), long_device(false, true), updatable_device(true), long_device(true, true)]
}

fn slaves() -> Vec<SlaveSettings> {
    settings_of(SLAVES).slaves.to_vec()
}

/// The gateway's file: its devices, and the modules.
fn file_of_gateway() -> String {
    let mut file = String::new();
    write_esi(&slaves(), true, &mut file).unwrap();
    file
}

#[test]
fn statement_52_ethernet_is_in_the_file_of_a_device_that_offers_it_only() {
    let with = file_of_gateway();
    assert_eq!(with.matches("<EoE IP=\"true\" MAC=\"true\"/>").count(), 2, "those with long images");
    let mut without = String::new();
    write_esi(&slaves(), false, &mut without).unwrap();
    let others: Vec<_> = with.lines().filter(|line| !line.contains("<EoE")).collect();
    assert!(others.iter().copied().eq(without.lines()), "nothing else differs");
}

#[test]
fn statement_58_the_esi_file_follows_the_schema() {
    for file in [file_of_gateway(), esi_of(&MAILBOX_128), esi_of(&FILES_128)] {
        assert_eq!(schema::faults(&Document::parse(&file).unwrap()), [""; 0]);
    }
}

#[test]
fn the_schema_notices_order_missing_and_unknown_elements_and_wrong_content() {
    let file = file_of_gateway();
    for (good, bad) in [
        ("<Vendor>", "<Vendor><Name>first</Name>"),
        ("<GroupType>Gateways</GroupType>", ""),
        ("<GroupType>", "<Kind>x</Kind><GroupType>"),
        ("<ProfileNo>5001<", "<ProfileNo>x1389<"),
        ("DataLinkLayer=\"true\"", "DataLinkLayer=\"yes\""),
        (" ControlByte=\"#x26\"", ""),
        (" SdoInfo=", " Sdoinfo="),
        ("<Access>ro<", "<Access>r<"),
        ("<DefaultData>00<", "<DefaultData>0<"),
        ("<Transition>PS<", "<Transition>PX<"),
        (" DependOnSlot=\"1\"", " DependOnSlot=\"slot\""),
        ("<ModuleClass>", "<ModuleClass><Name>first</Name>"),
        (" ModuleIdent=\"#x", " ModuleIdent=\""),
    ] {
        let spoilt = file.replacen(good, bad, 1);
        assert_ne!(spoilt, file, "{good} is there");
        assert!(!schema::faults(&Document::parse(&spoilt).unwrap()).is_empty(), "{bad}");
    }
}

#[test]
fn statement_41_each_type_is_declared_once_and_has_the_size_that_is_said_where_it_is_used() {
    let gateway = file_of_gateway();
    for (file, nth) in
        [(&gateway, 0), (&gateway, 1), (&gateway, 2), (&gateway, 3), (&esi_of(&MAILBOX_128), 0)]
    {
        let document = Document::parse(file).unwrap();
        let document = document.descendants().filter(|node| node.has_tag_name("Device")).nth(nth).unwrap();
        let mut sizes = BTreeMap::new();
        let declared = document.descendants().filter(|node| node.has_tag_name("DataType"));
        for node in declared.filter(|node| node.parent().unwrap().has_tag_name("DataTypes")) {
            let before = sizes.insert(text(node, "Name"), number(text(node, "BitSize")));
            assert_eq!(before, None, "{} is declared once", text(node, "Name"));
        }
        let mut used = 0;
        let mut check = |node: Node<'_, '_>, kind: &str, size: Option<u32>| {
            let declared = sizes.get(kind);
            assert!(declared.is_some(), "{kind} of {:?} is declared", node.range());
            assert!(size.is_none_or(|size| declared == Some(&size)), "{kind}: {size:?} bits");
            used += 1;
        };
        for node in document.descendants().filter(Node::is_element) {
            let size = |name| Some(number(text(node, name)));
            match node.tag_name().name() {
                "Object" => check(node, text(node, "Type"), size("BitSize")),
                "SubItem" if !text(node, "Type").is_empty() => {
                    check(node, text(node, "Type"), size("BitSize"))
                }
                "Entry" if text(node, "Index") == "#x0000" => {}
                "Entry" => check(node, text(node, "DataType"), size("BitLen")),
                "DataType" if !text(node, "BaseType").is_empty() => check(node, text(node, "BaseType"), None),
                _ => {}
            }
        }
        assert!(used > 20, "{used}");
    }
}

#[test]
fn the_file_says_how_long_images_may_be_and_where_they_lie() {
    let file = file_of_gateway();
    let document = Document::parse(&file).unwrap();
    assert_eq!(schema::faults(&document), [""; 0]);
    let devices: Vec<_> = document.descendants().filter(|node| node.has_tag_name("Device")).collect();
    let sizes = |device: Node<'_, '_>| -> Vec<_> {
        let managers = device.children().filter(|node| node.has_tag_name("Sm")).skip(2);
        let field = |node: Node<'_, '_>, name| number(node.attribute(name).unwrap());
        managers
            .map(|node| ["StartAddress", "DefaultSize", "MaxSize"].map(|name| field(node, name)))
            .collect()
    };
    // Beside the image, inputs may have 69 bytes that tell how good they are.
    assert_eq!(sizes(devices[0]), [[0x1100, 120, 512], [0x1700, 120, 584]]);
    assert_eq!(sizes(devices[1]), [[0x1100, 120, 1_500], [0x2298, 120, 1_555]]);
    // The modular one begins with none.
    assert_eq!(sizes(devices[3]), [[0x1100, 0, 1_500], [0x2298, 2, 1_555]]);
    let codes = devices.iter().map(|device| {
        let code = child(*device, "Type").unwrap().attribute("ProductCode").unwrap();
        (text(*device, "Type"), number(code))
    });
    let expected = [("mobgate", 1), ("mobgate-long", 3), ("mobgate-modular", 2), ("mobgate-modular-long", 4)];
    assert_eq!(codes.collect::<Vec<_>>(), expected);
    for (index, bytes) in [("#x1606", 480), ("#x1A09", 466)] {
        let pdo = devices[1].children().find(|node| text(*node, "Index") == index).unwrap();
        let entries = pdo.children().filter(|node| node.has_tag_name("Entry"));
        assert_eq!(entries.map(|entry| number(text(entry, "BitLen"))).sum::<u32>(), 8 * bytes, "{index}");
    }
}

#[test]
fn statement_63_files_and_boot_are_in_the_eeprom_and_the_file_of_a_device_that_has_them_only() {
    // Mailboxes as in PreOp: 128 bytes at 1000h and 1080h.
    let boot = [0x00, 0x10, 0x80, 0x00, 0x80, 0x10, 0x80, 0x00];
    let with_boot = sii_of(&FILES_128);
    assert_eq!((&with_boot[0x28..0x30], &with_boot[0x30..0x38]), (&boot[..], &boot[..]));
    assert_eq!((with_boot[0x38], category(&with_boot, 30)[6]), (0x0c, 1));
    let file = esi_of(&FILES_128);
    assert!(file.contains("<BootStrap>0010800080108000</BootStrap>") && file.contains("<FoE/>"), "{file}");

    static WITHOUT_BOOT: Device = Device { files: FileAccess::WithoutBoot, ..DEVICE };
    for (device, protocols) in [(&MAILBOX_128, 0x04), (&WITHOUT_BOOT, 0x0c)] {
        let (image, file) = (sii_of(device), esi_of(device));
        assert_eq!((&image[0x28..0x30], image[0x38]), (&[0; 8][..], protocols));
        assert_eq!((file.contains("BootStrap"), file.contains("FoE")), (false, protocols == 0x0c));
    }
}

fn strings(image: &[u8]) -> Vec<String> {
    let mut rest = &category(image, 10)[1..];
    let count = category(image, 10)[0];
    let mut take = || {
        let (text, behind) = rest[1..].split_at(rest[0].into());
        rest = behind;
        str::from_utf8(text).unwrap().to_owned()
    };
    (0..count).map(|_| take()).collect()
}

/// The General category and the PDOs with texts instead of their numbers, which may be others.
fn values(image: &[u8]) -> Vec<String> {
    let strings = strings(image);
    let named = |number: u8| number.checked_sub(1).map_or("", |at| strings[usize::from(at)].as_str());
    let general = category(image, 30);
    let names = [0, 1, 2, 3, 0x0e].map(|at| named(general[at]));
    let rest: Vec<_> = general.iter().enumerate().filter(|(at, _)| !matches!(at, 0..=3 | 0x0e)).collect();
    let mut values = vec![format!("{names:?} {rest:02x?}")];
    for kind in [50, 51] {
        let mut pdos = category(image, kind);
        while let Some((head, rest)) = pdos.split_at_checked(8) {
            let (entries, behind) = rest.split_at(8 * usize::from(head[2]));
            values.push(format!("{:02x?} {:?} {:02x?}", &head[..5], named(head[5]), &head[6..]));
            for entry in entries.as_chunks::<8>().0 {
                values.push(format!("{:02x?} {:?} {:02x?}", &entry[..3], named(entry[3]), &entry[4..]));
            }
            pdos = behind;
        }
    }
    values
}

/// Bytes up to the mark behind the last category.
fn used(image: &[u8]) -> usize {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    let mut at = 0x80;
    while word(at) != 0xffff {
        at += 4 + 2 * usize::from(word(at + 2));
    }
    at + 2
}

#[test]
fn statement_41_an_eeprom_image_that_others_make_from_the_file_is_the_devices_own() {
    let (gateway, small, files) = (file_of_gateway(), esi_of(&MAILBOX_128), esi_of(&FILES_128));
    let of_gateway = devices().into_iter().zip(0..).map(|(device, nth)| (device, &gateway, nth));
    for (device, file, nth) in of_gateway.chain([(&MAILBOX_128, &small, 0), (&FILES_128, &files, 0)]) {
        let own = sii_of(device);
        let built = build(&Document::parse(file).unwrap(), nth);
        // The serial number is each device's own, and no file has it.
        let head = |image: &[u8]| [&image[..0x1c], &image[0x20..0x80]].concat();
        assert_eq!(head(&built.image), head(&own));
        assert_eq!(values(&built.image), values(&own));
        for kind in [40, 41] {
            assert_eq!(category(&built.image, kind), category(&own, kind), "category {kind}");
        }
    }
}

#[test]
fn statement_58_the_gateways_image_fits_into_2048_bytes_and_255_strings() {
    let file = file_of_gateway();
    for (nth, device) in devices().into_iter().enumerate() {
        let built = build(&Document::parse(&file).unwrap(), nth);
        assert!(built.image.len() <= EEPROM_BYTES_MAX, "{} bytes", built.image.len());
        assert!(built.strings.len() <= 255, "{} strings", built.strings.len());
        let own = sii_of(device);
        assert_eq!(used(&own), built.image.len(), "its own has the same size");
        let name = device.order.replace('-', "_");
        at_most(&format!("sii_bytes_{name}"), built.image.len() as u64, "B", EEPROM_BYTES_MAX as u64);
        at_most(&format!("sii_strings_{name}"), built.strings.len() as u64, "strings", 255);
    }
}

/// The modules of the file, each with its name.
fn modules<'a>(document: &'a Document<'a>) -> Vec<(&'a str, Node<'a, 'a>)> {
    let modules = document.descendants().filter(|node| node.has_tag_name("Module"));
    modules.map(|module| (text(module, "Name"), module)).collect()
}

#[test]
fn each_slave_of_the_settings_is_a_module_beside_common_ones_with_its_start_up_list() {
    let file = file_of_gateway();
    let document = Document::parse(&file).unwrap();
    let modules = modules(&document);
    let names: Vec<_> = modules.iter().map(|(name, _)| *name).collect();
    assert_eq!(
        names[..3],
        [
            "Slave 0, unit 17: 10 discrete inputs, 3 coils, 4 REAL in input registers, 3 INT in holding registers",
            "Slave 1, unit 18: 8 coils",
            "Slave 2, unit 19: 8 coils"
        ]
    );
    for common in
        ["8 coils", "16 discrete inputs", "4 REAL in input registers", "2 UINT in holding registers"]
    {
        assert!(names.contains(&common), "{common}");
    }
    let types = modules.iter().map(|(_, module)| child(*module, "Type").unwrap());
    let mut idents: Vec<_> = types.map(|found| number(found.attribute("ModuleIdent").unwrap())).collect();
    let variants = [1, 2].map(|at| idents[at]);
    assert_eq!((variants[0] & 0xff, variants[1]), (0, variants[0] + 1), "of one form");
    idents.sort_unstable();
    idents.dedup();
    assert_eq!(idents.len(), modules.len(), "a tool tells all apart");

    let (_, first) = modules[0];
    has_its_start_up_list(first);
    has_its_objects(first);
    slots_are_of_the_modular_devices(&document);
}

fn has_its_start_up_list(module: Node<'_, '_>) {
    let commands = module.descendants().filter(|node| node.has_tag_name("InitCmd"));
    let commands: Vec<_> = commands
        .map(|command| {
            let index = child(command, "Index").unwrap();
            assert_eq!((index.text(), index.attribute("DependOnSlot")), (Some("#x8000"), Some("1")));
            (number(text(command, "SubIndex")), text(command, "Data"), text(command, "Comment"))
        })
        .collect();
    assert_eq!(commands.len(), 16);
    assert_eq!(commands[0], (1, "1100", "Id"));
    assert_eq!(commands[1], (2, "0300", "NumCoils"));
    assert_eq!(commands[5], (6, "0800", "NumInRegisters"));
    assert_eq!(commands[13], (14, "04", "TypeOfInRegisters"));
    assert_eq!(commands[15], (16, "01", "Order"));
}

fn has_its_objects(module: Node<'_, '_>) {
    let dictionary = module.descendants().find(|node| node.has_tag_name("Objects")).unwrap();
    let objects: Vec<_> = dictionary.children().filter(|node| node.has_tag_name("Object")).collect();
    let indices: Vec<_> = objects.iter().map(|object| text(*object, "Index")).collect();
    assert_eq!(
        indices,
        ["#x6000", "#x6001", "#x6002", "#x6003", "#x7000", "#x7001", "#x8000", "#x9000", "#xA000"]
    );
    for object in objects {
        assert_eq!(child(object, "Index").unwrap().attribute("DependOnSlot"), Some("1"));
    }

    let entries = module.descendants().filter(|node| node.has_tag_name("Entry"));
    let entries: Vec<_> = entries.map(|entry| (text(entry, "Name"), text(entry, "DataType"))).collect();
    assert_eq!(entries[..2], [("Coil 1", "BOOL"), ("Coil 2", "BOOL")]);
    assert!(entries.contains(&("Input register 4", "REAL")), "{entries:?}");
    assert!(entries.contains(&("Holding register 3", "INT")));
}

fn slots_are_of_the_modular_devices(document: &Document<'_>) {
    let slots = document.descendants().filter(|node| node.has_tag_name("Slots")).collect::<Vec<_>>();
    assert_eq!(slots.len(), 2, "of the modular devices");
    for (slots, modular) in slots.into_iter().zip([&MODULAR, &LONG_MODULAR]) {
        let device = slots.parent().unwrap();
        assert_eq!(text(device, "Name"), modular.name);
        let coe = child(child(device, "Mailbox").unwrap(), "CoE").unwrap();
        assert_eq!(coe.attribute("PdoAssign"), Some("false"), "modules say which PDOs there are");
        assert_eq!(text(child(coe, "InitCmd").unwrap(), "Index"), "#x2000", "so many slots are there");
    }
}
