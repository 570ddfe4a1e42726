//! The object dictionary in the ESI file: types first, then objects.
//!
//! An object with several values has its own type, named `DT` and its index; values of one kind form an array in it.

use std::fmt::{Error, Write};

use ethercat_subdevice::object::{Access, DataType, Entries, Entry, Object, Value};

use super::entries::{Place, TypeName};
use super::xml::{Hex, Xml};

/// Bits of sub-index 0 with padding up to the first value.
const COUNT_BITS: usize = 16;

pub(super) fn write<W: Write>(xml: &mut Xml<'_, W>, objects: &[Object], whose: Place) -> Result<(), Error> {
    xml.within("Dictionary", format_args!(""), |xml| {
        xml.within("DataTypes", format_args!(""), |xml| {
            write_base_types(xml, objects)?;
            objects.iter().try_for_each(|object| write_type(xml, object))
        })?;
        xml.within("Objects", format_args!(""), |xml| {
            objects.iter().try_for_each(|object| write_object(xml, object, whose))
        })
    })
}

/// Each type in use, once, and the element type of byte arrays.
fn write_base_types<W: Write>(xml: &mut Xml<'_, W>, objects: &[Object]) -> Result<(), Error> {
    let types = || objects.iter().flat_map(types_of);
    if types().any(|data_type| matches!(data_type, DataType::Octets(_) | DataType::OctetsUpTo(_))) {
        xml.within("DataType", format_args!(""), |xml| {
            xml.text("Name", format_args!("BYTE"))?;
            xml.text("BitSize", format_args!("8"))
        })?;
    }
    for (at, data_type) in types().enumerate() {
        if types().take(at).any(|earlier| earlier == data_type) {
            continue;
        }
        xml.within("DataType", format_args!(""), |xml| {
            xml.text("Name", format_args!("{}", TypeName(data_type)))?;
            if let DataType::Octets(bytes) | DataType::OctetsUpTo(bytes) = data_type {
                xml.text("BaseType", format_args!("BYTE"))?;
                xml.text("BitSize", format_args!("{}", data_type.bits()))?;
                return xml.within("ArrayInfo", format_args!(""), |xml| {
                    xml.text("LBound", format_args!("0"))?;
                    xml.text("Elements", format_args!("{bytes}"))
                });
            }
            xml.text("BitSize", format_args!("{}", data_type.bits()))
        })?;
    }
    Ok(())
}

fn types_of(object: &Object) -> impl Iterator<Item = DataType> + '_ {
    (0..=object.sub_max()).filter_map(|sub| object.entry(sub)).map(|entry| entry.data_type)
}

/// The element of an array object.
fn element(object: &Object) -> Option<Entry> {
    match object.entries {
        Entries::Variable(_) | Entries::Record(_) => None,
        _ => object.entry(1),
    }
}

fn bits(object: &Object) -> usize {
    let bits_of = |sub| object.entry(sub).map_or(0, |entry| 8 * entry.data_type.bytes());
    match object.entries {
        Entries::Variable(entry) => entry.data_type.bits().into(),
        _ => COUNT_BITS + (1..=object.sub_max()).map(bits_of).sum::<usize>(),
    }
}

fn write_type<W: Write>(xml: &mut Xml<'_, W>, object: &Object) -> Result<(), Error> {
    if matches!(object.entries, Entries::Variable(_)) {
        return Ok(());
    }
    let (index, size) = (object.index, bits(object));
    if let Some(entry) = element(object) {
        xml.within("DataType", format_args!(""), |xml| {
            xml.text("Name", format_args!("DT{index:04X}ARR"))?;
            xml.text("BaseType", format_args!("{}", TypeName(entry.data_type)))?;
            xml.text("BitSize", format_args!("{}", size - COUNT_BITS))?;
            xml.within("ArrayInfo", format_args!(""), |xml| {
                xml.text("LBound", format_args!("1"))?;
                xml.text("Elements", format_args!("{}", object.sub_max()))
            })
        })?;
    }
    xml.within("DataType", format_args!(""), |xml| {
        xml.text("Name", format_args!("DT{index:04X}"))?;
        xml.text("BitSize", format_args!("{size}"))?;
        write_sub_items(xml, object)
    })
}

