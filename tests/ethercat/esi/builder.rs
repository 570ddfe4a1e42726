//! An EEPROM image made from an ESI file, as configuration tools make it (ETG.2010); it shares nothing with the SubDevice's own writer.

use crate::prelude::*;

/// The image, and its strings.
pub(crate) struct Built {
    pub(crate) image: Vec<u8>,
    pub(crate) strings: Vec<String>,
}

/// `#x1a00` or a decimal number.
pub(crate) fn number(text: &str) -> u32 {
    text.strip_prefix("#x").map_or_else(|| text.parse(), |digits| u32::from_str_radix(digits, 16)).unwrap()
}

pub(crate) fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|child| child.has_tag_name(name))
}

pub(crate) fn text<'a>(node: Node<'a, 'a>, name: &str) -> &'a str {
    child(node, name).and_then(|child| child.text()).unwrap_or_default()
}

pub(crate) fn children<'a>(node: Node<'a, 'a>, name: &'a str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn hex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2).map(|pair| str::from_utf8(pair).unwrap());
    digits.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
}

fn is_set(node: Node<'_, '_>, attribute: &str) -> bool {
    matches!(node.attribute(attribute), Some("1" | "true"))
}

/// Each text once, as its number from 1 on.
#[derive(Default)]
struct Strings(Vec<String>);

impl Strings {
    fn number(&mut self, text: &str) -> u8 {
        if text.is_empty() {
            return 0;
        }
        let at = self.0.iter().position(|known| known == text).unwrap_or_else(|| {
            self.0.push(text.to_owned());
            self.0.len() - 1
        });
        u8::try_from(at + 1).expect("at most 255 strings")
    }
}

/// The code of a data type (ETG.1000.6, table 64).
fn type_code(name: &str) -> u8 {
    match name {
        "BOOL" => 0x01,
        "SINT" => 0x02,
        "INT" => 0x03,
        "DINT" => 0x04,
        "USINT" => 0x05,
        "UINT" => 0x06,
        "UDINT" => 0x07,
        "REAL" => 0x08,
        "ULINT" => 0x1b,
        _ if name.starts_with("STRING(") => 0x09,
        _ if name.starts_with("ARRAY [0..") && name.ends_with("] OF BYTE") => 0x0a,
        _ => panic!("{name} is no type that a PDO can carry"),
    }
}

/// The image that a device of `document` describes, the one behind `nth` others.
pub(crate) fn build(document: &Document<'_>, nth: usize) -> Built {
    let root = document.root_element();
    let vendor = number(text(child(root, "Vendor").unwrap(), "Id"));
    let device = root.descendants().filter(|node| node.has_tag_name("Device")).nth(nth).unwrap();
    let mut strings = Strings::default();
    let general = general(device, &mut strings);
    let fmmus: Vec<u8> = children(device, "Fmmu")
        .map(|fmmu| match fmmu.text().unwrap() {
            "Outputs" => 1,
            "Inputs" => 2,
            "MBoxState" => 3,
            other => panic!("{other}"),
        })
        .collect();
    let sync_managers: Vec<u8> = children(device, "Sm").flat_map(sync_manager).collect();
    let [inputs, outputs] = ["TxPdo", "RxPdo"]
        .map(|kind| children(device, kind).flat_map(|node| pdo(node, &mut strings)).collect::<Vec<u8>>());
    let mut listed = vec![u8::try_from(strings.0.len()).unwrap()];
    for string in &strings.0 {
        listed.push(u8::try_from(string.len()).unwrap());
        listed.extend(string.bytes());
    }
    let mut image = head(device, vendor);
    for (kind, mut content) in
        [(10_u16, listed), (30, general), (40, fmmus), (41, sync_managers), (50, inputs), (51, outputs)]
    {
        content.resize(content.len().next_multiple_of(2), 0);
        image.extend(kind.to_le_bytes());
        image.extend((content.len() as u16 / 2).to_le_bytes());
        image.extend(content);
    }
    image.extend([0xff, 0xff]);
    Built { image, strings: strings.0 }
}

