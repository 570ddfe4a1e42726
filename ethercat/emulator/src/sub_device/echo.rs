//! Images that carry a number and reveal tearing, and an application that echoes them.

use ethercat_subdevice::application::{Address, Application};
use ethercat_subdevice::coe::abort::Abort;

use mobgate_world::random;

use crate::bench::Shared;

/// An image of at least eight `bytes` that carries `sequence`; none of its bytes fits another image.
pub fn image(sequence: u64, bytes: usize) -> Vec<u8> {
    let words = (1..).map(|word| random::mix(sequence.wrapping_mul(31).wrapping_add(word)));
    std::iter::once(sequence).chain(words).flat_map(u64::to_le_bytes).take(bytes).collect()
}

/// The number of an image, if it is consistent.
pub fn sequence(bytes: &[u8]) -> Option<u64> {
    let number = u64::from_le_bytes(*bytes.first_chunk()?);
    (image(number, bytes.len()) == bytes).then_some(number)
}

/// Echoes outputs as inputs, and keeps statistics.
#[derive(Debug, Default)]
pub struct Echo {
    /// The number of the last outputs.
    pub last: Option<u64>,
    /// Number of images.
    pub images: u64,
    /// Torn images.
    pub torn: u64,
    /// Skipped numbers.
    pub lost: u64,
    /// Repeated images.
    pub again: u64,
    /// Images older than a previous one.
    pub old: u64,
    /// How often outputs became invalid.
    pub stops: u64,
    /// Whether outputs are valid.
    pub valid: bool,
    /// Whether outputs need two equal reads.
    pub proves: bool,
}

/// An [`Echo`] that a test can inspect.
pub type SharedEcho = Shared<Echo>;

impl Application for Echo {
    fn read(&mut self, _at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        Ok(into.len())
    }

    fn write(&mut self, _at: Address, _value: &[u8]) {}

    fn proves_outputs(&self) -> bool {
        self.proves
    }

    fn outputs(&mut self, _pdo: u16, bytes: &[u8]) {
        self.images += 1;
        let Some(number) = sequence(bytes) else {
            self.torn += 1;
            return;
        };
        match self.last {
            Some(last) if number < last => self.old += 1,
            Some(last) if number == last => self.again += 1,
            Some(last) => self.lost += number - last - 1,
            None => {}
        }
        self.last = Some(number);
        self.valid = true;
    }

    fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
        into.copy_from_slice(&image(self.last.unwrap_or(0), into.len()));
    }

    fn outputs_stopped(&mut self) {
        self.stops += 1;
        self.valid = false;
    }
}

#[cfg(test)]
mod tests {
    use super::{image, sequence};

    #[test]
    fn an_image_is_known_again_and_a_torn_one_is_not() {
        for bytes in [120, 123] {
            let (one, other) = (image(7, bytes), image(8, bytes));
            assert_eq!((one.len(), sequence(&one)), (bytes, Some(7)));
            for cut in 1..bytes {
                let torn = [&one[..cut], &other[cut..]].concat();
                assert_eq!(sequence(&torn), None, "torn at {cut}");
            }
        }
    }
}
