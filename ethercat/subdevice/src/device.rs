//! What a device is: its identity, its memory, and its objects. Everything that a MainDevice is told comes from here.

use crate::diagnosis::Text;
use crate::object::{Access, Entries, Object};
use crate::sync_manager::{Channel, MemoryPlan};

/// A SubDevice, described.
#[derive(Debug, Clone, Copy)]
pub struct Device {
    /// Who made which device.
    pub identity: Identity,
    /// The manufacturer's name.
    pub vendor_name: &'static str,
    /// The device's name, for people.
    pub name: &'static str,
    /// The type, without spaces: by it MainDevices tell devices apart.
    pub order: &'static str,
    /// The group it is listed in.
    pub group: &'static str,
    /// How the controller's memory is shared out.
    pub memory: MemoryPlan,
    /// The controller's configuration, the SII's first eight bytes: PDI and synchronisation unit.
    pub controller: [u8; 8],
    /// Whether errors are also reported by emergency messages.
    pub emergencies: bool,
    /// The texts of messages in the diagnosis history.
    pub texts: &'static [Text],
    /// The objects, sorted by index.
    pub objects: &'static [Object],
}

/// The identity object's values, which also stand in the SII and in the ESI file.
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

    /// Whether a SyncManager carries the PDO `index` after power-on: one that is listed, or its own beside those of modules.
    pub fn is_assigned(&self, channel: Channel, index: u16) -> bool {
        self.is_modular(channel) || self.default_pdos(channel).contains(&index)
    }

    /// Whether modules (F000h) say which PDOs a SyncManager carries.
    pub fn is_modular(&self, channel: Channel) -> bool {
        let open = matches!(self.assignment(channel), Some(Entries::Assignment([], access)) if !access.any(Access::WRITE));
        open && self.object(0xf000).is_some()
    }

    /// Whether a SyncManager is used, as the EEPROM and the ESI file say it: some MainDevices never switch on one that is not.
    pub fn is_enabled(&self, channel: Channel) -> bool {
        self.is_modular(channel) || self.default_bytes(channel) > 0
    }

    /// Whether a MainDevice can say which PDOs a SyncManager carries.
    pub fn takes_assignments(&self) -> bool {
        [Channel::Outputs, Channel::Inputs].into_iter().any(|channel| {
            matches!(self.assignment(channel), Some(Entries::Assignment(_, access)) if access.any(Access::WRITE))
        })
    }

    fn assignment(&self, channel: Channel) -> Option<Entries> {
        self.object(0x1c10 + channel as u16).map(|object| object.entries)
    }

    /// A SyncManager's bytes after power-on.
    pub fn default_bytes(&self, channel: Channel) -> u16 {
        if matches!(channel, Channel::MailboxOut | Channel::MailboxIn) {
            return self.memory.mailbox_bytes;
        }
        let pdos = self.objects.iter().filter(|object| object.pdo() == Some(channel));
        // They are not longer than the controller's memory.
        pdos.filter(|pdo| self.is_assigned(channel, pdo.index)).map(|pdo| pdo.pdo_bytes() as u16).sum()
    }

    /// The most bytes of a SyncManager's process data.
    pub const fn bytes_max(&self, channel: Channel) -> u16 {
        match channel {
            Channel::MailboxOut | Channel::MailboxIn => self.memory.mailbox_bytes,
            Channel::Outputs => self.memory.outputs_bytes_max,
            Channel::Inputs => self.memory.inputs_bytes_max,
        }
    }
}
