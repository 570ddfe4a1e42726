//! Each Modbus device as a module in a slot (ETG.5001.1): its values, and their position in its PDOs.
//!
//! A table of the device is an object with an entry for each bit or value. In a PDO, bits come first and are padded to a word,
//! which aligns registers to words; numbers are little-endian, as in EtherCAT. In the image, from which requests are made,
//! registers are big-endian.

use crc::{CRC_32_ISO_HDLC, Crc};
use ethercat_subdevice::sync_manager::Channel;

use super::layout::DeviceLayout;
use crate::scanner::{Kind, ValueType, copy_bits};
use crate::settings::{Cells, SlaveSettings};

/// Index distance between the objects of adjacent slots.
pub(super) const SLOT_STEP: u16 = 0x10;

/// A table of a module in its process data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Table {
    /// The object in slot 0.
    pub(super) index: u16,
    pub(super) kind: Kind,
    /// Type of its entries.
    pub(super) value_type: ValueType,
    /// Number of values.
    pub(super) values: u16,
    /// Position of the first value in the PDO, in bits.
    pub(super) at: u32,
}

impl Table {
    /// Position after the last value, in bits.
    pub(super) fn end(&self) -> u32 {
        self.at + u32::from(self.values) * u32::from(self.value_type.bits())
    }
}

/// The tables of `slave` in its PDO of inputs or outputs, in PDO order.
pub(super) fn tables(slave: &SlaveSettings, channel: Channel) -> impl Iterator<Item = Table> {
    const INPUTS: &[(u16, Kind)] =
        &[(0x6000, Kind::Discrete), (0x6001, Kind::Coil), (0x6002, Kind::Input), (0x6003, Kind::Holding)];
    const OUTPUTS: &[(u16, Kind)] = &[(0x7000, Kind::Coil), (0x7001, Kind::Holding)];
    let objects = if channel == Channel::Outputs { OUTPUTS } else { INPUTS };
    let mut end = 0_u32;
    objects.iter().filter_map(move |&(index, kind)| {
        let (_, Cells { count, .. }) = slave.tables().find(|(other, _)| *other == kind)?;
        let value_type = slave.value_type(kind);
        let values = count / value_type.registers();
        let at = if kind.is_bits() { end } else { end.next_multiple_of(u16::BITS) };
        let table = Table { index, kind, value_type, values, at };
        (values > 0).then(|| {
            end = table.end();
            table
        })
    })
}

/// Bytes of a module's PDO: whole words.
pub(super) fn pdo_bytes(slave: &SlaveSettings, channel: Channel) -> u32 {
    let end = tables(slave, channel).last().map_or(0, |table| table.end());
    end.next_multiple_of(u16::BITS) / u8::BITS
}

/// Whether it is a module, which requires process data.
pub(super) fn is_module(slave: &SlaveSettings) -> bool {
    pdo_bytes(slave, Channel::Inputs) > 0
}

/// The bits of an ident that distinguish modules with equal process data in an ESI file. A MainDevice may expect any of those.
pub(super) const VARIANTS: u32 = 0xff;

/// Distinguishes modules with different process data: a checksum of the number and type of each table's values. 0 means no module.
pub(super) fn ident(slave: &SlaveSettings) -> u32 {
    const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
    let mut digest = CHECKSUM.digest();
    for table in tables(slave, Channel::Inputs) {
        digest.update(&[table.kind as u8, table.value_type.number()]);
        digest.update(&table.values.to_le_bytes());
    }
    match digest.finalize() & !VARIANTS {
        _ if !is_module(slave) => 0,
        // Happens for one in 16 million.
        0 => VARIANTS + 1,
        ident => ident,
    }
}

