//! The SII's strings: each once, found by its number from 1 on.

use heapless::Vec;

use crate::device::Device;
use crate::sync_manager::Channel;

/// Different texts in an image at most.
const STRINGS_MAX: usize = 64;

/// All strings of a device. The first is its type: some MainDevices take that one for its name.
pub(super) struct Strings(Vec<&'static str, STRINGS_MAX>);

impl Strings {
    /// The strings of `device`; `None` if they are too many.
    pub(super) fn of(device: &Device) -> Option<Self> {
        let mut strings = Self(Vec::new());
        for text in [device.order, device.group, device.name] {
            strings.add(text)?;
        }
        for channel in [Channel::Inputs, Channel::Outputs] {
            for pdo in device.described_pdos(channel) {
                strings.add(pdo.name)?;
                for mapped in pdo.mapped() {
                    let [_, sub, index @ ..] = mapped.to_le_bytes();
                    let object = device.object(u16::from_le_bytes(index))?;
                    strings.add(object.entry(sub)?.name)?;
                }
            }
        }
        Some(strings)
    }

    fn add(&mut self, text: &'static str) -> Option<()> {
        if text.is_empty() || self.0.contains(&text) {
            return Some(());
        }
        self.0.push(text).ok()
    }

    /// The number of a text; 0 stands for none.
    pub(super) fn index(&self, text: &str) -> u8 {
        self.0.iter().position(|&known| known == text).map_or(0, |at| at as u8 + 1)
    }

    pub(super) fn count(&self) -> u8 {
        self.0.len() as u8
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().copied()
    }
}
