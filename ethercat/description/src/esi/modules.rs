//! Slots and modules in the ESI file (ETG.2000): which modules fit which slots, and what a MainDevice writes at start-up.

use std::fmt::{Display, Error, Write};

use ethercat_subdevice::application::Address;
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::Channel;

use super::dictionary;
use super::entries::{Place, write_entries};
use super::xml::{Hex, Xml};

/// The slots of a device, all of one kind.
#[derive(Debug, Clone, Copy)]
pub struct Slots {
    /// Purpose of a slot.
    pub name: &'static str,
    /// The class of modules that fit.
    pub class: &'static str,
    /// Number of slots.
    pub count: u8,
    /// Index distance between the objects of adjacent slots.
    pub index_step: u16,
    /// Index distance between their PDOs.
    pub pdo_step: u16,
    /// Values written to the device at start-up.
    pub start_up: &'static [Command],
}

/// A value written on the way to SafeOp.
#[derive(Debug, Clone, Copy)]
pub struct Command {
    /// The target entry.
    pub at: Address,
    /// The value.
    pub value: u64,
}

/// A module, with the indices of slot 0.
pub trait Module {
    /// Identifies the module in F030h and F050h.
    fn ident(&self) -> u32;

    /// The class of slots that it fits.
    fn class(&self) -> &'static str;

    /// Its name for display.
    fn name(&self) -> impl Display;

    /// Its object at `index`; PDOs are those at 1600h and 1A00h.
    fn object(&self, index: u16) -> Option<Object>;

    /// All its objects except PDOs.
    fn objects(&self) -> impl Iterator<Item = Object>;

    /// Values written at start-up.
    fn start_up(&self) -> impl Iterator<Item = Command>;
}

/// The module type of a file without modules.
pub(super) enum NoModule {}

impl Module for NoModule {
    fn ident(&self) -> u32 {
        match *self {}
    }

    fn class(&self) -> &'static str {
        match *self {}
    }

    fn name(&self) -> impl Display {
        ""
    }

    fn object(&self, _index: u16) -> Option<Object> {
        match *self {}
    }

    fn objects(&self) -> impl Iterator<Item = Object> {
        std::iter::empty()
    }

    fn start_up(&self) -> impl Iterator<Item = Command> {
        std::iter::empty()
    }
}

pub(super) fn write_slots<W: Write>(xml: &mut Xml<'_, W>, slots: &Slots) -> Result<(), Error> {
    let Slots { name, class, count, index_step, pdo_step, .. } = slots;
    let attributes = format_args!(
        " MaxSlotCount=\"{count}\" SlotPdoIncrement=\"{pdo_step}\" SlotIndexIncrement=\"{index_step}\" \
         IdentifyModuleBy=\"ModuleIdent\" DownloadModuleIdentList=\"1\""
    );
    xml.within("Slots", attributes, |xml| {
        let attributes = format_args!(" MinInstances=\"0\" MaxInstances=\"{count}\"");
        xml.within("Slot", attributes, |xml| {
            xml.text("Name", format_args!("{name}"))?;
            xml.within("ModuleClass", format_args!(""), |xml| {
                xml.text("Class", format_args!("{class}"))?;
                xml.text("Name", format_args!("{name}"))
            })
        })
    })
}

pub(super) fn write<W: Write, M: Module>(xml: &mut Xml<'_, W>, module: &M) -> Result<(), Error> {
    xml.within("Module", format_args!(""), |xml| {
        let codes =
            format_args!(" ModuleIdent=\"#x{:08X}\" ModuleClass=\"{}\"", module.ident(), module.class());
        xml.element("Type", codes, format_args!("{}", module.class()))?;
        xml.text("Name", format_args!("{}", module.name()))?;
        for (name, index, channel) in
            [("RxPdo", 0x1600, Channel::Outputs), ("TxPdo", 0x1a00, Channel::Inputs)]
        {
            let Some(pdo) = module.object(index) else { continue };
            let attributes = format_args!(" Fixed=\"1\" Mandatory=\"1\" Sm=\"{}\"", channel as u8);
            xml.within(name, attributes, |xml| {
                xml.element("Index", format_args!("{}", Place::Slot), format_args!("#x{index:04X}"))?;
                xml.text("Name", format_args!("{}", pdo.name))?;
                write_entries(xml, &pdo, Place::Slot, |index| module.object(index))
            })?;
        }
        xml.within("Mailbox", format_args!(""), |xml| {
            xml.within("CoE", format_args!(""), |xml| {
                module.start_up().try_for_each(|command| {
                    write_command(xml, &command, Place::Slot, |index| module.object(index))
                })
            })
        })?;
        let objects: Vec<_> = module.objects().collect();
        xml.within("Profile", format_args!(""), |xml| dictionary::write(xml, &objects, Place::Slot))
    })
}

/// A value written at start-up, to an object that `object` returns.
pub(super) fn write_command<W: Write>(
    xml: &mut Xml<'_, W>,
    command: &Command,
    whose: Place,
    object: impl Fn(u16) -> Option<Object>,
) -> Result<(), Error> {
    let Command { at, value } = *command;
    let entry = object(at.index).and_then(|object| object.entry(at.sub)).ok_or(Error)?;
    let bytes = value.to_le_bytes();
    let bytes = bytes.get(..entry.data_type.bytes()).ok_or(Error)?;
    xml.within("InitCmd", format_args!(""), |xml| {
        xml.text("Transition", format_args!("PS"))?;
        xml.element("Index", format_args!("{whose}"), format_args!("#x{:04X}", at.index))?;
        xml.text("SubIndex", format_args!("{}", at.sub))?;
        xml.text("Data", format_args!("{}", Hex(bytes)))?;
        xml.text("Comment", format_args!("{}", entry.label()))
    })
}
