//! The SII's strings: each stored once, numbered from 1.

use ethercat_subdevice::device::Device;
use ethercat_subdevice::object::PADDING;
use ethercat_subdevice::sync_manager::Channel;

/// All strings of a device. The type comes first: some MainDevices take the first string for the name.
pub(super) struct Strings(Vec<String>);

impl Strings {
    /// The strings of `device`; `None` if there are too many, or one is too long.
    pub(super) fn of(device: &Device) -> Option<Self> {
        let mut strings = Self(Vec::new());
        for text in [device.order, device.group, device.name] {
            strings.add(text.to_owned());
        }
        for pdo in [Channel::Inputs, Channel::Outputs].into_iter().flat_map(|of| device.described_pdos(of)) {
            strings.add(pdo.name.to_owned());
            for mapped in pdo.mapped() {
                let [_, sub, index @ ..] = mapped.to_le_bytes();
                let index = u16::from_le_bytes(index);
                if index != PADDING {
                    strings.add(device.object(index)?.entry(sub)?.label().to_string());
                }
            }
        }
        let fits = |text: &String| u8::try_from(text.len()).is_ok();
        (strings.0.len() <= u8::MAX.into() && strings.0.iter().all(fits)).then_some(strings)
    }

    fn add(&mut self, text: String) {
        if !text.is_empty() && !self.0.contains(&text) {
            self.0.push(text);
        }
    }

    /// The number of a text; 0 means none.
    pub(super) fn index(&self, text: &str) -> u8 {
        self.0.iter().position(|known| known == text).map_or(0, |at| at as u8 + 1)
    }

    pub(super) fn all(&self) -> &[String] {
        &self.0
    }
}
