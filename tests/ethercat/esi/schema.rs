//! The part of the ESI schema (ETG.2000) that the file uses: which elements and attributes stand where, how often, with what content.

use crate::prelude::*;

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
    /// One of these, with bars between.
    OneOf(&'static str),
}

use Content::{Bool, Elements, Hex, HexDec, Integer, OneOf, Text};

/// An element or attribute: how often it may be there, and what stands in it.
struct Part {
    name: &'static str,
    least: usize,
    most: usize,
    content: Content,
}

impl Part {
    fn new(word: &'static str) -> Self {
        let (name, content) = word.split_once(':').expect("a name and a content");
        let (name, least, most) = match name.split_at(name.len() - 1) {
            (name, "?") => (name, 0, 1),
            (name, "*") => (name, 0, usize::MAX),
            (name, "+") => (name, 1, usize::MAX),
            _ => (name, 1, 1),
        };
        let content = match content {
            "HexDec" => HexDec,
            "Integer" => Integer,
            "Bool" => Bool,
            "Hex" => Hex,
            "Text" => Text,
            words => words.strip_prefix('@').map_or(OneOf(words), Elements),
        };
        Self { name, least, most, content }
    }
}

struct Rule {
    name: &'static str,
    /// Attributes have no order in XML.
    attributes: Vec<Part>,
    /// In this order.
    children: Vec<Part>,
}

/// The rules in a text like [`RULES`].
fn rules(text: &'static str) -> Vec<Rule> {
    let mut rules: Vec<Rule> = Vec::new();
    for line in text.trim().lines() {
        let mut words = line.split_whitespace();
        if !line.starts_with(' ') {
            let name = words.next().expect("a name");
            rules.push(Rule { name, attributes: Vec::new(), children: Vec::new() });
        }
        let rule = rules.last_mut().expect("the first line has a name");
        // It goes on behind its attributes, or among its children.
        let mut parts = if rule.children.is_empty() { &mut rule.attributes } else { &mut rule.children };
        for word in words {
            match word {
                "=" => parts = &mut rule.children,
                word => parts.push(Part::new(word)),
            }
        }
    }
    rules
}

/// Elements: attributes `=` other elements. `?` is none or one, `*` any number, `+` one at least; behind the colon stands the content.
/// `IdentifyModuleBy` is for tools that follow an older edition of the schema.
const RULES: &str = "
EtherCATInfo = Vendor:@Vendor Descriptions:@Descriptions
Vendor = Id:HexDec Name+:Text
Descriptions = Groups:@Groups Devices:@Devices Modules?:@Modules
Modules = Module+:@Module
Module = Type:Text Name+:Text RxPdo*:@Pdo TxPdo*:@Pdo Mailbox?:@Mailbox Profile?:@Profile
Slots MaxSlotCount?:Integer SlotPdoIncrement?:HexDec SlotIndexIncrement?:HexDec
    IdentifyModuleBy?:ModuleIdent|ModuleTypeAndRevision DownloadModuleIdentList?:Bool = Slot+:@Slot
Slot MinInstances:Integer MaxInstances:Integer = Name*:Text ModuleClass*:@ModuleClass
ModuleClass = Class:Text Name+:Text
Groups = Group+:@Group
Group = Type:Text Name+:Text
Devices = Device+:@Device
Device Physics:Text = Type:Text Name+:Text Info?:@Info GroupType:Text Profile*:@Profile
    Fmmu*:Outputs|Inputs|MBoxState Sm*:MBoxOut|MBoxIn|Outputs|Inputs RxPdo*:@Pdo TxPdo*:@Pdo
    Mailbox?:@Mailbox Dc?:@Dc Slots?:@Slots Eeprom?:@Eeprom
Info = StateMachine?:@StateMachine Mailbox?:@InfoMailbox IdentificationAdo?:HexDec
    IdentificationReg134?:Bool
