//! Settings from a file: read as a whole, checked as a whole, and only then taken over.

use mobgate::gateway::Gateway;
use mobgate::gateway::reconfigure::{self, Unchanged};
use mobgate::hal::StoreError;
use mobgate::language::{Loader, write_line};
use mobgate::settings::{PortKind, Settings, TcpListen, TcpServerSettings};

use crate::store::FileStore;

/// Reads the settings that the file in `store` says into `settings`, if `gateway` can have them; or says what is wrong with it,
/// and where.
pub async fn read(
    gateway: &Gateway<'_>,
    store: &mut FileStore,
    settings: &mut Settings,
) -> Result<(), String> {
    let path = store.path().map_err(|error| error.to_string())?.to_owned();
    let fault = match reconfigure::read(gateway, store, settings).await {
        // A file without a line is one, too.
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

/// The settings that `text` says.
pub fn parse(text: &str) -> Result<Settings, String> {
    let mut settings = Settings::new();
    let mut loader = Loader::new(&mut settings);
    loader.feed(text.as_bytes()).and_then(|()| loader.finish()).map_err(|error| error.to_string())?;
    Ok(settings)
}

/// The lines that `settings` print.
pub fn print(settings: &Settings) -> String {
    let mut text = String::new();
    let mut n = 0;
    // A string takes all that is written.
    while write_line(settings, n, &mut text).is_some() {
        text.push('\n');
        n += 1;
    }
    text
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
