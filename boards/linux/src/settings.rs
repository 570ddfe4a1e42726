//! Settings from a file: read completely, checked completely, and only then applied.

use mobgate::gateway::Gateway;
use mobgate::gateway::reconfigure::{self, Unchanged};
use mobgate::hal::StoreError;
use mobgate::language::{LineBuffer, Loader, write_line};
use mobgate::settings::{PortKind, Settings, StreamFraming, TcpListen, TcpServerSettings};

use crate::store::FileStore;

/// Reads the file of `store` into `settings`, if `gateway` can apply them; otherwise returns what is wrong with it, and where.
pub async fn read(
    gateway: &Gateway<'_>,
    store: &mut FileStore,
    settings: &mut Settings,
) -> Result<(), String> {
    let path = store.path().map_err(|error| error.to_string())?.to_owned();
    let fault = match reconfigure::read(gateway, store, settings).await {
        // An existing file without lines is valid, too.
        Ok(0) if !path.exists() => {
            "no such file (an empty one is a good start: settings can be typed at the console)".to_owned()
        }
        Ok(_) => return Ok(()),
        Err(Unchanged::Text(error)) => error.to_string(),
        Err(Unchanged::Refused(error)) => error.to_string(),
        Err(Unchanged::Store(StoreError::Refused(reason))) => reason.to_owned(),
        Err(error) => error.to_string(),
    };
    Err(format!("{}: {fault}", path.display()))
}

/// Parses the settings in `text`.
pub fn parse(text: &str) -> Result<Settings, String> {
    let mut settings = Settings::new();
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut settings, &mut line);
    loader.feed(text.as_bytes()).and_then(|()| loader.finish()).map_err(|error| error.to_string())?;
    Ok(settings)
}

/// Prints `settings` as lines.
pub fn print(settings: &Settings) -> String {
    let mut text = String::new();
    let mut n = 0;
    // Writing to a `String` cannot fail.
    while write_line(settings, n, &mut text).is_some() {
        text.push('\n');
        n += 1;
    }
    text
}

/// Names and listen addresses of the TCP servers, and of the clients whose devices connect.
pub fn tcp_servers(settings: &Settings) -> impl Iterator<Item = (&str, &TcpListen)> {
    settings.ports.iter().flatten().filter_map(|port| match &port.kind {
        PortKind::TcpServer(server) => Some((port.name.as_str(), &server.listen)),
        PortKind::TcpClient(client) => Some((port.name.as_str(), client.listens()?)),
        _ => None,
    })
}

/// Moves the first TCP server to `listen`; returns whether there is one.
pub fn redirect(settings: &mut Settings, listen: TcpListen) -> bool {
    let first = settings.ports.iter_mut().flatten().find_map(|port| match &mut port.kind {
        // Who names an address for Modbus does not mean that of the console.
        PortKind::TcpServer(server) if server.framing != StreamFraming::Ssh => Some(server),
        _ => None,
    });
    first.map(|server: &mut TcpServerSettings| server.listen = listen).is_some()
}
