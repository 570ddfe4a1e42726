//! A session of the console by SSH: a pair of sockets, one end of which is the console's, and two tasks that pass on what is typed and
//! what is shown.

use std::io;
use std::os::unix::net::UnixStream as System;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use russh::ChannelId;
use russh::server::Handle;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

use super::entrant::{ENTRANTS, Entrant, Who};
use crate::console::carried_out;
use crate::file::TEXT_BYTES_MAX;

/// Bytes of input that wait for the console: some settings files. The connection must not block on input, because it also carries the
/// console's output, and a console that cannot write does not read.
const INPUT_BYTES_MAX: usize = 4 * TEXT_BYTES_MAX;

/// What a session starts with.
pub(super) struct Start {
    pub(super) who: Who,
    /// The size of the terminal, if there is one, as a report to the console.
    pub(super) terminal: Option<String>,
    /// Lines to run, after which the session ends.
    pub(super) lines: Option<Vec<u8>>,
}

/// The input of a session.
pub(super) struct Running {
    /// `None` after its end.
    input: Option<UnboundedSender<Vec<u8>>>,
    waiting: Arc<AtomicUsize>,
}

/// How what the console says is passed on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Output {
    /// As keys are typed at a terminal.
    Keys,
    /// Lines, for a program.
    Lines,
    /// Lines, at a raw terminal.
    RawLines,
}

impl Start {
    pub(super) fn begin(self, handle: Handle, id: ChannelId) -> io::Result<Running> {
        let Self { who, terminal, lines } = self;
        let output = match (&terminal, &lines) {
            (Some(_), None) => Output::Keys,
            (Some(_), Some(_)) => Output::RawLines,
            (None, _) => Output::Lines,
        };
        let (ours, stream) = System::pair()?;
        ours.set_nonblocking(true)?;
        let (shown, typed) = UnixStream::from_std(ours)?.into_split();
        let entrant = Entrant { stream, who, edits: output == Output::Keys };
        ENTRANTS.try_send(entrant).map_err(|_| io::Error::from(io::ErrorKind::ResourceBusy))?;
        let (sender, receiver) = unbounded_channel();
        let mut running = Running { input: Some(sender), waiting: Arc::default() };
        tokio::spawn(pass_typed(receiver, typed, running.waiting.clone()));
        tokio::spawn(pass_shown(shown, handle, id, output));
        match (lines, terminal) {
            (Some(lines), _) => {
                running.type_in(&lines);
                running.type_in(b"\n");
                running.end();
            }
            (None, Some(size)) => _ = running.type_in(size.as_bytes()),
            (None, None) => {}
        }
        Ok(running)
    }
}

impl Running {
    /// Passes `data` on to the console; returns false if that has too much already.
    pub(super) fn type_in(&mut self, data: &[u8]) -> bool {
        let Some(input) = &self.input else { return true };
        if self.waiting.fetch_add(data.len(), Relaxed) + data.len() > INPUT_BYTES_MAX {
            return false;
        }
        // Without a receiver the session has ended.
        let _ = input.send(data.to_vec());
        true
    }

    /// The input has ended.
    pub(super) fn end(&mut self) {
        self.input = None;
    }
}

/// Passes input to the console until either ends. Dropping `to` then is the input's end.
async fn pass_typed(mut from: UnboundedReceiver<Vec<u8>>, mut to: OwnedWriteHalf, waiting: Arc<AtomicUsize>) {
    while let Some(piece) = from.recv().await {
        if to.write_all(&piece).await.is_err() {
            break;
        }
        waiting.fetch_sub(piece.len(), Relaxed);
    }
}

/// Passes the console's output to the client until its end, then the exit status.
async fn pass_shown(mut from: OwnedReadHalf, to: Handle, id: ChannelId, output: Output) {
    let (mut piece, mut status) = ([0; 4096], None);
    while let Ok(count @ 1..) = from.read(&mut piece).await {
        status = carried_out(piece[count - 1]);
        let text = &piece[..count - usize::from(status.is_some())];
        let text = match output {
            Output::RawLines => String::from_utf8_lossy(text).replace('\n', "\r\n").into_bytes(),
            Output::Keys | Output::Lines => text.to_vec(),
        };
        if !text.is_empty() && to.data(id, text).await.is_err() {
            return;
        }
    }
    // At a terminal the user has seen the result of each line.
    let all = status == Some(true) || output == Output::Keys && status.is_some();
    // Errors: the client is gone.
    let _ = to.exit_status_request(id, u32::from(!all)).await;
    let _ = to.eof(id).await;
    let _ = to.close(id).await;
}
