//! The console: a session of lines over any stream, typed by a person or piped in.
//!
//! In [`Mode::Echo`] bytes go through the line editor, which echoes them; in [`Mode::Plain`] they are lines of text,
//! answered without prompt or echo, with line numbers in errors; [`Mode::Network`] also rejects other protocols by the first line,
//! and requires log-in; with [`Mode::User`] the user is already authenticated.
//! A line is run as a command; one of the settings' language changes the gateway's draft of the settings, which is then applied.
//!
//! Only this file, `log_in` and `update` await. Commands are plain steps: each writes a piece of text and returns what must happen
//! before the next one.

// Only the web interface uses it.
#[cfg(feature = "web")]
pub(crate) mod access;
#[cfg(feature = "web")]
mod alone;
mod ask;
mod asks;
// As the feature.
#[cfg(feature = "audit")]
mod audit;
// Replaced by a stub in images without a candidate.
#[cfg_attr(not(feature = "candidate"), path = "console/no_candidate.rs")]
mod candidate;
// Images without TLS have none.
#[cfg(feature = "tls")]
mod certificates;
mod command;
mod complete;
// Without a candidate there is nothing to compare.
#[cfg(feature = "candidate")]
pub(crate) mod diff;
// As `access`.
#[cfg(feature = "web")]
mod details;
mod editor;
// Images without named files have no owner for them.
#[cfg(feature = "files")]
mod files;
// Part of the web interface; boards without that have no room for it.
#[cfg(feature = "web")]
mod explain;
mod frames;
mod guard;
mod help;
mod history;
mod image;
mod input;
mod job;
mod keys;
mod known;
mod layout;
// Without users nothing calls it.
#[cfg_attr(not(feature = "users"), allow(dead_code))]
mod log_in;
mod mode;
mod network;
mod output;
#[cfg(feature = "points")] // Without them there are no such commands.
mod point_ask;
mod point_command;
#[cfg(feature = "mqtt")] // Only publishers have messages.
mod point_message;
#[cfg(feature = "points")] // As `point_ask`.
mod point_order;
// Replaced by stubs in images without data points.
#[cfg_attr(not(feature = "points"), path = "console/no_points.rs")]
mod points;
mod probe;
// As its topic.
#[cfg(feature = "mqtt")]
mod publishers;
mod registers;
mod rows;
mod run;
mod scan;
mod serial_lines;
mod session;
mod shell;
mod show;
mod table;
#[cfg(test)]
mod tests;
mod tune;
mod update;
mod users;
mod values;
mod version;
mod wait;

#[cfg(feature = "mqtt")] // For publishers, which write points the same way.
pub(crate) use self::point_message::{Refusal, write_point};
#[cfg(feature = "mqtt")] // Likewise.
pub(crate) use self::point_order::settled;
#[cfg(feature = "mqtt")] // Likewise.
pub(crate) use self::values::{Numbers, Values};

use core::future::pending;
use core::pin::pin;

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};

// As its file.
pub use self::asks::PASSWORD_BYTES;
#[cfg(feature = "files")]
pub use self::files::serve_files;
pub use self::guard::Foreign;
pub use self::mode::{Ended, Mode};
use self::shell::Shell;
use self::wait::{Wait, WaitEvent};
use crate::gateway::Gateway;
use crate::gateway::reconfigure;
use crate::hal::{Store, System, Update};

/// Bytes taken from the stream at a time.
const CHUNK_BYTES_MAX: usize = 64;
/// Bytes that may stop a command. Input after them, or after the line that they begin, is the next command.
const STOP_BYTES_MAX: usize = 16;