/// Writes the inputs of `slave`, located in `image` by `layout`, to its PDO.
pub(super) fn put_inputs(slave: &SlaveSettings, layout: &DeviceLayout, image: &[u8], pdo: &mut [u8]) {
    for table in tables(slave, Channel::Inputs) {
        let from = image.get(usize::from(layout.input(table.kind))..).unwrap_or_default();
        if table.kind.is_bits() {
            copy_bits(from, 0, pdo, table.at as usize, table.values.into());
        } else {
            copy_reversed(from, pdo.get_mut(table.at as usize / 8..).unwrap_or_default(), table);
        }
    }
}

/// Writes the outputs of `slave` from its PDO to `image`.
pub(super) fn take_outputs(slave: &SlaveSettings, layout: &DeviceLayout, pdo: &[u8], image: &mut [u8]) {
    for table in tables(slave, Channel::Outputs) {
        let Some(first) = layout.output(table.kind) else { continue };
        let into = image.get_mut(usize::from(first)..).unwrap_or_default();
        if table.kind.is_bits() {
            copy_bits(pdo, table.at as usize, into, 0, table.values.into());
        } else {
            copy_reversed(pdo.get(table.at as usize / 8..).unwrap_or_default(), into, table);
        }
    }
}

/// Writes value `nth` of a table, from 0; the table starts at byte `first` of `image`.
pub(super) fn put_value(table: Table, image: &[u8], first: u16, nth: u16, into: &mut [u8]) {
    let from = image.get(usize::from(first)..).unwrap_or_default();
    if table.kind.is_bits() {
        into.fill(0);
        copy_bits(from, nth.into(), into, 0, 1);
    } else {
        let from = from.get(usize::from(nth) * into.len()..).unwrap_or_default();
        copy_reversed(from, into, Table { values: 1, ..table });
    }
}

