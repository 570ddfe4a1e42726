//! A board's lights.

pub use ethercat_subdevice::indicators::Lamps;

/// The board's lights, which also show RUN and ERR of EtherCAT (ETG.1300).
pub trait Lights: Lamps {
    /// Switches all of them.
    fn all(&mut self, on: bool);

    /// Shows that every task responds, whether the network `has_address`, and whether a port `is_lost` or failed to open; what
    /// EtherCAT uses is left to it.
    fn show(&mut self, has_address: bool, is_lost: bool, ethercat: bool);
}
