//! Random numbers that a seed repeats on every machine: SplitMix64.

use std::ops::RangeInclusive;

/// The number that the environment gives for a run of random worlds (`MOBGATE_SEED`), if any.
pub fn chosen(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().expect("a number"))
}

/// Lets the worlds of the first `count` seeds `live`; of as many as `MOBGATE_SEEDS` says, or of `MOBGATE_SEED` alone:
/// `MOBGATE_SEED=17 cargo test torture`. CI lives through thousands.
pub fn each_seed(count: u64, live: impl FnMut(u64)) {
    let seeds = match chosen("MOBGATE_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..chosen("MOBGATE_SEEDS").unwrap_or(count),
    };
    seeds.for_each(live);
}

/// A generator; equal seeds give equal sequences.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The generator of `seed`.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// A number in `range`, evenly (but for a bias below 2^-32 on the ranges used here).
    pub fn within(&mut self, range: RangeInclusive<u64>) -> u64 {
        let span = range.end() - range.start();
        match span.checked_add(1) {
            Some(count) => range.start() + self.bits() % count,
            None => self.bits(),
        }
    }

    /// A place in something of `length`, which is not 0.
    pub fn index(&mut self, length: usize) -> usize {
        self.within(0..=length as u64 - 1) as usize
    }

    /// True with `probability`, 0 to 1.
    pub fn chance(&mut self, probability: f64) -> bool {
        ((self.bits() >> 11) as f64) < probability * (1u64 << 53) as f64
    }

    /// A number above 0 with the mean 1, exponentially distributed.
    pub fn exponential(&mut self) -> f64 {
        let above_zero = ((self.bits() >> 11) + 1) as f64 / (1u64 << 53) as f64;
        -above_zero.ln()
    }

    /// A byte.
    pub fn byte(&mut self) -> u8 {
        self.bits() as u8
    }

    /// A generator of its own, whose numbers do not depend on how this one is used later.
    pub fn fork(&mut self) -> Self {
        Self(self.bits())
    }
}

/// SplitMix64's output function: every bit of the result depends on every bit of `z`.
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn the_sequence_is_the_published_one() {
        // Vigna's splitmix64.c, seed 1234567.
        let mut random = Random::new(1_234_567);
        assert_eq!(random.bits(), 6_457_827_717_110_365_317);
        assert_eq!(random.bits(), 3_203_168_211_198_807_973);
    }

    #[test]
    fn a_range_is_used_whole_and_not_left() {
        let mut random = Random::new(1);
        let mut seen = [0u32; 6];
        (0..600).for_each(|_| seen[random.within(0..=5) as usize] += 1);
        assert!(seen.iter().all(|&count| (60..140).contains(&count)), "{seen:?}");
    }

    #[test]
    fn exponential_numbers_have_their_mean_and_their_tail() {
        let mut random = Random::new(3);
        let numbers: Vec<f64> = (0..10_000).map(|_| random.exponential()).collect();
        let mean = numbers.iter().sum::<f64>() / 10_000.0;
        assert!((0.97..1.03).contains(&mean), "{mean}");
        let above = numbers.iter().filter(|number| **number > 3.0).count();
        assert!((430..570).contains(&above), "{above} of about 498");
    }

    #[test]
    fn a_chance_comes_as_often_as_it_says() {
        let mut random = Random::new(2);
        let hits = (0..10_000).filter(|_| random.chance(0.25)).count();
        assert!((2_300..2_700).contains(&hits), "{hits}");
    }
}
