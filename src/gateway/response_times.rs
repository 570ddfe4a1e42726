//! Response times: a small histogram with logarithmic classes, from which percentiles are estimated.
//!
//! Class limits grow by a factor of 2^(2/3), and percentiles are interpolated, so they are accurate to about a quarter. When a
//! class is full all are halved, so old responses fade. It takes only 20 bytes, so every unit has one.

/// Upper limits of the classes in microseconds, except the last, which has none: half a millisecond to two seconds.
const ENDS_US: [u32; CLASSES - 1] = [
    500, 794, 1_260, 2_000, 3_175, 5_040, 8_000, 12_699, 20_159, 32_000, 50_797, 80_635, 128_000, 203_187,
    322_540, 512_000, 812_749, 1_290_159, 2_048_000,
];
const CLASSES: usize = 20;

/// A histogram of response times.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ResponseTimes([u8; CLASSES]);

impl ResponseTimes {
    /// An empty histogram.
    pub const fn new() -> Self {
        Self([0; CLASSES])
    }

    /// Adds a response that took `took_us` microseconds.
    pub fn add(&mut self, took_us: u32) {
        let class = ENDS_US.partition_point(|end| *end < took_us);
        if self.0.get(class) == Some(&u8::MAX) {
            // Rounded up, so that a class in use does not vanish at once.
            self.0.iter_mut().for_each(|count| *count = count.div_ceil(2));
        }
        if let Some(count) = self.0.get_mut(class) {
            *count += 1;
        }
    }

    /// The counts by class.
    // Only the web interface shows them.
    #[cfg(feature = "web")]
    pub(crate) fn classes(&self) -> &[u8] {
        &self.0
    }

    /// The time in microseconds within which `percent` of the responses arrived, at most two seconds; `None` without responses.
    pub fn percentile(&self, percent: u32) -> Option<u32> {
        let total: u32 = self.0.iter().map(|count| u32::from(*count)).sum();
        let wanted = (total * percent).div_ceil(100).max(1);
        let mut below = 0;
        let mut start = 0;
        for (class, count) in self.0.iter().enumerate() {
            let end = ENDS_US.get(class).copied().unwrap_or(2_048_000);
            let count = u32::from(*count);
            if below + count >= wanted && count > 0 {
                let into = u64::from(end - start) * u64::from(wanted - below) / u64::from(count);
                return Some(start + into as u32);
            }
            below += count;
            start = end;
        }
        None
    }
}
