//! Which points are to be sent: those whose value or quality has changed since, and those not sent for long.

use embassy_time::{Duration, Instant};

use super::mark::sample;
use super::session::Session;
use super::source::Source;
use crate::scanner::RowId;

impl Source<'_, '_> {
    /// Marks the points that are to be sent, and counts values that are replaced before.
    pub(super) fn mark_changed(&self, session: &mut Session) {
        let Some(scanner) = self.gateway.scanner() else { return };
        // Hosts of Sparkplug notice themselves what they have missed.
        let every = if self.is_sparkplug() { Duration::MAX } else { self.publisher.every };
        let now = Instant::now();
        let count = scanner.with(|scanner| scanner.rows());
        let mut replaced = 0;
        for (nth, mark) in session.marks.iter_mut().enumerate() {
            if nth >= count {
                mark.waits = false;
                continue;
            }
            let sample = scanner.with(|scanner| sample(scanner, RowId(nth as u8), now));
            replaced += u32::from(sample.is_some_and(|sample| mark.update(&sample, now, every)));
        }
        self.state.report(|report| {
            report.lost = report.lost.wrapping_add(replaced);
            report.queued = session.queued();
        });
    }
}
