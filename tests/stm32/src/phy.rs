//! A PHY with its cable: the registers that every PHY has (IEEE 802.3, 22.2.4), as a LAN8742 at address 0 has them.

const CONTROL: u32 = 0;
const STATUS: u32 = 1;
/// Link up, and negotiation complete.
const UP: u16 = 1 << 2 | 1 << 5;
/// 100 and 10 Mbit/s, full and half duplex, IEEE 802.3.
const ABILITIES: u16 = 0x01e1;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Phy {
    /// It is there, and gives its clock.
    pub(crate) is_there: bool,
    /// A cable with a partner is in its socket.
    pub(crate) has_cable: bool,
    /// It never ends an access.
    pub(crate) hangs: bool,
    control: u16,
}

impl Phy {
    pub(crate) fn new(is_there: bool) -> Self {
        Self { is_there, has_cable: true, hangs: false, control: 0x3100 }
    }

    pub(crate) fn read(&self, address: u32, register: u32) -> u16 {
        if !self.is_there || address != 0 {
            return u16::MAX;
        }
        match register {
            CONTROL => self.control,
            STATUS => 0x7809 | if self.has_cable { UP } else { 0 },
            2 => 0x0007,
            3 => 0xc131,
            4 => ABILITIES,
            5 if self.has_cable => ABILITIES | 1 << 14,
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, address: u32, register: u32, value: u16) {
        /// A reset, which is over at once.
        const RESET: u16 = 1 << 15;
        if self.is_there && address == 0 && register == CONTROL {
            self.control = if value & RESET != 0 { 0x3100 } else { value };
        }
    }
}
