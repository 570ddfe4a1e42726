//! Clients that ask again and again, and how long they waited.

use std::collections::BTreeMap;

use embassy_time::{Duration, Instant, Timer};

use super::{Client, Response};

/// What became of a client's requests.
#[derive(Debug, Clone, Default)]
pub struct Load {
    /// How long each response took, exceptions included.
    pub latencies: Latencies,
    /// Responses without exception.
    pub responses: u64,
    /// Exceptions by code.
    pub exceptions: BTreeMap<u8, u64>,
    /// Requests without a response.
    pub silences: u64,
    /// Frames that were no response to the request.
    pub wrong: u64,
    /// Whether the connection ended before its time.
    pub closed: bool,
}

/// A client that does one transaction after the other.
#[derive(Debug, Clone, Copy)]
pub struct ClosedLoop {
    /// Between a response and the next request.
    pub think: Duration,
    /// No request is sent from here on.
    pub until: Instant,
}

impl ClosedLoop {
    /// Asks without pause until `until`.
    pub fn until(until: Instant) -> Self {
        Self { think: Duration::from_ticks(0), until }
    }

    /// The loop with a pause between a response and the next request.
    #[must_use]
    pub fn thinking(self, think: Duration) -> Self {
        Self { think, ..self }
    }

    /// Sends what `next` gives (unit and PDU) and shows each response to `check`.
    pub async fn run(
        self,
        client: &mut Client,
        mut next: impl FnMut() -> (u8, Vec<u8>),
        mut check: impl FnMut(u8, &[u8], &Response),
    ) -> Load {
        let mut load = Load::default();
        while Instant::now() < self.until && !load.closed {
            let (unit, pdu) = next();
            let asked = Instant::now();
            let response = client.request(unit, &pdu).await;
            check(unit, &pdu, &response);
            load.note(&response, asked.elapsed());
            if self.think > Duration::from_ticks(0) {
                Timer::after(self.think).await;
            }
        }
        load
    }
}

impl Load {
    fn note(&mut self, response: &Response, latency: Duration) {
        match (response, response.exception()) {
            (Response::Silence, _) => return self.silences += 1,
            (Response::Closed, _) => return self.closed = true,
            (Response::Wrong(_), _) => return self.wrong += 1,
            (Response::Pdu(_), Some(code)) => *self.exceptions.entry(code).or_default() += 1,
            (Response::Pdu(_), None) => self.responses += 1,
        }
        self.latencies.note(latency);
    }
}

/// Latencies, to be asked for percentiles.
#[derive(Debug, Clone, Default)]
pub struct Latencies(Vec<Duration>);

impl Latencies {
    /// Adds one.
    pub fn note(&mut self, latency: Duration) {
        self.0.push(latency);
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The least latency that `percent` of all do not exceed; nothing when there are none.
    pub fn percentile(&self, percent: f64) -> Option<Duration> {
        let mut sorted = self.0.clone();
        sorted.sort_unstable();
        let rank = (percent / 100.0 * sorted.len() as f64).ceil() as usize;
        sorted.get(rank.max(1) - 1).copied()
    }

    /// The longest.
    pub fn max(&self) -> Option<Duration> {
        self.0.iter().copied().max()
    }
}

#[cfg(test)]
mod tests {
    use embassy_time::Duration;

    use super::Latencies;

    #[test]
    fn a_percentile_is_the_value_at_its_rank() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.percentile(50.0), None);
        (1..=200).rev().for_each(|ms| latencies.note(Duration::from_millis(ms)));
        assert_eq!(latencies.percentile(50.0), Some(Duration::from_millis(100)));
        assert_eq!(latencies.percentile(99.0), Some(Duration::from_millis(198)));
        assert_eq!(latencies.percentile(100.0), latencies.max());
    }
}