fn write_sub_items<W: Write>(xml: &mut Xml<'_, W>, object: &Object) -> Result<(), Error> {
    let mut offset = 0;
    let subs = if element(object).is_some() { 0 } else { object.sub_max() };
    for (sub, entry) in (0..=subs).filter_map(|sub| Some((sub, object.entry(sub)?))) {
        xml.within("SubItem", format_args!(""), |xml| {
            xml.text("SubIdx", format_args!("{sub}"))?;
            xml.text("Name", format_args!("{}", entry.label()))?;
            xml.text("Type", format_args!("{}", TypeName(entry.data_type)))?;
            xml.text("BitSize", format_args!("{}", entry.data_type.bits()))?;
            xml.text("BitOffs", format_args!("{offset}"))?;
            write_flags(xml, entry.access)
        })?;
        offset += if sub == 0 { COUNT_BITS } else { 8 * entry.data_type.bytes() };
    }
    let Some(entry) = element(object) else { return Ok(()) };
    xml.within("SubItem", format_args!(""), |xml| {
        xml.text("Name", format_args!("Elements"))?;
        xml.text("Type", format_args!("DT{:04X}ARR", object.index))?;
        xml.text("BitSize", format_args!("{}", bits(object) - COUNT_BITS))?;
        xml.text("BitOffs", format_args!("{COUNT_BITS}"))?;
        write_flags(xml, entry.access)
    })
}

fn write_object<W: Write>(xml: &mut Xml<'_, W>, object: &Object, whose: Place) -> Result<(), Error> {
    xml.within("Object", format_args!(""), |xml| {
        xml.element("Index", format_args!("{whose}"), format_args!("#x{:04X}", object.index))?;
        xml.text("Name", format_args!("{}", object.name))?;
        if let Entries::Variable(entry) = object.entries {
            xml.text("Type", format_args!("{}", TypeName(entry.data_type)))?;
            xml.text("BitSize", format_args!("{}", entry.data_type.bits()))?;
            xml.within("Info", format_args!(""), |xml| write_default(xml, entry))?;
            return write_flags(xml, entry.access);
        }
        xml.text("Type", format_args!("DT{:04X}", object.index))?;
        xml.text("BitSize", format_args!("{}", bits(object)))?;
        xml.within("Info", format_args!(""), |xml| {
            (0..=object.sub_max()).filter_map(|sub| object.entry(sub)).try_for_each(|entry| {
                xml.within("SubItem", format_args!(""), |xml| {
                    xml.text("Name", format_args!("{}", entry.label()))?;
                    xml.within("Info", format_args!(""), |xml| write_default(xml, entry))
                })
            })
        })?;
        write_flags(xml, Access::READ)
    })
}

/// The value after power-on, as the bytes that a read returns.
fn write_default<W: Write>(xml: &mut Xml<'_, W>, entry: Entry) -> Result<(), Error> {
    match (entry.default_number(), entry.value) {
        (Some(number), _) => {
            let bytes = number.to_le_bytes();
            let used = bytes.get(..entry.data_type.bytes()).unwrap_or_default();
            xml.text("DefaultData", format_args!("{}", Hex(used)))
        }
        (None, Value::Computed) => Ok(()),
        (None, Value::Text(text)) => xml.text("DefaultData", format_args!("{}", Hex(text.as_bytes()))),
        // Empty, or all zeros.
        (None, _) if matches!(entry.data_type, DataType::OctetsUpTo(_)) => {
            xml.text("DefaultData", format_args!(""))
        }
        (None, _) => {
            let digits = 2 * entry.data_type.bytes();
            xml.text("DefaultData", format_args!("{:0>digits$}", ""))
        }
    }
}

fn write_flags<W: Write>(xml: &mut Xml<'_, W>, access: Access) -> Result<(), Error> {
    let rights = match (access.any(Access::READ), access.any(Access::WRITE)) {
        (true, true) => "rw",
        (false, true) => "wo",
        _ => "ro",
    };
    xml.within("Flags", format_args!(""), |xml| {
        match access.0 & Access::WRITE.0 {
            0 | 0x0038 => xml.text("Access", format_args!("{rights}"))?,
            _ => {
                xml.element("Access", format_args!(" WriteRestrictions=\"PreOP\""), format_args!("{rights}"))?
            }
        }
        match (access.any(Access::RX_PDO), access.any(Access::TX_PDO)) {
            (true, _) => xml.text("PdoMapping", format_args!("R")),
            (_, true) => xml.text("PdoMapping", format_args!("T")),
            _ => Ok(()),
        }
    })
}
