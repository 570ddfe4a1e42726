//! The SII: content of the controller's EEPROM (ETG.1000.6, clause 5.4; ETG.2010), generated from the device's table.

use crc::{Algorithm, Crc};

use ethercat_subdevice::device::Device;
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::object::{Object, PADDING};
use ethercat_subdevice::sync_manager::Channel;

use strings::Strings;

mod strings;

/// Bytes of an image: a 32 KBit EEPROM, the smallest that all controllers address by two bytes.
pub const SII_BYTES: usize = 4096;
/// Where the categories start.
const CATEGORIES_START: usize = 0x80;
/// The value of an erased byte; two of them end the categories.
const ERASED: u8 = 0xff;

/// The checksum of the first seven words: x^8 + x^2 + x + 1, initial value FFh.
const CRC_8: Algorithm<u8> = Algorithm {
    width: 8,
    poly: 0x07,
    init: 0xff,
    refin: false,
    refout: false,
    xorout: 0,
    check: 0xfb,
    residue: 0,
};

/// The mailbox protocols of word 1Ch.
const COE: u16 = 0x0004;
const FOE: u16 = 0x0008;
const EOE: u16 = 0x0002;
/// FoE and EoE, in the category General.
const FOE_ENABLED: u8 = 0x01;
const EOE_ENABLED: u8 = 0x01;
const COE_SDO: u8 = 0x01;
/// The other CoE services: the ESI file's attribute, the bit here, and whether it is supported.
pub(crate) fn coe_details(device: &Device) -> [(&'static str, u8, bool); 5] {
    [
        ("SdoInfo", 0x02, true),
        ("PdoAssign", 0x04, device.takes_assignments()),
        ("PdoConfig", 0x08, false),
        ("PdoUpload", 0x10, true),
        ("CompleteAccess", 0x20, true),
    ]
}
/// The mailbox repeats messages; AL status code shows the identification.
const GENERAL_FLAGS: u8 = 0x0c;
/// Both ports are MII, one nibble each.
const PORTS: u16 = 0x0011;
/// A PDO with fixed content.
const PDO_FIXED: u16 = 0x0010;
/// The SyncManager of a PDO that is unassigned after power-on.
const NOT_ASSIGNED: u8 = 0xff;

/// Category types.
#[derive(Clone, Copy)]
#[repr(u16)]
enum Category {
    Strings = 10,
    General = 30,
    Fmmu = 40,
    SyncManager = 41,
    TxPdo = 50,
    RxPdo = 51,
}

/// The description does not fit into [`SII_BYTES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the device's description does not fit into the EEPROM's {SII_BYTES} bytes")]
pub struct SiiFull;

/// Writes the image of `device`; unused bytes read as erased.
pub fn write(device: &Device, into: &mut [u8; SII_BYTES]) -> Result<(), SiiFull> {
    into.fill(ERASED);
    let (head, categories) = into.split_first_chunk_mut::<CATEGORIES_START>().ok_or(SiiFull)?;
    *head = head_of(device);
    let strings = Strings::of(device).ok_or(SiiFull)?;
    let mut writer = Writer { bytes: categories, at: 0 };
    writer.category(Category::Strings, |writer| {
        let strings = strings.all();
        writer.put(&[strings.len() as u8])?;
        strings.iter().try_for_each(|text| {
            writer.put(&[text.len() as u8])?;
            writer.put(text.as_bytes())
        })
    })?;
    writer.category(Category::General, |writer| writer.put(&general(device, &strings)))?;
    // Outputs, inputs, and mailbox status.
    writer.category(Category::Fmmu, |writer| writer.put(&[1, 2, 3]))?;
    writer.category(Category::SyncManager, |writer| {
        Channel::ALL.into_iter().try_for_each(|channel| writer.put(&sync_manager(device, channel)))
    })?;
    for (category, channel) in [(Category::TxPdo, Channel::Inputs), (Category::RxPdo, Channel::Outputs)] {
        writer.category(category, |writer| {
            device
                .described_pdos(channel)
                .try_for_each(|pdo| write_pdo(writer, device, &strings, channel, pdo))
        })?;
    }
    Ok(())
}

/// The image's checksum, over its first 14 bytes.
pub fn check(head: &[u8; 14]) -> u8 {
    Crc::<u8>::new(&CRC_8).checksum(head)
}

/// The words before the categories.
fn head_of(device: &Device) -> [u8; CATEGORIES_START] {
    let mut head = [0; CATEGORIES_START];
    let mut put = |word: usize, bytes: &[u8]| {
        head.iter_mut().skip(2 * word).zip(bytes).for_each(|(place, &byte)| *place = byte);
    };
    let mut configuration = [0; 14];
    configuration.iter_mut().zip(device.controller).for_each(|(place, byte)| *place = byte);
    put(0x00, &configuration);
    put(0x07, &[check(&configuration), 0]);
    let identity = device.identity;
    let numbers = [identity.vendor, identity.product, identity.revision, identity.serial];
    (0..).zip(numbers).for_each(|(at, number)| put(0x08 + 2 * at, &number.to_le_bytes()));
    let mailboxes = mailboxes(device);
    if device.files == FileAccess::WithBoot {
        put(0x14, &mailboxes);
    }
    put(0x18, &mailboxes);
    let files = if device.files == FileAccess::None { 0 } else { FOE };
    let ethernet = if device.ethernet { EOE } else { 0 };
    let protocols = COE | files | ethernet;
    put(0x1c, &protocols.to_le_bytes());
    // The size in KBit minus 1, and the version of this format.
    put(0x3e, &[(SII_BYTES * 8 / 1024 - 1) as u8, 0, 1, 0]);
    head
}

/// Four words: start and bytes of both mailboxes, which are the same in Boot.
pub(crate) fn mailboxes(device: &Device) -> [u8; 8] {
    let [out_low, out_high] = device.memory.start(Channel::MailboxOut).to_le_bytes();
    let [in_low, in_high] = device.memory.start(Channel::MailboxIn).to_le_bytes();
    let [low, high] = device.memory.mailbox_bytes.to_le_bytes();
    [out_low, out_high, low, high, in_low, in_high, low, high]
}

fn general(device: &Device, strings: &Strings) -> [u8; 32] {
    let mut general = [0; 32];
    let [ports_low, ports_high] = PORTS.to_le_bytes();
    let details = coe_details(device).into_iter().filter(|(_, _, offered)| *offered);
    let details = details.fold(COE_SDO, |details, (_, bit, _)| details | bit);
    let fields = [
        (0x00, strings.index(device.group)),
        (0x02, strings.index(device.order)),
        (0x03, strings.index(device.name)),
        (0x05, details),
        (0x06, if device.files == FileAccess::None { 0 } else { FOE_ENABLED }),
        (0x07, if device.ethernet { EOE_ENABLED } else { 0 }),
        (0x0b, GENERAL_FLAGS),
        // For readers of an older format version.
        (0x0e, strings.index(device.group)),
        (0x10, ports_low),
        (0x11, ports_high),
    ];
    for (at, value) in fields {
        general[at] = value;
    }
    general
}

fn sync_manager(device: &Device, channel: Channel) -> [u8; 8] {
    let length = device.default_bytes(channel);
    let [start_low, start_high] = device.memory.start(channel).to_le_bytes();
    let [length_low, length_high] = length.to_le_bytes();
    let enable = u8::from(device.is_enabled(channel));
    [start_low, start_high, length_low, length_high, channel.control(), 0, enable, channel.purpose()]
}

fn write_pdo(
    writer: &mut Writer<'_>,
    device: &Device,
    strings: &Strings,
    channel: Channel,
    pdo: &Object,
) -> Result<(), SiiFull> {
    let assigned = device.is_assigned(channel, pdo.index);
    let sync_manager = if assigned { channel as u8 } else { NOT_ASSIGNED };
    writer.put(&pdo.index.to_le_bytes())?;
    writer.put(&[pdo.sub_max(), sync_manager, 0, strings.index(pdo.name)])?;
    writer.put(&PDO_FIXED.to_le_bytes())?;
    pdo.mapped().try_for_each(|mapped| {
        let [bits, sub, index @ ..] = mapped.to_le_bytes();
        let index = u16::from_le_bytes(index);
        if index == PADDING {
            return writer.put(&[0, 0, 0, 0, 0, bits, 0, 0]);
        }
        let entry = device.object(index).and_then(|object| object.entry(sub)).ok_or(SiiFull)?;
        writer.put(&index.to_le_bytes())?;
        writer.put(&[
            sub,
            strings.index(&entry.label().to_string()),
            entry.data_type.code() as u8,
            bits,
            0,
            0,
        ])
    })
}

/// Writes categories one after another.
struct Writer<'b> {
    bytes: &'b mut [u8],
    at: usize,
}

