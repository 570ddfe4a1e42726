//! Describes a device: its identity, its memory, and its objects. All information for MainDevices comes from here.

use crate::clocks::{Offer, SYNC0_TYPE, SYNC1_TYPE};
use crate::diagnosis::Text;
use crate::foe::FileAccess;
use crate::object::{Access, Entries, Object};
use crate::sync_manager::{Channel, MemoryPlan};

/// The description of a SubDevice.
#[derive(Debug, Clone, Copy)]
pub struct Device {
    /// Vendor and product.
    pub identity: Identity,
    /// The manufacturer's name.
    pub vendor_name: &'static str,
    /// The device's name for display.
    pub name: &'static str,
    /// The order code, without spaces: MainDevices tell devices apart by it.
    pub order: &'static str,
    /// The group under which tools list it.
    pub group: &'static str,
    /// The layout of the controller's memory.
    pub memory: MemoryPlan,
    /// The controller's configuration, the SII's first eight bytes: PDI and synchronisation unit.
    pub controller: [u8; 8],
    /// Whether errors are also reported by emergency messages.
    pub emergencies: bool,
    /// Whether MainDevices read and write files, and in which states.
    pub files: FileAccess,
    /// Whether Ethernet frames pass the mailboxes, which have [42](crate::eoe::MAILBOX_BYTES_MIN) bytes or more.
    pub ethernet: bool,
    /// The texts of messages in the diagnosis history.
    pub texts: &'static [Text],
    /// The objects, sorted by index.
    pub objects: &'static [Object],
}

/// The values of the identity object, SII and ESI file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// The vendor id, assigned by the ETG.
    pub vendor: u32,
    /// The vendor's number for the product.
    pub product: u32,
    /// The product's revision.
    pub revision: u32,
    /// The device's serial number, or 0.
    pub serial: u32,
}

impl Device {
    /// The object at `index`.
    pub fn object(&self, index: u16) -> Option<&'static Object> {
        let at = self.objects.binary_search_by_key(&index, |object| object.index).ok()?;
        self.objects.get(at)
    }

    /// The PDOs of a SyncManager that the EEPROM and the ESI file describe.
    pub fn described_pdos(&self, channel: Channel) -> impl Iterator<Item = &'static Object> + use<> {
        let described =
            |object: &&Object| matches!(object.entries, Entries::Mapping(_, rules) if rules.described);
        self.objects.iter().filter(move |object| object.pdo() == Some(channel)).filter(described)
    }

    /// The PDOs that a SyncManager carries after power-on.
    pub fn default_pdos(&self, channel: Channel) -> &'static [u16] {
        match self.assignment(channel) {
            Some(Entries::Assignment(initial, _)) => initial,
            _ => &[],
        }
    }

    /// Whether a SyncManager carries the PDO `index` after power-on: a listed one, or the device's own beside those of modules.
    pub fn is_assigned(&self, channel: Channel, index: u16) -> bool {
        self.is_modular(channel) || self.default_pdos(channel).contains(&index)
    }

    /// Whether modules (F000h) determine the PDOs of a SyncManager.
    pub fn is_modular(&self, channel: Channel) -> bool {
        let open = matches!(self.assignment(channel), Some(Entries::Assignment([], access)) if !access.any(Access::WRITE));
        open && self.object(0xf000).is_some()
    }

    /// Whether the EEPROM and the ESI file mark a SyncManager as enabled: some MainDevices never activate one that is not.
    pub fn is_enabled(&self, channel: Channel) -> bool {
        self.is_modular(channel) || self.default_bytes(channel) > 0
    }

    /// Whether a MainDevice can assign PDOs.
    pub fn takes_assignments(&self) -> bool {
        [Channel::Outputs, Channel::Inputs].into_iter().any(|channel| {
            matches!(self.assignment(channel), Some(Entries::Assignment(_, access)) if access.any(Access::WRITE))
        })
    }

    fn assignment(&self, channel: Channel) -> Option<Entries> {
        self.object(0x1c10 + channel as u16).map(|object| object.entries)
    }

    /// Which SYNC signals of distributed clocks the device can follow, by 1C32h:04 and 1C33h:04.
    pub fn sync_offer(&self) -> Offer {
        let types = |index| {
            let entry = self.object(index).and_then(|object| object.entry(4));
            entry.and_then(|entry| entry.default_number()).unwrap_or(0)
        };
        let (outputs, inputs) = (types(0x1c32), types(0x1c33));
        Offer {
            sync0: outputs & inputs & u64::from(SYNC0_TYPE) != 0,
            sync1: inputs & u64::from(SYNC1_TYPE) != 0,
        }
    }

    /// Bytes of a SyncManager after power-on.
    pub fn default_bytes(&self, channel: Channel) -> u16 {
        if matches!(channel, Channel::MailboxOut | Channel::MailboxIn) {
            return self.memory.mailbox_bytes;
        }
        let pdos = self.objects.iter().filter(|object| object.pdo() == Some(channel));
        // Lossless: they fit into the controller's memory.
        pdos.filter(|pdo| self.is_assigned(channel, pdo.index)).map(|pdo| pdo.pdo_bytes() as u16).sum()
    }

    /// Most bytes of a SyncManager's process data.
    pub const fn bytes_max(&self, channel: Channel) -> u16 {
        match channel {
            Channel::MailboxOut | Channel::MailboxIn => self.memory.mailbox_bytes,
            Channel::Outputs => self.memory.outputs_bytes_max,
            Channel::Inputs => self.memory.inputs_bytes_max,
        }
    }
}
