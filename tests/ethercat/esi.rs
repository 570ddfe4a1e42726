//! The ESI file as tools by others take it: its schema, its types, and the EEPROM image that is made from it.

pub(crate) mod builder;
mod schema;

use std::collections::BTreeMap;

use ethercat_subdevice::device::Device;
use ethercat_subdevice::{esi, sii};
use mobgate::port::ethercat::{DEVICE, LONG_DEVICE};
use roxmltree::{Document, Node};

use crate::bench::MAILBOX_128;
use crate::sdo::category;
use builder::{build, number, text};

static GATEWAY: Device = DEVICE;
static LONG_GATEWAY: Device = LONG_DEVICE;
/// The smallest EEPROM that is common.
const EEPROM_BYTES_MAX: usize = 2_048;

fn file_of(device: &Device) -> String {
    let mut file = String::new();
    esi::write(device, &mut file).unwrap();
    file
}

#[test]
fn statement_58_the_esi_file_follows_the_schema() {
    for device in [&GATEWAY, &LONG_GATEWAY, &MAILBOX_128] {
        let file = file_of(device);
        assert_eq!(schema::faults(&Document::parse(&file).unwrap()), [""; 0]);
    }
}

#[test]
fn the_schema_notices_order_missing_and_unknown_elements_and_wrong_content() {
    let file = file_of(&GATEWAY);
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
    ] {
        let spoilt = file.replacen(good, bad, 1);
        assert_ne!(spoilt, file, "{good} is there");
        assert!(!schema::faults(&Document::parse(&spoilt).unwrap()).is_empty(), "{bad}");
    }
}

#[test]
fn statement_41_each_type_is_declared_once_and_has_the_size_that_is_said_where_it_is_used() {
    for device in [&GATEWAY, &LONG_GATEWAY, &MAILBOX_128] {
        let file = file_of(device);
        let document = Document::parse(&file).unwrap();
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
                "Entry" => check(node, text(node, "DataType"), size("BitLen")),
                "DataType" if !text(node, "BaseType").is_empty() => check(node, text(node, "BaseType"), None),
                _ => {}
            }
        }
        assert!(used > 30, "{used}");
    }
}

#[test]
fn the_file_says_how_long_images_may_be_and_where_they_lie() {
    let mut file = String::new();
    esi::write_all(&GATEWAY, &[&LONG_GATEWAY], &mut file).unwrap();
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
    let types: Vec<_> = devices.iter().map(|device| text(*device, "Type")).collect();
    assert_eq!(types, ["mobgate", "mobgate-long"]);
    for (index, bytes) in [("#x1605", 476), ("#x1A08", 462)] {
        let pdo = devices[1].children().find(|node| text(*node, "Index") == index).unwrap();
        let entries = pdo.children().filter(|node| node.has_tag_name("Entry"));
        assert_eq!(entries.map(|entry| number(text(entry, "BitLen"))).sum::<u32>(), 8 * bytes, "{index}");
    }
}

/// An image's strings.
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
    for device in [&GATEWAY, &LONG_GATEWAY, &MAILBOX_128] {
        let mut own = [0; sii::SII_BYTES];
        sii::write(device, &mut own).unwrap();
        let file = file_of(device);
        let built = build(&Document::parse(&file).unwrap());
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
    let file = file_of(&GATEWAY);
    let built = build(&Document::parse(&file).unwrap());
    assert!(built.image.len() <= EEPROM_BYTES_MAX, "{} bytes", built.image.len());
    assert!(built.strings.len() <= 255, "{} strings", built.strings.len());
    let mut own = [0; sii::SII_BYTES];
    sii::write(&GATEWAY, &mut own).unwrap();
    assert_eq!(used(&own), built.image.len(), "its own has the same size");
    println!("{} bytes, {} strings", built.image.len(), built.strings.len());
    let long = build(&Document::parse(&file_of(&LONG_GATEWAY)).unwrap());
    assert!(long.image.len() <= sii::SII_BYTES && long.strings.len() <= 255);
    println!("long images: {} bytes, {} strings", long.image.len(), long.strings.len());
}