fn head(device: Node<'_, '_>, vendor: u32) -> Vec<u8> {
    let mut head = vec![0; 0x80];
    let mut put = |word: usize, bytes: &[u8]| head[2 * word..2 * word + bytes.len()].copy_from_slice(bytes);
    let eeprom = child(device, "Eeprom").unwrap();
    let mut configuration = hex(text(eeprom, "ConfigData"));
    configuration.resize(14, 0);
    let check = configuration.iter().fold(0xff_u8, |check, byte| {
        (0..8).fold(check ^ byte, |check, _| if check & 0x80 != 0 { check << 1 ^ 0x07 } else { check << 1 })
    });
    put(0x00, &configuration);
    put(0x07, &[check, 0]);
    let kind = child(device, "Type").unwrap();
    let code = |name| kind.attribute(name).map_or(0, number);
    for (at, value) in
        [vendor, code("ProductCode"), code("RevisionNo"), code("SerialNo")].into_iter().enumerate()
    {
        put(8 + 2 * at, &value.to_le_bytes());
    }
    for (word, usage) in [(0x18, "MBoxOut"), (0x1a, "MBoxIn")] {
        let mailbox = children(device, "Sm").find(|node| node.text() == Some(usage)).unwrap();
        for (at, field) in ["StartAddress", "DefaultSize"].into_iter().enumerate() {
            put(word + at, &(number(mailbox.attribute(field).unwrap()) as u16).to_le_bytes());
        }
    }
    put(0x14, &hex(text(eeprom, "BootStrap")));
    let mailbox = child(device, "Mailbox").unwrap();
    let protocols = [("EoE", 2), ("CoE", 4), ("FoE", 8)];
    let offered = protocols.iter().filter(|(name, _)| child(mailbox, name).is_some());
    put(0x1c, &[offered.map(|(_, bit)| bit).sum(), 0]);
    put(0x3e, &(number(text(eeprom, "ByteSize")) as u16 / 128 - 1).to_le_bytes());
    put(0x3f, &[1, 0]);
    head
}

fn general(device: Node<'_, '_>, strings: &mut Strings) -> Vec<u8> {
    let mut general = vec![0; 32];
    let mailbox = child(device, "Mailbox").unwrap();
    let coe = child(mailbox, "CoE").unwrap();
    general[0x02] = strings.number(text(device, "Type"));
    general[0x03] = strings.number(text(device, "Name"));
    general[0x00] = strings.number(text(device, "GroupType"));
    general[0x0e] = general[0x00];
    let details =
        [("SdoInfo", 2), ("PdoAssign", 4), ("PdoConfig", 8), ("PdoUpload", 0x10), ("CompleteAccess", 0x20)];
    let offered = details.iter().filter(|(attribute, _)| is_set(coe, attribute));
    general[0x05] = 1 + offered.map(|(_, bit)| bit).sum::<u8>();
    general[0x06] = u8::from(child(mailbox, "FoE").is_some());
    general[0x07] = u8::from(child(mailbox, "EoE").is_some());
    let identified = child(device, "Info").is_some_and(|info| text(info, "IdentificationReg134") == "true");
    general[0x0b] = u8::from(is_set(mailbox, "DataLinkLayer")) << 2 | u8::from(identified) << 3;
    let physics = device.attribute("Physics").unwrap().chars().enumerate();
    let ports: u16 = physics.map(|(at, port)| u16::from(port == 'Y') << (4 * at)).sum();
    general[0x10..0x12].copy_from_slice(&ports.to_le_bytes());
    general
}

fn sync_manager(node: Node<'_, '_>) -> Vec<u8> {
    let field = |name| number(node.attribute(name).unwrap_or("0"));
    let usages = ["MBoxOut", "MBoxIn", "Outputs", "Inputs"];
    let usage = usages.iter().position(|usage| node.text() == Some(usage)).unwrap();
    let [start_low, start_high] = (field("StartAddress") as u16).to_le_bytes();
    let [size_low, size_high] = (field("DefaultSize") as u16).to_le_bytes();
    let enable = field("Enable") as u8;
    vec![start_low, start_high, size_low, size_high, field("ControlByte") as u8, 0, enable, usage as u8 + 1]
}

fn pdo(node: Node<'_, '_>, strings: &mut Strings) -> Vec<u8> {
    let entries: Vec<_> = node.children().filter(|child| child.has_tag_name("Entry")).collect();
    let [index_low, index_high] = (number(text(node, "Index")) as u16).to_le_bytes();
    let sync_manager = node.attribute("Sm").map_or(0xff, |number| number.parse().unwrap());
    let flags = u8::from(is_set(node, "Fixed")) << 4;
    let name = strings.number(text(node, "Name"));
    let mut pdo = vec![index_low, index_high, entries.len() as u8, sync_manager, 0, name, flags, 0];
    for entry in entries {
        let field = |name| number(text(entry, name));
        pdo.extend((field("Index") as u16).to_le_bytes());
        if field("Index") == 0 {
            // What fills up has nothing but a length.
            pdo.extend([0, 0, 0, field("BitLen") as u8, 0, 0]);
            continue;
        }
        let name = strings.number(text(entry, "Name"));
        let kind = type_code(text(entry, "DataType"));
        pdo.extend([field("SubIndex") as u8, name, kind, field("BitLen") as u8, 0, 0]);
    }
    pdo
}
