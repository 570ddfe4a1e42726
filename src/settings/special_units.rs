//! The unit ids that do not belong to a device, and what they mean to a port.

/// The meaning of unit ids that do not belong to a device: 0 is the broadcast, 248 to 255 are reserved (Serial Line 2.2), and 255
/// is the TCP device itself (Messaging on TCP/IP 4.4.1.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UnitPolicy {
    /// Unit 0.
    pub broadcast: Special,
    /// Broadcast writes from TCP clients are confirmed like a write to one device.
    pub confirm: bool,
    /// Unit 255.
    pub unit_255: Special,
    /// Units 248 to 254.
    pub reserved: Special,
}

impl UnitPolicy {
    /// The meaning of `unit`.
    pub const fn of(&self, unit: u8) -> Special {
        match unit {
            0 => self.broadcast,
            248..=254 => self.reserved,
            255 => self.unit_255,
            _ => Special::Rules,
        }
    }
}

/// The meaning of a special unit id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Special {
    /// The rules decide, as for other units.
    #[default]
    Rules,
    /// No unit: 0Ah to a TCP client, silence on a serial line.
    Off,
    /// The gateway's own unit.
    Local,
    /// Replaced by this unit, for which the rules decide.
    Replace(u8),
    /// Every serial line that the rules of this port lead to; unit 0 only.
    AllLines,
}
