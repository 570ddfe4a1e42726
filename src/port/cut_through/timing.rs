//! The timing of cut-through: when an arriving frame may be forwarded. Pure, with time as a value.
//!
//! A frame of unit, function and data, `N` bytes together, takes `N + 2` characters in RTU and `2 N + 5` in ASCII. Forwarding can
//! start once its unit has arrived, which takes `r` characters: 1 in RTU, 3 in ASCII. It must not end before the frame is known to
//! be valid: its last `h` characters are held back until the frame has ended. So, with `Li` and `Lo` characters of duration `ti`
//! and `to` on the ingress line and the egress line:
//! ```text
//! start = max(r ti, Li ti - (Lo - h) to)          from the first bit received to the first bit sent
//! leg   = max(r ti + Lo to, Li ti + h to)         to the last bit sent
//! ```
//!
//! | ingress | egress | `r` | `h` | held back |
//! | --- | --- | --- | --- | --- |
//! | RTU | RTU | 1 | 1 | the second half of the CRC |
//! | RTU | ASCII | 1 | 4 | LRC, carriage return and line feed: the LRC is known once the CRC has been checked |
//! | ASCII | RTU | 3 | 1 | the second half of the CRC: the first half is known once the LRC has been checked |
//! | ASCII | ASCII | 3 | 2 | carriage return and line feed |
//!
//! Between start and end, no forwarded character has to wait for one to arrive. If a byte takes at least as long to leave as to
//! arrive, a long frame may start no later than the shortest one, so its length need not be known.

use embassy_time::{Duration, Instant, TICK_HZ};

use crate::settings::Lane;

/// Unit and function code.
const BYTES_MIN: usize = 2;

/// When a frame whose first bit arrived on `input` at `begun` may start on `output`. `bytes` is its length without the check, if
/// known; `None` if the start depends on a length not known yet.
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
