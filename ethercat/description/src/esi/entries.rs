//! The description of an entry, common to all parts of the ESI file: index, name, type.

use std::fmt::{self, Display, Error, Formatter, Write};

use ethercat_subdevice::object::{DataType, Entries, Entry, Object, PADDING};

use super::xml::Xml;

/// The owner of an object.
#[derive(Clone, Copy)]
pub(super) enum Place {
    /// The device: the index is absolute.
    Device,
    /// A module: the index is the one in slot 0.
    Slot,
}

impl Display for Place {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device => Ok(()),
            Self::Slot => f.write_str(" DependOnSlot=\"1\""),
        }
    }
}

/// The entries of `pdo`, among the objects that `object` returns.
pub(super) fn write_entries<W: Write>(
    xml: &mut Xml<'_, W>,
    pdo: &Object,
    whose: Place,
    object: impl Fn(u16) -> Option<Object>,
) -> Result<(), Error> {
    pdo.mapped().try_for_each(|mapped| {
        let [bits, sub, index @ ..] = mapped.to_le_bytes();
        let index = u16::from_le_bytes(index);
        if index == PADDING {
            return xml.within("Entry", format_args!(""), |xml| {
                xml.text("Index", format_args!("#x{index:04X}"))?;
                xml.text("BitLen", format_args!("{bits}"))
            });
        }
        let object = object(index).ok_or(Error)?;
        let entry = object.entry(sub).ok_or(Error)?;
        xml.within("Entry", format_args!(""), |xml| {
            xml.element("Index", format_args!("{whose}"), format_args!("#x{index:04X}"))?;
            xml.text("SubIndex", format_args!("{sub}"))?;
            xml.text("BitLen", format_args!("{bits}"))?;
            xml.text("Name", format_args!("{}", entry.label()))?;
            // The EEPROM may have no room for a name per entry; the comment then says which one it is.
            if let (Entries::Array(_, Entry { number: None, .. }), Some(place)) =
                (&object.entries, sub.checked_sub(1))
            {
                write_place(xml, entry, place)?;
            }
            xml.text("DataType", format_args!("{}", TypeName(entry.data_type)))
        })
    })
}

/// The element number of an array entry, from 0; for bytes, their range.
fn write_place<W: Write>(xml: &mut Xml<'_, W>, entry: Entry, place: u8) -> Result<(), Error> {
    match entry.data_type {
        DataType::Octets(bytes) => {
            let first = u16::from(place) * bytes;
            xml.text("Comment", format_args!("{} {first} to {}", entry.name, first + bytes - 1))
        }
        _ => xml.text("Comment", format_args!("{} {place}", entry.name)),
    }
}

/// The name of a type in the file.
pub(super) struct TypeName(pub(super) DataType);

impl Display for TypeName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            DataType::Bool => f.write_str("BOOL"),
            DataType::I16 => f.write_str("INT"),
            DataType::I32 => f.write_str("DINT"),
            DataType::I64 => f.write_str("LINT"),
            DataType::F32 => f.write_str("REAL"),
            DataType::F64 => f.write_str("LREAL"),
            DataType::U8 => f.write_str("USINT"),
            DataType::U16 => f.write_str("UINT"),
            DataType::U32 => f.write_str("UDINT"),
            DataType::U64 => f.write_str("ULINT"),
            DataType::Text(bytes) => write!(f, "STRING({bytes})"),
            DataType::Octets(bytes) | DataType::OctetsUpTo(bytes) => {
                write!(f, "ARRAY [0..{}] OF BYTE", bytes.saturating_sub(1))
            }
        }
    }
}
