//! The SII's strings: each once, found by its number from 1 on.

use core::fmt::{self, Display, Formatter, Write};

use heapless::{String, Vec};

use crate::device::Device;
use crate::object::{Label, PADDING};
use crate::sync_manager::Channel;

/// Different texts in an image at most.
const STRINGS_MAX: usize = 64;

/// All strings of a device. The first is its type: some MainDevices take that one for its name.
pub(super) struct Strings(Vec<Text, STRINGS_MAX>);

/// Letters of a text at most.
const LETTERS_MAX: usize = 64;

/// A text: one of the device's, or the name of an entry.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Text {
    Fixed(&'static str),
    Entry(Label),
}

impl Display for Text {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(text) => f.write_str(text),
            Self::Entry(label) => label.fmt(f),
        }
    }
}

impl Text {
    /// Its letters, in ASCII.
    pub(super) fn letters(self) -> Option<String<LETTERS_MAX>> {
        let mut letters = String::new();
        write!(letters, "{self}").ok()?;
        Some(letters)
    }
}

impl Strings {
    /// The strings of `device`; `None` if they are too many.
    pub(super) fn of(device: &Device) -> Option<Self> {
        let mut strings = Self(Vec::new());
        for text in [device.order, device.group, device.name] {
            strings.add(Text::Fixed(text))?;
        }
        for channel in [Channel::Inputs, Channel::Outputs] {
            for pdo in device.described_pdos(channel) {
                strings.add(Text::Fixed(pdo.name))?;
                for mapped in pdo.mapped() {
                    let [_, sub, index @ ..] = mapped.to_le_bytes();
                    let index = u16::from_le_bytes(index);
                    if index != PADDING {
                        strings.add(Text::Entry(device.object(index)?.entry(sub)?.label()))?;
                    }
                }
            }
        }
        Some(strings)
    }

    fn add(&mut self, text: Text) -> Option<()> {
        if text == Text::Fixed("") || self.0.contains(&text) {
            return Some(());
        }
        self.0.push(text).ok()
    }

    /// The number of a text; 0 stands for none.
    pub(super) fn index(&self, text: Text) -> u8 {
        self.0.iter().position(|&known| known == text).map_or(0, |at| at as u8 + 1)
    }

    pub(super) fn count(&self) -> u8 {
        self.0.len() as u8
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = Text> {
        self.0.iter().copied()
    }
}
