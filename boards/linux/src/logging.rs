//! The log on standard error: with times for people, with priorities for the journal.
//!
//! A thread writes it, so that no task blocks on a slow terminal or pipe. Meanwhile lines queue up to a limit; further ones are
//! dropped and counted.

use std::io::{self, IsTerminal, Write, stderr};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::thread;
use std::time::Duration;

use env_logger::{Builder, Env, Target, WriteStyle};
use log::{Level, LevelFilter};

use crate::screen::{self, Screen};

/// Most lines queued for writing.
const LINES_MAX: usize = 1_024;
/// Longest wait for them at the end of the program.
const END_MAX: Duration = Duration::from_secs(1);

static QUEUE: OnceLock<SyncSender<Entry>> = OnceLock::new();
/// Lines dropped because the queue was full.
static DROPPED: AtomicUsize = AtomicUsize::new(0);

enum Entry {
    Line(Vec<u8>),
    /// Acknowledged once everything before it is written.
    End(std::sync::mpsc::Sender<()>),
}

/// Starts logging at the level in `RUST_LOG`; `info` by default.
pub fn start() -> io::Result<()> {
    let mut builder = Builder::from_env(Env::default().default_filter_or("info"));
    if std::env::var_os("RUST_LOG").is_none() {
        // Clients could fill the log with their mistakes.
        builder.filter_module("russh", LevelFilter::Off);
    }
    let terminal = stderr().is_terminal();
    // systemd sets it for services that log to the journal, which adds its own times.
    let journal = std::env::var_os("JOURNAL_STREAM").is_some() && !terminal;
    if journal {
        builder.format(|into, record| writeln!(into, "<{}>{}", priority(record.level()), record.args()));
    } else if terminal {
        builder.format(|into, record| {
            let (level, time) = (record.level(), into.timestamp_millis().to_string());
            let style = into.default_level_style(level);
            // People know the date.
            let time = time.split_once('T').map_or(time.as_str(), |(_, time)| time);
            writeln!(into, "{time} {style}{level:<5}{style:#} {}", record.args())
        });
        let is_plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        builder.write_style(if is_plain { WriteStyle::Never } else { WriteStyle::Always });
    } else {
        builder.format_timestamp_millis();
    }
    let (queue, entries) = sync_channel(LINES_MAX);
    thread::Builder::new().name("log".into()).spawn(move || write(&entries))?;
    // Set only once.
    let _ = QUEUE.set(queue);
    builder.target(Target::Pipe(Box::new(Queue))).init();
    Ok(())
}

/// Waits until the log is written, up to a time limit.
pub fn finish() {
    let (done, all) = channel();
    if QUEUE.get().is_some_and(|queue| queue.try_send(Entry::End(done)).is_ok()) {
        let _ = all.recv_timeout(END_MAX);
    }
    Screen::leave();
}

/// The logger's target: queues one line per call.
struct Queue;

impl Write for Queue {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let sent = QUEUE.get().map(|queue| queue.try_send(Entry::Line(line.to_vec())));
        if let Some(Err(TrySendError::Full(_))) = sent {
            DROPPED.fetch_add(1, Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn write(entries: &Receiver<Entry>) {
    let shared = screen::is_shared();
    let write = |line: &[u8]| {
        // There is nowhere to report a failure.
        let _ = if shared { Screen::log(line) } else { stderr().write_all(line) };
    };
    for entry in entries {
        let dropped = DROPPED.swap(0, Relaxed);
        match entry {
            Entry::Line(line) => write(&line),
            Entry::End(done) => _ = done.send(()),
        }
        if dropped > 0 {
            write(format!("{dropped} log lines dropped: nobody read them in time\n").as_bytes());
        }
    }
}

/// syslog priorities, see sd-daemon(3).
fn priority(level: Level) -> u8 {
    match level {
        Level::Error => 3,
        Level::Warn => 4,
        Level::Info => 6,
        Level::Debug | Level::Trace => 7,
    }
}
