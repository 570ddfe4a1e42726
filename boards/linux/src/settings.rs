//! Settings from a file: read as a whole, checked as a whole, and only then taken over.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use mobgate::config::{Loader, PortKind, Settings, TcpListen, TcpServerSettings};

/// The settings that the file at `path` says, or what is wrong with it, and where.
pub fn read(path: &Path) -> Result<Settings, String> {
    let opened = File::open(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => {
            "no such file (an empty one is a good start: settings can be typed at the console)".to_owned()
        }
        _ => error.to_string(),
    });
    opened.and_then(parse).map_err(|fault| format!("{}: {fault}", path.display()))
}

/// The settings that `text` says.
pub fn parse(mut text: impl Read) -> Result<Settings, String> {
    let mut settings = Settings::new();
    let mut loader = Loader::new(&mut settings);
    let mut piece = [0; 4096];
    loop {
        match text.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => loader.feed(&piece[..count]).map_err(|error| error.to_string())?,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.to_string()),
        }
    }
    loader.finish().map_err(|error| error.to_string())?;
    Ok(settings)
}

/// The names of the TCP servers, and where they listen.
pub fn tcp_servers(settings: &Settings) -> impl Iterator<Item = (&str, &TcpListen)> {
    settings.ports.iter().flatten().filter_map(|port| match &port.kind {
        PortKind::TcpServer(server) => Some((port.name.as_str(), &server.listen)),
        _ => None,
    })
}

/// Lets the first TCP server listen at `listen`; says whether there is one.
pub fn redirect(settings: &mut Settings, listen: TcpListen) -> bool {
    let first = settings.ports.iter_mut().flatten().find_map(|port| match &mut port.kind {
        PortKind::TcpServer(server) => Some(server),
        _ => None,
    });
    first.map(|server: &mut TcpServerSettings| server.listen = listen).is_some()
}
