//! The log, on standard error: with times for people, with priorities for the journal.
//!
//! A thread writes it, so that nobody waits for a terminal or a pipe that takes its time. What comes meanwhile is kept, up to a
//! limit; what is dropped behind that is counted.

use std::io::{self, IsTerminal, Write, stderr};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::thread;
use std::time::Duration;

use env_logger::{Builder, Env, Target, WriteStyle};
use log::Level;

use crate::screen::{self, Screen};

/// Lines that wait to be written.
const LINES_MAX: usize = 1_024;
/// How long the end of the program waits for them.
const END_MAX: Duration = Duration::from_secs(1);

static QUEUE: OnceLock<SyncSender<Entry>> = OnceLock::new();
/// Lines that had no room.
static DROPPED: AtomicUsize = AtomicUsize::new(0);

enum Entry {
    Line(Vec<u8>),
    /// To be told when all before this is written.
    End(std::sync::mpsc::Sender<()>),
}

/// Starts logging; `RUST_LOG` says what, and by default information and worse.
pub fn start() -> io::Result<()> {
    let mut builder = Builder::from_env(Env::default().default_filter_or("info"));
    let terminal = stderr().is_terminal();
    // systemd sets it for services whose output goes to the journal, which has its own times.
    let journal = std::env::var_os("JOURNAL_STREAM").is_some() && !terminal;
    if journal {
        builder.format(|into, record| writeln!(into, "<{}>{}", priority(record.level()), record.args()));
    } else if terminal {
        builder.format(|into, record| {
            let (level, time) = (record.level(), into.timestamp_millis().to_string());
            let style = into.default_level_style(level);
            // A person knows which day it is.
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
    // It is started once.
    let _ = QUEUE.set(queue);
    builder.target(Target::Pipe(Box::new(Queue))).init();
    Ok(())
}

/// Waits until all is written, if that does not take too long.
pub fn finish() {
    let (done, all) = channel();
    if QUEUE.get().is_some_and(|queue| queue.try_send(Entry::End(done)).is_ok()) {
        let _ = all.recv_timeout(END_MAX);
    }
    Screen::leave();
}

/// Where the logger writes to, a line at a time.
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
        // Nobody could be told.
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

/// sd-daemon(3): the priorities of syslog.
fn priority(level: Level) -> u8 {
    match level {
        Level::Error => 3,
        Level::Warn => 4,
        Level::Info => 6,
        Level::Debug | Level::Trace => 7,
    }
}
