//! The log, on standard error: with times for people, with priorities for the journal.

use std::io::{IsTerminal, Write, stderr};

use env_logger::{Builder, Env};
use log::Level;

/// Starts logging; `RUST_LOG` says what, and by default information and worse.
pub fn start() {
    let mut builder = Builder::from_env(Env::default().default_filter_or("info"));
    // systemd sets it for services whose output goes to the journal, which has its own times.
    let journal = std::env::var_os("JOURNAL_STREAM").is_some() && !stderr().is_terminal();
    if journal {
        builder.format(|into, record| writeln!(into, "<{}>{}", priority(record.level()), record.args()));
    } else if stderr().is_terminal() {
        builder.format(|into, record| {
            let (level, time) = (record.level(), into.timestamp_millis());
            let style = into.default_level_style(level);
            // The console may have its prompt on the line.
            writeln!(into, "\r\x1b[K{time} {style}{level:<5}{style:#} {}", record.args())
        });
    } else {
        builder.format_timestamp_millis();
    }
    builder.init();
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
