//! The signals that the program acts on, as bytes in a socket that the reactor watches.

use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::sync::Arc;

use embassy_futures::select::{Either4, select4};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXFSZ};
use signal_hook::flag;
use signal_hook::low_level::pipe;

use crate::descriptor::Descriptor;

/// A signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// SIGHUP: read the settings again.
    Reload,
    /// SIGTERM, SIGINT or SIGQUIT: end.
    End(&'static str),
}

/// Catches signals from its making on.
#[derive(Debug)]
pub struct Signals {
    hup: Descriptor<UnixStream>,
    int: Descriptor<UnixStream>,
    quit: Descriptor<UnixStream>,
    term: Descriptor<UnixStream>,
}

impl Signals {
    /// From now on signals are kept until [`Signals::next`] gives them.
    pub fn catch() -> io::Result<Self> {
        // A file that gets longer than the system allows is an error where it is written, not the end of the program.
        flag::register(SIGXFSZ, Arc::default())?;
        Ok(Self {
            hup: caught(SIGHUP)?,
            int: caught(SIGINT)?,
            quit: caught(SIGQUIT)?,
            term: caught(SIGTERM)?,
        })
    }

    /// The next signal.
    pub async fn next(&mut self) -> Signal {
        let Self { hup, int, quit, term } = self;
        match select4(arrived(hup), arrived(int), arrived(quit), arrived(term)).await {
            Either4::First(()) => Signal::Reload,
            Either4::Second(()) => Signal::End("SIGINT"),
            // Ctrl-\ at the program's own terminal, which is raw till the end.
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
    // The other end lives as long as the process, so this can neither end nor fail.
    let _ = signal.read_with(|mut stream| stream.read(&mut [0; 16])).await;
}
