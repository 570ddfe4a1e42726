//! The limits of the numbers and times of ports.

use core::ops::RangeInclusive;

use embassy_time::Duration;

use crate::settings::{Count, SOCKETS_MAX, UDP_REQUESTS_MAX};

/// A time of at most this many seconds.
const fn up_to(seconds: u64) -> RangeInclusive<Duration> {
    Duration::from_ticks(0)..=Duration::from_secs(seconds)
}

type Times = RangeInclusive<Duration>;

pub(crate) const BAUD: RangeInclusive<u32> = 1..=10_000_000;

/// A longer gap would make any line useless; 0 is for lines that need none.
pub(super) const SECOND: Times = up_to(1);

pub(super) const TEN_SECONDS: Times = up_to(10);

pub(super) const MINUTE: Times = up_to(60);

pub(super) const HOUR: Times = up_to(3_600);

pub(super) const CHAR_TIMEOUT: Times = Duration::from_micros(100)..=Duration::from_secs(60);

pub(super) const TIMEOUT: Times = Duration::from_millis(1)..=Duration::from_secs(3_600);

/// For queued requests, and for responses.
pub(super) const LIFETIME: Times = Duration::from_millis(10)..=Duration::from_secs(3_600);

pub(super) const IDLE: Times = Duration::from_secs(1)..=Duration::from_secs(86_400);

pub(super) const RETRIES: Count = Count("retries", 0..=10);

pub(super) const DOWN_AFTER: Count = Count("time-outs in a row", 0..=255);

/// Boards may have fewer.
pub(super) const CLIENTS: Count = Count("connections", 1..=1_000);

pub(super) const RESERVED: Count = Count("connections", 0..=1_000);

/// Messaging on TCP/IP 4.4.1.1 (NumberMaxOfServerTransaction): 1 to 16.
pub(super) const PIPELINE: Count = Count("requests", 1..=16);

pub(super) const REQUESTS: Count = Count("requests", 1..=UDP_REQUESTS_MAX as u32);

/// Boards have few.
pub(super) const SOCKETS: Count = Count("connections", 1..=SOCKETS_MAX as u32);

/// 0 would mean none (ETG.1020).
pub(super) const ID: Count = Count("alias, or an id", 1..=u16::MAX as u32);

pub(super) const UNIT: Count = Count("auto, or a unit id", 0..=255);