impl Writer<'_> {
    fn put(&mut self, bytes: &[u8]) -> Result<(), SiiFull> {
        // Leaves room for the end mark.
        let place = self.bytes.get_mut(self.at..self.at + bytes.len() + 2).ok_or(SiiFull)?;
        place.iter_mut().zip(bytes).for_each(|(place, &byte)| *place = byte);
        self.at += bytes.len();
        Ok(())
    }

    /// A category: its type, its length in words, and the output of `content`, padded to whole words.
    fn category(
        &mut self,
        category: Category,
        content: impl FnOnce(&mut Self) -> Result<(), SiiFull>,
    ) -> Result<(), SiiFull> {
        self.put(&(category as u16).to_le_bytes())?;
        let length_at = self.at;
        self.put(&[0, 0])?;
        let start = self.at;
        content(self)?;
        if !(self.at - start).is_multiple_of(2) {
            self.put(&[0])?;
        }
        let words = ((self.at - start) / 2) as u16;
        let place = self.bytes.get_mut(length_at..).unwrap_or_default();
        place.iter_mut().zip(words.to_le_bytes()).for_each(|(place, byte)| *place = byte);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn the_check_is_that_of_images_seen_elsewhere() {
        assert_eq!(check(&[0x09, 0, 0, 0x08, 0, 0, 0, 0, 0xcd, 0xab, 0, 0, 0, 0]), 0x04);
        assert_eq!(check(&[0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]), 0xe9);
    }
}