/// Runs a session until `exit`, the end of input, or a stream error; returns how it ended.
///
/// The future takes less than 7 kB on a 32-bit chip. Dropping it during `save` leaves an unfinished version in `store`, and during
/// `update` an unfinished image in `update`: the next session needs other instances.
pub async fn run<IO: Read + Write, S: Store, U: Update, Y: System>(
    gateway: &Gateway<'_>,
    stream: &mut IO,
    store: &mut S,
    update: &mut U,
    system: &Y,
    mode: Mode<'_>,
) -> Result<Ended, IO::Error> {
    let mut shell = Shell::new(gateway, system, mode);
    let mut wait = shell.start();
    let (mut chunk, mut keys, mut stop) = ([0; CHUNK_BYTES_MAX], 0..0, [0; STOP_BYTES_MAX]);
    // Whether the rest of the line that stopped a command is still to come.
    let mut skips = false;
    loop {
        stream.write_all(shell.session.out.text.as_bytes()).await?;
        shell.session.out.clear();
        if let Wait::Update { allow_older } = wait {
            let ahead = mode.piped(&chunk, &keys);
            wait = shell.updated(update::receive(stream, update, allow_older, ahead).await?);
            // What was typed ahead may be of the transfer.
            keys = if U::EXISTS { 0..0 } else { keys };
            continue;
        }
        let is_idle = matches!(wait, Wait::Key);
        let event = if matches!(wait, Wait::Sent) {
            WaitEvent::Nothing
        } else if is_idle && let Some(key) = keys.next().and_then(|at| chunk.get(at)) {
            WaitEvent::Key(*key)
        } else {
            stream.flush().await?;
            // Not in a function, which would store its arguments twice.
            let mut work = pin!(work(&mut shell, store, system, wait));
            let into = if is_idle { &mut chunk[..] } else { &mut stop[..] };
            let mut listens = wait.listens();
            loop {
                let read = async { if listens { stream.read(into).await } else { pending().await } };
                match select(read, work.as_mut()).await {
                    Either::Second(event) => break event,
                    // The input has ended, but the output may still be read.
                    Either::First(Ok(0)) if matches!(wait, Wait::Response { .. }) => listens = false,
                    Either::First(read) => break WaitEvent::Typed(read?),
                }
            }
        };
        match (wait, event) {
            (Wait::Exit, _) => return Ok(shell.session.ended),
            (Wait::Key, WaitEvent::Typed(count @ 1..)) => {
                let end = if skips { line_end(&chunk, count) } else { Some(0) };
                skips = end.is_none();
                keys = end.unwrap_or(count)..count;
            }
            (_, event) => {
                if let WaitEvent::Typed(count @ 1..) = event {
                    skips = !mode.edits() && line_end(&stop, count).is_none();
                }
                wait = shell.step(event);
            }
        }
    }
}

/// The index after the first line end within the first `count` of `bytes`.
fn line_end(bytes: &[u8], count: usize) -> Option<usize> {
    bytes.iter().take(count).position(|byte| *byte == b'\n').map(|end| end + 1)
}

/// Does what a step waits for.
async fn work<S: Store, Y: System>(
    shell: &mut Shell<'_, '_>,
    store: &mut S,
    system: &Y,
    wait: Wait,
) -> WaitEvent {
    let Shell { input, session, .. } = shell;
    match wait {
        // `Update` needs the stream.
        Wait::Sent | Wait::Exit | Wait::End | Wait::Update { .. } => {}
        Wait::Key => pending().await,
        Wait::Pause(_) | Wait::Rest(_) | Wait::Response { .. } | Wait::Open { .. } => {
            return session.wait(wait).await;
        }
        Wait::Change => {
            let ahead = |new: &_| session.ahead(new).inspect(|()| session.audit_line(input.line()));
            let changed = reconfigure::change(session.gateway, input.line(), &ahead).await;
            session.changed(changed);
        }
        Wait::Save { whatever } => {
            session.gateway.sign(store, session.actor());
            let saved = reconfigure::save(session.gateway, store, whatever).await;
            session.saved(saved);
        }
        // As for users below.
        #[cfg(feature = "candidate")]
        Wait::Commit { confirmed } => session.commit(store, confirmed).await,
        #[cfg(feature = "candidate")]
        Wait::RollBack => session.roll_back().await,
        #[cfg(feature = "candidate")]
        Wait::BringBack { nth } => session.bring_back(store, nth).await,
        #[cfg(feature = "candidate")]
        Wait::Version { nth } => return session.version(store, nth),
        Wait::Load => {
            let ahead = |new: &_| session.ahead(new).inspect(|()| session.audit_difference(new));
            let loaded = reconfigure::load(session.gateway, store, &ahead).await;
            session.loaded(loaded);
        }
        // Without users nobody waits for these; a constant would leave their code in the future.
        #[cfg(feature = "users")]
        Wait::LogIn => session.log_in(system, input.line()).await,
        #[cfg(feature = "users")]
        Wait::Password => session.set_password(system, input.line()).await,
        #[cfg(not(feature = "users"))]
        Wait::LogIn | Wait::Password => _ = system,
        Wait::Reboot => session.system.reboot(),
    }
    WaitEvent::Nothing
}
