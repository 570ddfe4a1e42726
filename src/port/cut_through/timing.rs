//! When the copy of an arriving frame may begin: the arithmetic of cut-through, with time as a value.
//!
//! A frame of unit, function and data, `N` bytes together, takes `N + 2` characters in RTU and `2 N + 5` in ASCII. Its copy
//! can begin when its unit is there, which takes `r` characters: 1 of RTU, 3 of ASCII. And it must not end before the
//! frame is known to be good: `h` of its characters are held back until the frame has come to its end. So, with `Li` and
//! `Lo` characters of the times `ti` and `to` on the line where it arrives and the one where its copy leaves,
//!
//! ```text
//! start = max(r ti, Li ti - (Lo - h) to)          from the frame's first bit to its copy's
//! leg   = max(r ti + Lo to, Li ti + h to)         to the copy's last bit
//! ```
//!
//! | from | to | `r` | `h` | held back |
//! | --- | --- | --- | --- | --- |
//! | RTU | RTU | 1 | 1 | the second half of the CRC |
//! | RTU | ASCII | 1 | 4 | LRC, carriage return and line feed: the LRC is known when the CRC has proved good |
//! | ASCII | RTU | 3 | 1 | the second half of the CRC: the first one is known when the LRC has proved good |
//! | ASCII | ASCII | 3 | 2 | carriage return and line feed |
//!
//! Between these ends, no character of such a copy has to wait for one that arrives. Where a byte takes at least as
//! long to leave as to come, the copy of a long frame may begin no later than that of the shortest one, so that the length need
//! not be known.

use embassy_time::{Duration, Instant, TICK_HZ};

use crate::settings::Lane;

/// Unit and function code.
const BYTES_MIN: usize = 2;

/// When a frame whose first bit arrived on `input` at `begun` may start on `output`. `bytes` is its length without the check, if
/// known; none if the start depends on a length not known yet.
pub fn start(begun: Instant, input: &Lane, output: &Lane, bytes: Option<usize>) -> Option<Instant> {
    // Time of one more byte.
    let more = |lane: &Lane, other| lane.time(lane.characters(1) - lane.characters(0), other);
    let keeps_up = more(input, output) <= more(output, input);
    let bytes = bytes.or(keeps_up.then_some(BYTES_MIN))?;
    let before_end = output.characters(bytes) - output.held_back(input);
    let arrives = input.time(input.characters(bytes), output);
    let lead = arrives.saturating_sub(output.time(before_end, input));
    let lead = lead.max(input.time(input.unit_characters(), output));
    // Rounded once, at the end.
    let bauds = u64::from(input.line.baud) * u64::from(output.line.baud);
    Some(begun + Duration::from_ticks((lead * TICK_HZ).div_ceil(bauds)))
}
