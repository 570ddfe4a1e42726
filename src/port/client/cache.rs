//! Response cache of a client-side port, for reads whose rule allows cached responses. Pure, with time as a value.
//!
//! The age of a response counts from its request, since the device read the values after that. The oldest response is evicted
//! when there is no room. A write to a unit invalidates everything cached for that unit, whatever addresses it names: a register
//! may affect others.

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::Block;
use crate::port::client::queue::BROADCAST;

/// Responses cached per port. The feature `small` saves memory here.
pub const RESPONSES_MAX: usize = if cfg!(feature = "small") { 8 } else { 16 };
/// Total bytes of the cached PDUs: three of the longest, or sixteen of 22 registers; with `small` one, or eight of 15.
pub const RESPONSE_BYTES_MAX: usize = if cfg!(feature = "small") { PDU_BYTES_MAX } else { 3 * PDU_BYTES_MAX };

/// What identifies a cached response: a read of coils, inputs or registers (functions 1 to 4) from a unit. Other responses are
/// not cached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CacheKey {
    /// The unit.
    pub unit: u8,
    /// The block that is read.
    pub block: Block,
}

impl CacheKey {
    /// The key of `request` to `unit`, if it can be cached.
    pub fn new(unit: u8, request: &[u8]) -> Option<Self> {
        Some(Self { unit, block: Block::of(request)? })
    }
}

/// A cached response. Unit and length share the padding of the block, which keeps the entry small.
struct Kept {
    unit: u8,
    length: u8,
    block: Block,
    sent: Instant,
}

impl Kept {
    fn is_for(&self, key: CacheKey) -> bool {
        self.block == key.block && self.unit == key.unit
    }
}

/// The cached responses of one port.
pub struct Cache {
    /// In order of arrival.
    kept: Vec<Kept, RESPONSES_MAX>,
    /// Their PDUs, in the same order.
    bytes: Vec<u8, RESPONSE_BYTES_MAX>,
}

impl Cache {
    /// An empty cache.
    pub const fn new() -> Self {
        Self { kept: Vec::new(), bytes: Vec::new() }
    }

    /// Caches `response` to a request sent at `sent`.
    pub fn keep(&mut self, key: CacheKey, response: &[u8], sent: Instant) {
        self.remove(|kept| kept.is_for(key));
        while self.kept.is_full() || RESPONSE_BYTES_MAX - self.bytes.len() < response.len() {
            if self.kept.is_empty() {
                // Longer than any PDU.
                return;
            }
            self.remove_at(0);
        }
        let CacheKey { unit, block } = key;
        let kept = Kept { unit, length: response.len() as u8, block, sent };
        // Room for both was made above.
        if self.bytes.extend_from_slice(response).is_ok() {
            let _ = self.kept.push(kept);
        }
    }

    /// The response for `key`, unless it is older than `age`.
    pub fn response(&self, key: CacheKey, now: Instant, age: Duration) -> Option<&[u8]> {
        let index = self.kept.iter().position(|kept| kept.is_for(key))?;
        let kept = self.kept.get(index)?;
        if now.saturating_duration_since(kept.sent) > age {
            return None;
        }
        let start = self.start(index);
        self.bytes.get(start..start + usize::from(kept.length))
    }

    /// Invalidates what a write to `unit` (or a broadcast) may have changed.
    pub fn written(&mut self, unit: u8) {
        self.remove(|kept| unit == BROADCAST || kept.unit == unit);
    }

    /// Drops the responses of the units selected by `these`.
    pub fn forget(&mut self, these: impl Fn(u8) -> bool) {
        self.remove(|kept| these(kept.unit));
    }

    /// Number of cached responses.
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether the cache is empty.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    fn remove(&mut self, which: impl Fn(&Kept) -> bool) {
        while let Some(index) = self.kept.iter().position(&which) {
            self.remove_at(index);
        }
    }

    fn remove_at(&mut self, index: usize) {
        let start = self.start(index);
        let end = start + usize::from(self.kept.remove(index).length);
        self.bytes.copy_within(end.., start);
        self.bytes.truncate(self.bytes.len() - (end - start));
    }

    fn start(&self, index: usize) -> usize {
        self.kept.iter().take(index).map(|kept| usize::from(kept.length)).sum()
    }
}
