//! Settings from a file: read as a whole, checked as a whole, and only then taken over.

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use mobgate::config::{LoadError, Loader, PortKind, Settings, TcpListen};

/// Why there are no settings.
#[derive(Debug)]
pub enum Refusal {
    /// The file cannot be read.
    Unreadable(io::Error),
    /// A line is wrong.
    Bad(LoadError),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(error) if error.kind() == io::ErrorKind::NotFound => f.write_str(
                "no such file (an empty one is a good start: settings can be typed at the console)",
            ),
            Self::Unreadable(error) => error.fmt(f),
            Self::Bad(error) => error.fmt(f),
        }
    }
}

/// The settings that the file at `path` says.
pub fn read(path: &Path) -> Result<Settings, Refusal> {
    File::open(path).map_err(Refusal::Unreadable).and_then(parse)
}

/// The settings that `text` says.
pub fn parse(mut text: impl Read) -> Result<Settings, Refusal> {
    let mut settings = Settings::new();
    let mut loader = Loader::new(&mut settings);
    let mut piece = [0; 4096];
    loop {
        match text.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => loader.feed(&piece[..count]).map_err(Refusal::Bad)?,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(Refusal::Unreadable(error)),
        }
    }
    loader.finish().map_err(Refusal::Bad)?;
    Ok(settings)
}

/// The names of the TCP servers, and where they listen.
pub fn tcp_servers(settings: &Settings) -> impl Iterator<Item = (&str, &TcpListen)> {
    settings.ports.iter().flatten().filter_map(|port| match &port.kind {
        PortKind::TcpServer(server) => Some((port.name.as_str(), &server.listen)),
        PortKind::Serial(_) => None,
    })
}

/// Lets the first TCP server listen at `listen`; says whether there is one.
pub fn redirect(settings: &mut Settings, listen: TcpListen) -> bool {
    let servers = settings.ports.iter_mut().flatten().filter_map(|port| match &mut port.kind {
        PortKind::TcpServer(server) => Some(server),
        PortKind::Serial(_) => None,
    });
    servers.take(1).map(|server| server.listen = listen).count() == 1
}