/// Copies the values of a table with reversed byte order.
fn copy_reversed(from: &[u8], into: &mut [u8], table: Table) {
    let bytes = usize::from(table.value_type.bits() / 8);
    let values = from.chunks_exact(bytes).zip(into.chunks_exact_mut(bytes)).take(table.values.into());
    values.for_each(|(from, into)| {
        into.iter_mut().zip(from.iter().rev()).for_each(|(into, from)| *into = *from)
    });
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::{
        Channel, Kind, SlaveSettings, ValueType, ident, pdo_bytes, put_inputs, tables, take_outputs,
    };
    use crate::fieldbus::layout::DeviceLayout;
    use crate::settings::Cells;

    extern crate std;

    /// 3 coils, 10 discrete inputs, 2 x f32 in input registers, 3 holding registers.
    fn mixed() -> SlaveSettings {
        let cells = [3, 10, 4, 3].map(|count| Cells { count, address: 0 });
        SlaveSettings { cells, types: [ValueType::F32, ValueType::I16], ..SlaveSettings::new(1) }
    }

    fn places(channel: Channel) -> Vec<(u16, u16, u32)> {
        tables(&mixed(), channel).map(|table| (table.index, table.values, table.at)).collect()
    }

    #[test]
    fn bits_come_first_and_words_lie_on_word_boundaries() {
        assert_eq!(
            places(Channel::Inputs),
            [(0x6000, 10, 0), (0x6001, 3, 10), (0x6002, 2, 16), (0x6003, 3, 80)]
        );
        assert_eq!(places(Channel::Outputs), [(0x7000, 3, 0), (0x7001, 3, 16)]);
        assert_eq!(pdo_bytes(&mixed(), Channel::Inputs), 16);
        assert_eq!(pdo_bytes(&mixed(), Channel::Outputs), 8);
        assert_eq!(pdo_bytes(&SlaveSettings::new(1), Channel::Inputs), 0);
    }

    #[test]
    fn modules_with_the_same_process_data_have_the_same_ident_and_others_have_not() {
        let mut other = mixed();
        (other.unit, other.polling_ms, other.cells[0].address) = (9, 7, 40);
        assert_eq!(ident(&other), ident(&mixed()), "settings are no process data");
        let mut idents = std::vec![ident(&mixed()), ident(&SlaveSettings::new(1))];
        for nth in 0..4 {
            let mut other = mixed();
            other.cells[nth].count += 2;
            idents.push(ident(&other));
        }
        for types in [[ValueType::U32, ValueType::I16], [ValueType::F32, ValueType::U16]] {
            idents.push(ident(&SlaveSettings { types, ..mixed() }));
        }
        idents.sort_unstable();
        idents.dedup();
        assert_eq!(idents.len(), 8);
        assert_eq!(idents[0], 0, "without process data there is no module");
    }

    #[cfg(feature = "long-values")] // As the types.
    #[test]
    fn values_of_four_registers_are_turned_as_a_whole_and_have_types_of_their_own() {
        use crate::scanner::LongType;

        let [whole, float] = [LongType::U64, LongType::F64].map(ValueType::Long);
        let cells = [0, 0, 8, 4].map(|count| Cells { count, address: 0 });
        let slave = SlaveSettings { cells, types: [whole, float], ..SlaveSettings::new(1) };
        let layout = DeviceLayout([0, 0, 0, 0, 16, 23, 0, 0, 0, 7]);
        let image = [
            [1, 2, 3, 4, 5, 6, 7, 8],
            [0, 0, 0, 0, 0, 0, 0, 1],
            [0xc0, 0, 0, 0, 0, 0, 0, 0], // -2.0
        ];
        let mut pdo = [0; 24];
        put_inputs(&slave, &layout, image.as_flattened(), &mut pdo);
        assert_eq!(pdo[..8], [8, 7, 6, 5, 4, 3, 2, 1]);
        assert_eq!(u64::from_le_bytes(pdo[8..16].try_into().unwrap()), 1);
        assert_eq!(f64::from_le_bytes(pdo[16..].try_into().unwrap()), -2.0);
        let mut outputs = [0; 8];
        take_outputs(&slave, &layout, &1.5_f64.to_le_bytes(), &mut outputs);
        assert_eq!(outputs, 1.5_f64.to_be_bytes());
        let mut idents =
            ValueType::NUMBERS.iter().map(|of| ident(&SlaveSettings { types: [*of; 2], ..slave }));
        let idents: std::collections::BTreeSet<_> = idents.by_ref().collect();
        assert_eq!(idents.len(), 8);
    }

    #[test]
    fn values_are_turned_from_the_images_order_into_that_of_ethercat_and_back() {
        // Coils, switches, input registers, holding registers behind each other, as the image has them.
        let layout = DeviceLayout([0, 0, 1, 3, 11, 16, 0, 0, 1, 6]);
        let image = [
            0b101,
            0b1100_0011,
            0b10, // three coils, ten discrete inputs
            0x40,
            0x20,
            0,
            0,
            0xbf,
            0x80,
            0,
            0, // 2.5f32, -1.0f32
            0x01,
            0x02,
            0xff,
            0xfe,
            0x03,
            0x04, // three registers
        ];
        let mut pdo = [0; 16];
        put_inputs(&mixed(), &layout, &image, &mut pdo);
        assert_eq!(pdo[..2], [0b1100_0011, 0b0001_0110], "ten discrete inputs, then the coils");
        assert_eq!(f32::from_le_bytes(pdo[2..6].try_into().unwrap()), 2.5);
        assert_eq!(f32::from_le_bytes(pdo[6..10].try_into().unwrap()), -1.0);
        let words: Vec<i16> =
            pdo[10..].chunks(2).map(|word| i16::from_le_bytes([word[0], word[1]])).collect();
        assert_eq!(words, [0x0102, -2, 0x0304]);

        let mut outputs = [0; 7];
        take_outputs(&mixed(), &layout, &[0b110, 0, 0x02, 0x01, 0xfe, 0xff, 0x04, 0x03], &mut outputs);
        assert_eq!(outputs, [0b110, 0x01, 0x02, 0xff, 0xfe, 0x03, 0x04]);
        assert!(matches!(tables(&mixed(), Channel::Outputs).next(), Some(table) if table.kind == Kind::Coil));
    }
}
