//! The bench's Ethernet: frames in both directions are kept in memory.

use std::collections::VecDeque;

use ethercat_subdevice::eoe::{EthernetError, FRAME_BYTES_MAX, IpSettings, Link};

/// The network of the bench's application.
#[derive(Debug, Default)]
pub struct BenchLink {
    /// Frames of the MainDevice.
    pub received: Vec<Vec<u8>>,
    /// Frames for it.
    pub waiting: VecDeque<Vec<u8>>,
    /// Whether each received frame goes back.
    pub echoes: bool,
    /// The settings in force.
    pub settings: IpSettings,
    /// A result of `configure`.
    pub unfit: Option<EthernetError>,
}

impl Link for BenchLink {
    fn receive(&mut self, frame: &[u8]) {
        self.received.push(frame.to_vec());
        if self.echoes {
            self.waiting.push_back(frame.to_vec());
        }
    }

    fn transmit(&mut self, into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let frame = self.waiting.pop_front()?;
        into[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }

    fn configure(&mut self, settings: &IpSettings) -> Result<(), EthernetError> {
        if let Some(error) = self.unfit {
            return Err(error);
        }
        self.settings = settings.clone();
        Ok(())
    }

    fn settings(&mut self) -> Result<IpSettings, EthernetError> {
        Ok(self.settings.clone())
    }
}
