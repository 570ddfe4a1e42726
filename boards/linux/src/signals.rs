//! Signals handled by the program, as bytes in sockets that the reactor watches.

use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::sync::Arc;

use embassy_futures::select::{Either4, select4};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ};
use signal_hook::flag;
use signal_hook::low_level::pipe;

use crate::descriptor::Descriptor;

/// A handled signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// SIGHUP: read the settings again.
    Reload,
    /// SIGTERM, SIGINT or SIGQUIT: end the program.
    End(&'static str),
}

/// Catches signals from its creation on.
#[derive(Debug)]
pub struct Signals {
    hup: Descriptor<UnixStream>,
    int: Descriptor<UnixStream>,
    quit: Descriptor<UnixStream>,
    term: Descriptor<UnixStream>,
}

impl Signals {
    /// Starts catching signals; they are kept until [`Signals::next`] returns them.
    pub fn catch() -> io::Result<Self> {
        // Exceeding the file size limit shall be a write error, not end the program.
        flag::register(SIGXFSZ, Arc::default())?;
        Ok(Self {
            hup: caught(SIGHUP)?,
            int: caught(SIGINT)?,
            quit: caught(SIGQUIT)?,
            term: caught(SIGTERM)?,
        })
    }

    /// Waits for the next signal.
    pub async fn next(&mut self) -> Signal {
        let Self { hup, int, quit, term } = self;
        match select4(arrived(hup), arrived(int), arrived(quit), arrived(term)).await {
            Either4::First(()) => Signal::Reload,
            Either4::Second(()) => Signal::End("SIGINT"),
            // Ctrl-\ at the program's own terminal, which is raw until the end.
            Either4::Third(()) => Signal::End("SIGQUIT"),
            Either4::Fourth(()) => Signal::End("SIGTERM"),
        }
    }
}

fn caught(signal: i32) -> io::Result<Descriptor<UnixStream>> {
    let (reader, writer) = UnixStream::pair()?;
    pipe::register(signal, writer)?;
    Descriptor::new(reader)
}

async fn arrived(signal: &mut Descriptor<UnixStream>) {
    // The other end lives as long as the process, so this neither ends nor fails.
    let _ = signal.read_with(|mut stream| stream.read(&mut [0; 16])).await;
}
