//! The network behind Ethernet, which the application has.

use super::error::EthernetError;
use super::settings::IpSettings;

/// Most bytes of a frame: an Ethernet header and 1500 bytes, without FCS.
pub const FRAME_BYTES_MAX: usize = 1514;
/// Bytes of an Ethernet header. A shorter frame is none.
pub const FRAME_BYTES_MIN: usize = 14;
/// The network of an application. The SubDevice's task makes the calls; none of them blocks.
pub trait Link {
    /// Takes a frame of the MainDevice, or drops it where there is no room.
    fn receive(&mut self, frame: &[u8]);

    /// Writes the next frame for the MainDevice into `into`, and returns its length. `None` if there is none.
    fn transmit(&mut self, into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize>;

    /// The mailboxes start anew: what waits may be for a MainDevice of long ago.
    fn start(&mut self) {}

    /// Applies the settings that are there, or none of them.
    fn configure(&mut self, _settings: &IpSettings) -> Result<(), EthernetError> {
        Err(EthernetError::NoIpSupport)
    }

    /// The settings in force.
    fn settings(&mut self) -> Result<IpSettings, EthernetError> {
        Err(EthernetError::NoIpSupport)
    }
}
