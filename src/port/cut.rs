//! When the copy of an arriving frame may begin: the arithmetic of cut-through, with time as a value.
//!
//! A line that is as slow as the one that the frame arrives on, or slower, may begin at once: it never has to wait for a
//! character. A faster one begins so late that its last character is not before the last one that arrives.

use embassy_time::Instant;

use crate::config::LineSettings;

/// When the copy on `output` of a frame may begin whose first bit came on `input` at `begun`; none while that depends on
/// its length in `characters`, which is not known yet.
pub fn start(
    begun: Instant,
    input: &LineSettings,
    output: &LineSettings,
    characters: Option<usize>,
) -> Option<Instant> {
    let is_faster = bit_times(output, input) < bit_times(input, output);
    if !is_faster {
        return Some(begun);
    }
    let characters = characters?;
    Some(begun + input.chars(characters) - output.chars(characters.saturating_sub(1)))
}

/// The time of one of `line`'s characters, in a unit that it shares with that of `other`.
fn bit_times(line: &LineSettings, other: &LineSettings) -> u64 {
    u64::from(line.bits_per_char()) * u64::from(other.baud)
}
