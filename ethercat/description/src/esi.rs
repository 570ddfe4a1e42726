//! The ESI file: the device's description in XML for configuration tools (ETG.2000), made from the device's table.
//!
//! The schema enforces the order of elements, so they are written in that order.

mod dictionary;
mod entries;
mod modules;
mod xml;

use std::fmt::{Error, Write};

use crate::sii::{SII_BYTES, SiiFull, coe_details, mailboxes, write as write_sii};
use entries::{Place, write_entries};
use ethercat_subdevice::device::Device;
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::{Channel, MAILBOX_BYTES_MIN};
use modules::NoModule;
use xml::Xml;

pub use modules::{Command, Module, Slots};

/// The profile that devices of this kind follow: the modular device profile.
const PROFILE: u16 = 5001;

/// Writes the description of `device`.
///
/// # Errors
/// If the description does not fit into an EEPROM, or `into` refuses a write.
pub fn write(device: &Device, into: &mut impl Write) -> Result<(), EsiError> {
    write_file::<NoModule>(&[(device, None)], &[], into)
}

/// Writes the description of devices of one vendor and group, some with slots, and of the `modules` that fit those slots.
///
/// # Errors
/// If a description does not fit into an EEPROM, or `into` refuses a write.
pub fn write_file<M: Module>(
    devices: &[(&Device, Option<Slots>)],
    modules: &[M],
    into: &mut impl Write,
) -> Result<(), EsiError> {
    let Some((first, _)) = devices.first() else { return Err(EsiError::Write) };
    let mut sii = [0; SII_BYTES];
    devices.iter().try_for_each(|(device, _)| write_sii(device, &mut sii))?;
    into.write_str("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n")?;
    let mut xml = Xml::new(into);
    xml.within("EtherCATInfo", format_args!(""), |xml| {
        xml.within("Vendor", format_args!(""), |xml| {
            xml.text("Id", format_args!("#x{:08X}", first.identity.vendor))?;
            xml.text("Name", format_args!("{}", first.vendor_name))
        })?;
        xml.within("Descriptions", format_args!(""), |xml| {
            xml.within("Groups", format_args!(""), |xml| {
                xml.within("Group", format_args!(""), |xml| {
                    xml.text("Type", format_args!("{}", first.group))?;
                    xml.text("Name", format_args!("{}", first.group))
                })
            })?;
            xml.within("Devices", format_args!(""), |xml| {
                devices.iter().try_for_each(|(device, slots)| {
                    xml.within("Device", format_args!(" Physics=\"YY\""), |xml| {
                        write_device(xml, device, slots.as_ref())
                    })
                })
            })?;
            match modules {
                [] => Ok(()),
                modules => xml.within("Modules", format_args!(""), |xml| {
                    modules.iter().try_for_each(|module| modules::write(xml, module))
                }),
            }
        })
    })?;
    Ok(())
}

/// Why a description could not be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EsiError {
    /// The EEPROM image, which the file contains, could not be made.
    #[error(transparent)]
    Sii(#[from] SiiFull),
    /// The writer returned an error.
    #[error("the description cannot be written")]
    Write,
}

impl From<Error> for EsiError {
    fn from(_: Error) -> Self {
        Self::Write
    }
}

fn write_device<W: Write>(xml: &mut Xml<'_, W>, device: &Device, slots: Option<&Slots>) -> Result<(), Error> {
    let identity = device.identity;
    let codes = format_args!(
        " ProductCode=\"#x{:08X}\" RevisionNo=\"#x{:08X}\"",
        identity.product, identity.revision
    );
    xml.element("Type", codes, format_args!("{}", device.order))?;
    xml.text("Name", format_args!("{}", device.name))?;
    xml.within("Info", format_args!(""), |xml| xml.text("IdentificationReg134", format_args!("true")))?;
    xml.text("GroupType", format_args!("{}", device.group))?;
    xml.within("Profile", format_args!(""), |xml| {
        xml.text("ProfileNo", format_args!("{PROFILE}"))?;
        dictionary::write(xml, device.objects, Place::Device)?;
        write_texts(xml, device)
    })?;
    for usage in ["Outputs", "Inputs", "MBoxState"] {
        xml.text("Fmmu", format_args!("{usage}"))?;
    }
    Channel::ALL.into_iter().try_for_each(|channel| write_sync_manager(xml, device, channel))?;
    for (name, channel) in [("RxPdo", Channel::Outputs), ("TxPdo", Channel::Inputs)] {
        device.described_pdos(channel).try_for_each(|pdo| write_pdo(xml, device, name, channel, pdo))?;
    }
    xml.within("Mailbox", format_args!(" DataLinkLayer=\"true\""), |xml| {
        if device.ethernet {
            // IP settings and a MAC address can be set; times are not told.
            xml.empty("EoE", format_args!(" IP=\"true\" MAC=\"true\""))?;
        }
        let has_history = device.object(0x10f3).is_some();
        let coe = format_args!("{} SegmentedSdo=\"true\" DiagHistory=\"{has_history}\"", CoeDetails(device));
        match slots.map_or(&[][..], |slots| slots.start_up) {
            [] => xml.empty("CoE", coe),
            start_up => xml.within("CoE", coe, |xml| {
                start_up.iter().try_for_each(|command| {
                    modules::write_command(xml, command, Place::Device, |index| device.object(index).copied())
                })
            }),
        }?;
        match device.files {
            FileAccess::None => Ok(()),
            FileAccess::WithoutBoot | FileAccess::WithBoot => xml.empty("FoE", format_args!("")),
        }
    })?;
    write_clocks(xml, device)?;
    slots.map_or(Ok(()), |slots| modules::write_slots(xml, slots))?;
    xml.within("Eeprom", format_args!(""), |xml| {
        xml.text("ByteSize", format_args!("{SII_BYTES}"))?;
        // The part covered by the checksum, without the alias; the tool derives the rest from this file.
        xml.text("ConfigData", format_args!("{}", xml::Hex(&device.controller)))?;
        match device.files {
            FileAccess::WithBoot => xml.text("BootStrap", format_args!("{}", xml::Hex(&mailboxes(device)))),
            FileAccess::None | FileAccess::WithoutBoot => Ok(()),
        }
    })
}