Profile = ProfileNo?:Integer AddInfo?:Integer Dictionary?:@Dictionary DiagMessages?:@DiagMessages
DiagMessages = DiagMessage+:@DiagMessage
DiagMessage = TextId:HexDec MessageText+:Text
Dictionary = DataTypes:@DataTypes Objects:@Objects
DataTypes = DataType*:@DataType
DataType = Name:Text BaseType?:Text BitSize:Integer ArrayInfo*:@ArrayInfo SubItem*:@SubItem
ArrayInfo = LBound:Integer Elements:Integer
SubItem = SubIdx?:HexDec Name:Text Type:Text BitSize:Integer BitOffs:Integer Flags?:@Flags
Objects = Object*:@Object
Object = Index:HexDec Name+:Text Type:Text BitSize:Integer Info?:@ObjectInfo Flags?:@Flags
ObjectInfo = DefaultData?:Hex SubItem*:@InfoItem
InfoItem = Name:Text Info:@ObjectInfo
Flags = Access?:ro|rw|wo Category?:m|o|c PdoMapping?:T|R|TR|RT
Pdo Fixed?:Bool Mandatory?:Bool Sm?:Integer = Index:HexDec Name+:Text Exclude*:HexDec Entry*:@Entry
Entry = Index:HexDec SubIndex?:HexDec BitLen:Integer Name*:Text Comment?:Text DataType?:Text
Mailbox DataLinkLayer?:Bool = EoE?:@EoE CoE?:@CoE FoE?:@FoE
EoE IP?:Bool MAC?:Bool TimeStamp?:Bool =
CoE SdoInfo?:Bool PdoAssign?:Bool PdoConfig?:Bool PdoUpload?:Bool CompleteAccess?:Bool SegmentedSdo?:Bool
    DiagHistory?:Bool = InitCmd*:@InitCmd
InitCmd = Transition+:IP|PS|SO|SP|OP|OS Index:HexDec SubIndex:HexDec Data:Hex Comment?:Text
FoE =
Dc = OpMode*:@OpMode
OpMode = Name:Text Desc?:Text AssignActivate?:HexDec CycleTimeSync0?:Integer ShiftTimeSync0?:Integer
    CycleTimeSync1?:Integer ShiftTimeSync1?:Integer
Eeprom = ByteSize:Integer ConfigData:Hex BootStrap?:Hex
";

/// Attributes of elements whose content is a text; only a device's type has numbers.
const TEXT_ATTRIBUTES: &str = "
Sm MinSize?:HexDec MaxSize?:HexDec DefaultSize:HexDec StartAddress:HexDec ControlByte:HexDec Enable?:HexDec
Access ReadRestrictions?:PreOP|PreOP_SafeOP|PreOP_OP|SafeOP|SafeOP_OP|OP
    WriteRestrictions?:PreOP|PreOP_SafeOP|PreOP_OP|SafeOP|SafeOP_OP|OP
MessageText LcId?:Integer
Index DependOnSlot?:Bool
CycleTimeSync0 Factor?:Integer
CycleTimeSync1 Factor?:Integer
Device/Type ProductCode:HexDec RevisionNo:HexDec
Module/Type ModuleIdent:HexDec ModuleClass?:Text
";

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
        OneOf(words) => words.split('|').any(|word| word == text),
    }
}

/// What is wrong with the file.
pub(crate) fn faults(document: &Document<'_>) -> Vec<String> {
    let mut faults = Vec::new();
    let rules = [rules(RULES), rules(TEXT_ATTRIBUTES)];
    check(&rules, document.root_element(), Elements("EtherCATInfo"), "", &mut faults);
    faults
}

fn check(rules: &[Vec<Rule>; 2], node: Node<'_, '_>, content: Content, path: &str, faults: &mut Vec<String>) {
    let name = node.tag_name().name();
    let path = format!("{path}/{name}");
    let [of_elements, of_texts] = rules;
    let rule = match content {
        Elements(rule) => of_elements.iter().find(|known| known.name == rule),
        _ => None,
    };
    assert_eq!(rule.is_some(), matches!(content, Elements(_)), "a rule for each element: {path}");
    let of_text = || of_texts.iter().find(|known| path.ends_with(&format!("/{}", known.name)));
    let attributes = rule.or_else(of_text).map_or(&[][..], |rule| &rule.attributes);
    for attribute in node.attributes() {
        let known = attributes.iter().find(|known| known.name == attribute.name());
        if !known.is_some_and(|known| fits(known.content, attribute.value())) {
            faults.push(format!("{path}: {}=\"{}\"", attribute.name(), attribute.value()));
        }
    }
    for missing in attributes.iter().filter(|known| known.least > 0 && !node.has_attribute(known.name)) {
        faults.push(format!("{path}: no {}", missing.name));
    }
    let Some(rule) = rule else {
        let text = node.text().unwrap_or_default();
        if node.children().any(|child| child.is_element()) || !fits(content, text) {
            faults.push(format!("{path}: \"{text}\""));
        }
        return;
    };
    let mut children = node.children().filter(Node::is_element).peekable();
    for &Part { name: child, least, most, content } in &rule.children {
        let mut count = 0;
        while let Some(node) = children.next_if(|node| node.has_tag_name(child)) {
            check(rules, node, content, &path, faults);
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
