//! The console: a session of lines over any stream, typed by a person or piped in.
//!
//! In [`Mode::Echo`] bytes go through the line editor, which echoes them; in [`Mode::Plain`] they are lines of text,
//! answered without prompt or echo, with line numbers in errors. A line is run as a command; one of the settings'
//! language changes the gateway's draft of the settings, which it then takes over.

mod ask;
mod command;
mod complete;
mod editor;
mod frames;
mod help;
mod history;
mod keys;
mod output;
// One of two: what an `async` function awaits stays in it, also behind a constant.
#[cfg_attr(not(feature = "points"), path = "console/no_points.rs")]
mod points;
mod probe;
mod rows;
mod scan;
mod show;
#[cfg(test)]
mod tests;
mod tune;

use embedded_io_async::{Read, Write};

use self::command::{Next, Session};
use self::complete::{Completion, candidates, complete};
use self::editor::{Editor, Event};
use self::output::Output;
use crate::config::{LINE_BYTES_MAX, LineBuffer, LineError};
use crate::gateway::Gateway;
use crate::hal::{Store, System};

const PROMPT: &str = "mobgate> ";
/// Bytes taken from the stream at a time.
const CHUNK_BYTES_MAX: usize = 64;

/// Who is at the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A terminal that sends every key: lines are edited here and echoed.
    Echo,
    /// A program, a file, or a terminal that edits lines itself.
    Plain,
}

/// Runs a session until `exit`, the end of input, or an error of the stream.
///
/// The future takes less than 7 kB on a chip of 32 bits. Dropping it while `save` runs leaves a
/// version begun in `store`: the next session needs another store, or one that has forgotten it.
pub async fn run<IO, S, Y>(
    gateway: &Gateway<'_>,
    stream: IO,
    store: &mut S,
    system: &Y,
    mode: Mode,
) -> Result<(), IO::Error>
where
    IO: Read + Write,
    S: Store,
    Y: System,
{
    let (line_end, line_number) = match mode {
        Mode::Echo => ("\r\n", None),
        Mode::Plain => ("\n", Some(0)),
    };
    let out = Output::new(stream, line_end);
    let mut session = Session { gateway, out, store, system, line_number };
    match mode {
        Mode::Echo => edited(&mut session).await,
        Mode::Plain => piped(&mut session).await,
    }
}

/// A session with a person at a terminal.
async fn edited<IO: Read + Write, S: Store, Y: System>(
    session: &mut Session<'_, '_, IO, S, Y>,
) -> Result<(), IO::Error> {
    let mut editor = Editor::new(PROMPT);
    editor.start();
    let mut chunk = [0; CHUNK_BYTES_MAX];
    loop {
        session.out.text(&editor.echo).await?;
        editor.echo.clear();
        session.out.flush().await?;
        let count = session.out.read(&mut chunk).await?;
        if count == 0 {
            return Ok(());
        }
        for &byte in chunk.iter().take(count) {
            let event = editor.feed(byte);
            session.out.text(&editor.echo).await?;
            editor.echo.clear();
            match event {
                Event::Editing => {}
                Event::Line => {
                    if session.execute(editor.line()).await? == Next::Exit {
                        return session.out.flush().await;
                    }
                    editor.start();
                }
                Event::LineTooLong => {
                    session.fail(format_args!("{}", LineError::too_long())).await?;
                    editor.start();
                }
                Event::Complete => tab(session, &mut editor).await?,
                Event::Leave => {
                    session.out.line(format_args!("exit")).await?;
                    return session.out.flush().await;
                }
            }
        }
    }
}

/// Completes the word at the cursor, or shows how it could go on.
async fn tab<IO: Read + Write, S: Store, Y: System>(
    session: &mut Session<'_, '_, IO, S, Y>,
    editor: &mut Editor,
) -> Result<(), IO::Error> {
    let before = editor.before_cursor();
    match session.gateway.settings(|settings| complete(before, settings)) {
        Completion::None => editor.bell(),
        Completion::Append(text) => editor.insert_text(&text),
        Completion::Several => {
            // As many as fit into a line of output.
            let mut words = heapless::String::<LINE_BYTES_MAX>::new();
            session.gateway.settings(|settings| {
                candidates(before, settings, &mut |word| {
                    let _ = words.push_str(word).and_then(|()| words.push_str("  "));
                });
            });
            session.out.line(format_args!("")).await?;
            session.out.line(format_args!("{words}")).await?;
            editor.redraw();
        }
    }
    Ok(())
}

/// A session with lines of text.
async fn piped<IO: Read + Write, S: Store, Y: System>(
    session: &mut Session<'_, '_, IO, S, Y>,
) -> Result<(), IO::Error> {
    let mut line = LineBuffer::default();
    let mut chunk = [0; CHUNK_BYTES_MAX];
    loop {
        let count = session.out.read(&mut chunk).await?;
        // The last line may lack its end.
        let bytes: &[u8] = if count == 0 { b"\n" } else { chunk.get(..count).unwrap_or_default() };
        for &byte in bytes {
            if !line.feed(byte) {
                continue;
            }
            session.line_number = session.line_number.map(|number| number.saturating_add(1));
            let next = match line.text() {
                Ok(text) => session.execute(text).await?,
                Err(error) => session.fail(format_args!("{error}")).await.map(|()| Next::Line)?,
            };
            line.clear();
            if next == Next::Exit {
                return session.out.flush().await;
            }
        }
        session.out.flush().await?;
        if count == 0 {
            return Ok(());
        }
    }
}
