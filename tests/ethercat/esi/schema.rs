//! The part of the ESI schema (ETG.2000) that the file uses: which elements and attributes stand where, how often, with what content.

use roxmltree::{Document, Node};

/// What stands in an element or attribute.
#[derive(Clone, Copy)]
enum Content {
    /// Other elements, by the rule of this name.
    Elements(&'static str),
    /// A decimal number, or `#x` and hexadecimal digits.
    HexDec,
    /// A decimal number.
    Integer,
    /// `true`, `false`, `1` or `0`.
    Bool,
    /// Pairs of hexadecimal digits.
    Hex,
    /// Some text.
    Text,
    /// One of these.
    OneOf(&'static [&'static str]),
}

use Content::{Bool, Elements, Hex, HexDec, Integer, OneOf, Text};

/// Name, content, least and greatest number.
type Child = (&'static str, Content, usize, usize);
/// Name, content, whether it is required.
type Attribute = (&'static str, Content, bool);

struct Rule {
    name: &'static str,
    attributes: &'static [Attribute],
    /// In this order.
    children: &'static [Child],
}

const MANY: usize = usize::MAX;
const PDO_ATTRIBUTES: &[Attribute] =
    &[("Fixed", Bool, false), ("Mandatory", Bool, false), ("Sm", Integer, false)];
const RESTRICTIONS: &[&str] = &["PreOP", "PreOP_SafeOP", "PreOP_OP", "SafeOP", "SafeOP_OP", "OP"];

const fn rule(name: &'static str, children: &'static [Child]) -> Rule {
    Rule { name, attributes: &[], children }
}

const RULES: &[Rule] = &[
    rule(
        "EtherCATInfo",
        &[("Vendor", Elements("Vendor"), 1, 1), ("Descriptions", Elements("Descriptions"), 1, 1)],
    ),
    rule("Vendor", &[("Id", HexDec, 1, 1), ("Name", Text, 1, MANY)]),
    rule(
        "Descriptions",
        &[
            ("Groups", Elements("Groups"), 1, 1),
            ("Devices", Elements("Devices"), 1, 1),
            ("Modules", Elements("Modules"), 0, 1),
        ],
    ),
    rule("Modules", &[("Module", Elements("Module"), 1, MANY)]),
    rule(
        "Module",
        &[
            ("Type", Text, 1, 1),
            ("Name", Text, 1, MANY),
            ("RxPdo", Elements("Pdo"), 0, MANY),
            ("TxPdo", Elements("Pdo"), 0, MANY),
            ("Mailbox", Elements("Mailbox"), 0, 1),
            ("Profile", Elements("Profile"), 0, 1),
        ],
    ),
    Rule {
        name: "Slots",
        // Attributes have no order in XML. `IdentifyModuleBy` is for tools that follow an older edition of the schema.
        attributes: &[
            ("MaxSlotCount", Integer, false),
            ("SlotPdoIncrement", HexDec, false),
            ("SlotIndexIncrement", HexDec, false),
            ("IdentifyModuleBy", OneOf(&["ModuleIdent", "ModuleTypeAndRevision"]), false),
            ("DownloadModuleIdentList", Bool, false),
        ],
        children: &[("Slot", Elements("Slot"), 1, MANY)],
    },
    Rule {
        name: "Slot",
        attributes: &[("MinInstances", Integer, true), ("MaxInstances", Integer, true)],
        children: &[("Name", Text, 0, MANY), ("ModuleClass", Elements("ModuleClass"), 0, MANY)],
    },
    rule("ModuleClass", &[("Class", Text, 1, 1), ("Name", Text, 1, MANY)]),
    rule("Groups", &[("Group", Elements("Group"), 1, MANY)]),
    rule("Group", &[("Type", Text, 1, 1), ("Name", Text, 1, MANY)]),
    rule("Devices", &[("Device", Elements("Device"), 1, MANY)]),
    Rule {
        name: "Device",
        attributes: &[("Physics", Text, true)],
        children: &[
            ("Type", Text, 1, 1),
            ("Name", Text, 1, MANY),
            ("Info", Elements("Info"), 0, 1),
            ("GroupType", Text, 1, 1),
            ("Profile", Elements("Profile"), 0, MANY),
            ("Fmmu", OneOf(&["Outputs", "Inputs", "MBoxState"]), 0, MANY),
            ("Sm", OneOf(&["MBoxOut", "MBoxIn", "Outputs", "Inputs"]), 0, MANY),
            ("RxPdo", Elements("Pdo"), 0, MANY),
            ("TxPdo", Elements("Pdo"), 0, MANY),
            ("Mailbox", Elements("Mailbox"), 0, 1),
            ("Slots", Elements("Slots"), 0, 1),
            ("Eeprom", Elements("Eeprom"), 0, 1),
        ],
    },
    rule(
        "Info",
        &[
            ("StateMachine", Elements("StateMachine"), 0, 1),
            ("Mailbox", Elements("InfoMailbox"), 0, 1),
            ("IdentificationAdo", HexDec, 0, 1),
            ("IdentificationReg134", Bool, 0, 1),
        ],
    ),
    rule(
        "Profile",
        &[
            ("ProfileNo", Integer, 0, 1),
            ("AddInfo", Integer, 0, 1),
            ("Dictionary", Elements("Dictionary"), 0, 1),
            ("DiagMessages", Elements("DiagMessages"), 0, 1),
        ],
    ),
    rule("DiagMessages", &[("DiagMessage", Elements("DiagMessage"), 1, MANY)]),
    rule("DiagMessage", &[("TextId", HexDec, 1, 1), ("MessageText", Text, 1, MANY)]),
    rule("Dictionary", &[("DataTypes", Elements("DataTypes"), 1, 1), ("Objects", Elements("Objects"), 1, 1)]),
    rule("DataTypes", &[("DataType", Elements("DataType"), 0, MANY)]),
    rule(
        "DataType",
        &[
            ("Name", Text, 1, 1),
            ("BaseType", Text, 0, 1),
            ("BitSize", Integer, 1, 1),
            ("ArrayInfo", Elements("ArrayInfo"), 0, MANY),
            ("SubItem", Elements("SubItem"), 0, MANY),
        ],
    ),
    rule("ArrayInfo", &[("LBound", Integer, 1, 1), ("Elements", Integer, 1, 1)]),
    rule(
        "SubItem",
        &[
            ("SubIdx", HexDec, 0, 1),
            ("Name", Text, 1, 1),
            ("Type", Text, 1, 1),
            ("BitSize", Integer, 1, 1),
            ("BitOffs", Integer, 1, 1),
            ("Flags", Elements("Flags"), 0, 1),
        ],
    ),
    rule("Objects", &[("Object", Elements("Object"), 0, MANY)]),
    rule(
        "Object",
        &[
            ("Index", HexDec, 1, 1),
            ("Name", Text, 1, MANY),
            ("Type", Text, 1, 1),
            ("BitSize", Integer, 1, 1),
            ("Info", Elements("ObjectInfo"), 0, 1),
            ("Flags", Elements("Flags"), 0, 1),
        ],
    ),
    rule("ObjectInfo", &[("DefaultData", Hex, 0, 1), ("SubItem", Elements("InfoItem"), 0, MANY)]),
    rule("InfoItem", &[("Name", Text, 1, 1), ("Info", Elements("ObjectInfo"), 1, 1)]),
    rule(
        "Flags",
        &[
            ("Access", OneOf(&["ro", "rw", "wo"]), 0, 1),
            ("Category", OneOf(&["m", "o", "c"]), 0, 1),
            ("PdoMapping", OneOf(&["T", "R", "TR", "RT"]), 0, 1),
        ],
    ),
    Rule {
        name: "Pdo",
        attributes: PDO_ATTRIBUTES,
        children: &[
            ("Index", HexDec, 1, 1),
            ("Name", Text, 1, MANY),
            ("Exclude", HexDec, 0, MANY),
            ("Entry", Elements("Entry"), 0, MANY),
        ],
    },
    rule(
        "Entry",
        &[
            ("Index", HexDec, 1, 1),
            ("SubIndex", HexDec, 0, 1),
            ("BitLen", Integer, 1, 1),
            ("Name", Text, 0, MANY),
            ("Comment", Text, 0, 1),
            ("DataType", Text, 0, 1),
        ],
    ),
    Rule {
        name: "Mailbox",
        attributes: &[("DataLinkLayer", Bool, false)],
        children: &[("CoE", Elements("CoE"), 0, 1)],
    },
    Rule {
        name: "CoE",
        attributes: &[
            ("SdoInfo", Bool, false),
            ("PdoAssign", Bool, false),
            ("PdoConfig", Bool, false),
            ("PdoUpload", Bool, false),
            ("CompleteAccess", Bool, false),
            ("SegmentedSdo", Bool, false),
            ("DiagHistory", Bool, false),
        ],
        children: &[("InitCmd", Elements("InitCmd"), 0, MANY)],
    },
    rule(
        "InitCmd",
        &[
            ("Transition", OneOf(&["IP", "PS", "SO", "SP", "OP", "OS"]), 1, MANY),
            ("Index", HexDec, 1, 1),
            ("SubIndex", HexDec, 1, 1),
            ("Data", Hex, 1, 1),
            ("Comment", Text, 0, 1),
        ],
    ),
    rule("Eeprom", &[("ByteSize", Integer, 1, 1), ("ConfigData", Hex, 1, 1)]),
];

/// Attributes of elements whose content is a text: those of the element of that name.
const TEXT_ATTRIBUTES: &[(&str, &[Attribute])] = &[
    (
        "Sm",
        &[
            ("MinSize", HexDec, false),
            ("MaxSize", HexDec, false),
            ("DefaultSize", HexDec, true),
            ("StartAddress", HexDec, true),
            ("ControlByte", HexDec, true),
            ("Enable", HexDec, false),
        ],
    ),
    (
        "Access",
        &[
            ("ReadRestrictions", OneOf(RESTRICTIONS), false),
            ("WriteRestrictions", OneOf(RESTRICTIONS), false),
        ],
    ),
    ("MessageText", &[("LcId", Integer, false)]),
    ("Index", &[("DependOnSlot", Bool, false)]),
];
/// Only a device's type has numbers.
const TYPE_ATTRIBUTES: &[Attribute] = &[("ProductCode", HexDec, true), ("RevisionNo", HexDec, true)];

const MODULE_TYPE_ATTRIBUTES: &[Attribute] = &[("ModuleIdent", HexDec, true), ("ModuleClass", Text, false)];

/// Whether a text is such a content.
fn fits(content: Content, text: &str) -> bool {
    let digits = |text: &str, radix| !text.is_empty() && text.chars().all(|digit| digit.is_digit(radix));
    match content {
        Elements(_) => false,
        HexDec => text.strip_prefix("#x").map_or_else(|| digits(text, 10), |hex| digits(hex, 16)),
        Integer => digits(text, 10),
        Bool => matches!(text, "true" | "false" | "0" | "1"),
        Hex => text.is_empty() || digits(text, 16) && text.len().is_multiple_of(2),
        Text => !text.trim().is_empty(),
        OneOf(words) => words.contains(&text),
    }
}

/// What is wrong with the file.
pub(crate) fn faults(document: &Document<'_>) -> Vec<String> {
    let mut faults = Vec::new();
    check(document.root_element(), Elements("EtherCATInfo"), "", &mut faults);
    faults
}

fn check(node: Node<'_, '_>, content: Content, path: &str, faults: &mut Vec<String>) {
    let name = node.tag_name().name();
    let path = format!("{path}/{name}");
    let rule = match content {
        Elements(rule) => {
            Some(RULES.iter().find(|known| known.name == rule).expect("a rule for each element"))
        }
        _ => None,
    };
    let attributes = match rule {
        Some(rule) => rule.attributes,
        None if path.ends_with("/Device/Type") => TYPE_ATTRIBUTES,
        None if path.ends_with("/Module/Type") => MODULE_TYPE_ATTRIBUTES,
        None => TEXT_ATTRIBUTES
            .iter()
            .find(|(known, _)| *known == name)
            .map_or(&[][..], |(_, attributes)| attributes),
    };
    for attribute in node.attributes() {
        let known = attributes.iter().find(|(known, ..)| *known == attribute.name());
        if !known.is_some_and(|(_, content, _)| fits(*content, attribute.value())) {
            faults.push(format!("{path}: {}=\"{}\"", attribute.name(), attribute.value()));
        }
    }
    for (missing, ..) in
        attributes.iter().filter(|(known, _, required)| *required && !node.has_attribute(*known))
    {
        faults.push(format!("{path}: no {missing}"));
    }
    let Some(rule) = rule else {
        let text = node.text().unwrap_or_default();
        if node.children().any(|child| child.is_element()) || !fits(content, text) {
            faults.push(format!("{path}: \"{text}\""));
        }
        return;
    };
    let mut children = node.children().filter(Node::is_element).peekable();
    for &(child, content, least, most) in rule.children {
        let mut count = 0;
        while let Some(node) = children.next_if(|node| node.has_tag_name(child)) {
            check(node, content, &path, faults);
            count += 1;
        }
        if count < least || count > most {
            faults.push(format!("{path}: {count} times {child}"));
        }
    }
    if let Some(unexpected) = children.next() {
        faults.push(format!("{path}: {} is not expected there", unexpected.tag_name().name()));
    }
}
