//! What a program has used of the machine: proc_pid_status(5), proc_pid_schedstat.

use std::fs;
use std::ops::Sub;
use std::path::Path;
use std::time::Duration;

/// Processor time and context switches since a program's start, or between two looks.
#[derive(Clone, Copy, Default)]
pub(crate) struct Usage {
    pub(crate) cpu: Duration,
    pub(crate) switches: u64,
}

impl Usage {
    /// Of all threads of the process `id`. A thread that has ended is not counted any more.
    pub(crate) fn of(id: u32) -> Self {
        let Ok(threads) = fs::read_dir(format!("/proc/{id}/task")) else { return Self::default() };
        threads.flatten().map(|thread| Self::of_thread(&thread.path())).fold(Self::default(), |sum, one| {
            Self { cpu: sum.cpu + one.cpu, switches: sum.switches + one.switches }
        })
    }

    fn of_thread(thread: &Path) -> Self {
        let read = |name| fs::read_to_string(thread.join(name)).unwrap_or_default();
        let cpu = read("schedstat").split(' ').next().and_then(|ns| ns.parse().ok()).unwrap_or(0);
        let status = read("status");
        let counts = status.lines().filter(|line| line.contains("ctxt_switches:"));
        let switches = counts.filter_map(|line| line.split_whitespace().nth(1)?.parse::<u64>().ok()).sum();
        Self { cpu: Duration::from_nanos(cpu), switches }
    }
}

impl Sub for Usage {
    type Output = Self;

    fn sub(self, before: Self) -> Self {
        Self {
            cpu: self.cpu.saturating_sub(before.cpu),
            switches: self.switches.saturating_sub(before.switches),
        }
    }
}