/// The elements of each signal.
const SYNC0: [&str; 2] = ["CycleTimeSync0", "ShiftTimeSync0"];
const SYNC1: [&str; 2] = ["CycleTimeSync1", "ShiftTimeSync1"];

/// The ways to synchronise: with the SyncManagers, at SYNC0, and with inputs at SYNC1.
fn write_clocks<W: Write>(xml: &mut Xml<'_, W>, device: &Device) -> Result<(), Error> {
    let offer = device.sync_offer();
    if !offer.sync0 {
        return Ok(());
    }
    xml.within("Dc", format_args!(""), |xml| {
        write_mode(xml, "SM-Synchron", "Outputs and inputs with the frames", 0, &[])?;
        write_mode(xml, "DC-Sync0", "Outputs and inputs at SYNC0", 0x0300, &[SYNC0])?;
        match offer.sync1 {
            true => {
                write_mode(xml, "DC-Sync01", "Outputs at SYNC0, inputs at SYNC1", 0x0700, &[SYNC0, SYNC1])
            }
            false => Ok(()),
        }
    })
}

/// A mode that writes `activate` into registers 0980h and 0981h, with signals in the cycle of the frames.
fn write_mode<W: Write>(
    xml: &mut Xml<'_, W>,
    name: &str,
    text: &str,
    activate: u16,
    signals: &[[&'static str; 2]],
) -> Result<(), Error> {
    xml.within("OpMode", format_args!(""), |xml| {
        xml.text("Name", format_args!("{name}"))?;
        xml.text("Desc", format_args!("{text}"))?;
        xml.text("AssignActivate", format_args!("#x{activate:04X}"))?;
        signals.iter().try_for_each(|&[cycle, shift]| {
            xml.element(cycle, format_args!(" Factor=\"1\""), format_args!("0"))?;
            xml.text(shift, format_args!("0"))
        })
    })
}

/// The texts of the diagnosis history, in English (language 1033).
fn write_texts<W: Write>(xml: &mut Xml<'_, W>, device: &Device) -> Result<(), Error> {
    if device.texts.is_empty() {
        return Ok(());
    }
    xml.within("DiagMessages", format_args!(""), |xml| {
        device.texts.iter().try_for_each(|text| {
            xml.within("DiagMessage", format_args!(""), |xml| {
                xml.text("TextId", format_args!("#x{:04X}", text.id))?;
                xml.element("MessageText", format_args!(" LcId=\"1033\""), format_args!("{}", text.text))
            })
        })
    })
}

fn write_sync_manager<W: Write>(
    xml: &mut Xml<'_, W>,
    device: &Device,
    channel: Channel,
) -> Result<(), Error> {
    let usage = match channel {
        Channel::MailboxOut => "MBoxOut",
        Channel::MailboxIn => "MBoxIn",
        Channel::Outputs => "Outputs",
        Channel::Inputs => "Inputs",
    };
    let length = device.default_bytes(channel);
    let bounds = match channel {
        Channel::MailboxOut | Channel::MailboxIn => (length.max(MAILBOX_BYTES_MIN), length),
        Channel::Outputs | Channel::Inputs => (0, device.bytes_max(channel)),
    };
    let attributes = format_args!(
        " MinSize=\"{}\" MaxSize=\"{}\" DefaultSize=\"{length}\" StartAddress=\"#x{:04X}\" ControlByte=\"#x{:02X}\" Enable=\"{}\"",
        bounds.0,
        bounds.1,
        device.memory.start(channel),
        channel.control(),
        u8::from(device.is_enabled(channel)),
    );
    xml.element("Sm", attributes, format_args!("{usage}"))
}

fn write_pdo<W: Write>(
    xml: &mut Xml<'_, W>,
    device: &Device,
    name: &'static str,
    channel: Channel,
    pdo: &Object,
) -> Result<(), Error> {
    let content = |xml: &mut Xml<'_, W>| {
        xml.text("Index", format_args!("#x{:04X}", pdo.index))?;
        xml.text("Name", format_args!("{}", pdo.name))?;
        let room = usize::from(device.bytes_max(channel)).saturating_sub(pdo.pdo_bytes());
        let excluded = |other: &&Object| pdo.excludes(other) || other.pdo_bytes() > room;
        for other in device.described_pdos(channel).filter(|other| other.index != pdo.index).filter(excluded)
        {
            xml.text("Exclude", format_args!("#x{:04X}", other.index))?;
        }
        write_entries(xml, pdo, Place::Device, |index| device.object(index).copied())
    };
    match device.is_assigned(channel, pdo.index) {
        true => xml.within(name, format_args!(" Fixed=\"1\" Sm=\"{}\"", channel as u8), content),
        false => xml.within(name, format_args!(" Fixed=\"1\""), content),
    }
}

/// The optional CoE services, as attributes.
struct CoeDetails<'d>(&'d Device);

impl std::fmt::Display for CoeDetails<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        coe_details(self.0)
            .iter()
            .try_for_each(|(attribute, _, offered)| write!(f, " {attribute}=\"{offered}\""))
    }
}
