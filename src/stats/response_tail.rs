//! Estimates the 99.9th percentile of response times from the largest of them, in little memory.
//!
//! With some thousand measurements, the time within which 999 of 1000 responses arrive is barely observed itself. But for a tail
//! that decays exponentially above a threshold, it follows from the mean excess over the threshold. The largest values bound the
//! estimate for other tails: those that end (at the time-out), and those with a few responses much slower than the rest.

use heapless::Vec;

/// Values stored; the smallest of them is the threshold.
pub const LARGEST_MAX: usize = 32;
/// One response in this many may be later than the estimate.
const ONE_OF: u32 = 1_000;

/// The largest of many times, in microseconds.
#[derive(Debug, Clone, Default)]
pub struct ResponseTail {
    /// In descending order.
    largest: Vec<u32, LARGEST_MAX>,
    count: u32,
}

impl ResponseTail {
    /// Without responses.
    pub const fn new() -> Self {
        Self { largest: Vec::new(), count: 0 }
    }

    /// Number of responses.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Adds a response that took `took_us` microseconds.
    pub fn add(&mut self, took_us: u32) {
        self.count = self.count.saturating_add(1);
        let at = self.largest.partition_point(|larger| *larger >= took_us);
        if at < LARGEST_MAX {
            if self.largest.is_full() {
                self.largest.pop();
            }
            // Room was made above.
            let _ = self.largest.insert(at, took_us);
        }
    }

    /// The estimated time in microseconds within which 999 of 1000 responses arrive; `None` without responses.
    ///
    /// With 2000 responses, the standard deviation is 8 % for an exponential tail, and much less for one that ends; with fewer
    /// than 1000, the value is extrapolated beyond those observed.
    pub fn p999(&self) -> Option<u32> {
        let (&threshold, &longest) = (self.largest.last()?, self.largest.first()?);
        let above: u64 = self.largest.iter().map(|time| u64::from(time - threshold)).sum();
        let kept = self.largest.len() as u64;
        let mean = above / (kept - 1).max(1);
        let fitted = u64::from(threshold) + mean * ln_milli(kept as u32 * ONE_OF, self.count) / 1_000;
        let fitted = u32::try_from(fitted).unwrap_or(u32::MAX);
        // Number of responses that may be later.
        let later = (self.count / ONE_OF) as usize;
        let least = *self.largest.get(later).unwrap_or(&threshold);
        Some(if later == 0 { fitted.max(least) } else { fitted.clamp(least, longest) })
    }
}

/// 1000 ln(`numerator` / `denominator`); 0 if the ratio is below 1.
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
    // Each squaring yields the next bit of the fraction.
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
