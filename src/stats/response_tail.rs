//! How long the slowest answers take: the tail of many answer times, from the largest of them, in little memory.
//!
//! The time within which 999 of 1000 answers come is hardly seen itself in some thousand measurements. But a tail that falls off
//! exponentially above a threshold is told by how far the times behind the threshold are above it on the average; the largest
//! ones keep that within bounds where the tail is another: where it ends (all that can be waited for has been seen), or where
//! a few answers are much slower than the rest.

use heapless::Vec;

/// Times that are kept: the threshold is the smallest of them.
pub const LARGEST_MAX: usize = 32;
/// Of so many answers one may be later than what is told.
const ONE_OF: u32 = 1_000;

/// The largest of many times in microseconds.
#[derive(Debug, Clone, Default)]
pub struct ResponseTail {
    /// In falling order.
    largest: Vec<u32, LARGEST_MAX>,
    count: u32,
}

impl ResponseTail {
    /// No response yet.
    pub const fn new() -> Self {
        Self { largest: Vec::new(), count: 0 }
    }

    /// How many answers there were.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// A response took so many microseconds.
    pub fn add(&mut self, took_us: u32) {
        self.count = self.count.saturating_add(1);
        let at = self.largest.partition_point(|larger| *larger >= took_us);
        if at < LARGEST_MAX {
            if self.largest.is_full() {
                self.largest.pop();
            }
            // There is room now.
            let _ = self.largest.insert(at, took_us);
        }
    }

    /// The time in microseconds within which 999 of 1000 answers come, as far as is known; `None` without answers.
    ///
    /// With 2000 answers, one standard deviation is 8 % where the tail is exponential, and much less where it ends; with fewer than
    /// 1000 it is extrapolated, and more than seen.
    pub fn p999(&self) -> Option<u32> {
        let (&threshold, &longest) = (self.largest.last()?, self.largest.first()?);
        let above: u64 = self.largest.iter().map(|time| u64::from(time - threshold)).sum();
        let kept = self.largest.len() as u64;
        let mean = above / (kept - 1).max(1);
        let fitted = u64::from(threshold) + mean * ln_milli(kept as u32 * ONE_OF, self.count) / 1_000;
        let fitted = u32::try_from(fitted).unwrap_or(u32::MAX);
        // So many may be later, and no more.
        let later = (self.count / ONE_OF) as usize;
        let least = *self.largest.get(later).unwrap_or(&threshold);
        Some(if later == 0 { fitted.max(least) } else { fitted.clamp(least, longest) })
    }
}

/// A thousand times the natural logarithm of `numerator / denominator`; 0 where that is below 1.
fn ln_milli(numerator: u32, denominator: u32) -> u64 {
    const ONE: u64 = 1 << 16;
    const FRACTION_BITS: u32 = 10;
    let ratio = u64::from(numerator) * ONE / u64::from(denominator.max(1));
    if ratio < ONE {
        return 0;
    }
    let whole = (ratio / ONE).ilog2();
    let mut rest = ratio >> whole;
    let mut log2 = u64::from(whole);
    // Each squaring gives the next bit of the fraction.
    for _ in 0..FRACTION_BITS {
        rest = rest * rest / ONE;
        log2 <<= 1;
        if rest >= 2 * ONE {
            rest /= 2;
            log2 |= 1;
        }
    }
    // ln 2 = 0.693147
    (log2 * 693_147 / 1_000) >> FRACTION_BITS
}

#[cfg(test)]
mod tests {
    use super::ln_milli;

    #[test]
    fn logarithms_are_right_to_a_few_thousandths() {
        for (ratio, ln) in
            [((1, 1), 0), ((16_000, 1_000), 2_772), ((32_000, 10_000), 1_163), ((320, 1), 5_768), ((1, 2), 0)]
        {
            let told = ln_milli(ratio.0, ratio.1);
            assert!(told.abs_diff(ln) <= 3, "{ratio:?}: {told}");
        }
    }
}
