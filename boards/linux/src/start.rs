//! The start: which settings are in force and which listeners they need.

use std::path::Path;
use std::rc::Rc;

use mobgate::gateway::Gateway;
use mobgate::settings::{Settings, TcpListen};

use crate::cli::Options;
use crate::demo;
use crate::reactor::block_on;
use crate::settings::{self, tcp_servers};
use crate::store::FileStore;
use crate::tcp::{Listener, TcpSockets};

/// Settings, and their listeners, which are held until the tasks that accept have taken them.
pub struct Start {
    /// What the gateway takes over.
    pub settings: Settings,
    /// The open listeners.
    pub listeners: Vec<Rc<Listener>>,
}

/// What the program starts with: the configuration file's settings, or the demo's.
pub fn prepare(
    gateway: &Gateway<'_>,
    options: &Options,
    store: &mut FileStore,
    sockets: &TcpSockets,
) -> Result<Start, String> {
    match &options.config {
        Some(file) if !options.demo.has_settings() => {
            configured(gateway, file, store, options.listen, sockets)
        }
        _ => demo::start(options, sockets),
    }
}

/// The file's settings. A TCP port that cannot be opened is an error: whoever configured it counts on it.
fn configured(
    gateway: &Gateway<'_>,
    file: &Path,
    store: &mut FileStore,
    listen: Option<TcpListen>,
    sockets: &TcpSockets,
) -> Result<Start, String> {
    let mut settings = Settings::new();
    block_on(settings::read(gateway, store, &mut settings))?;
    if let Some(listen) = listen
        && !settings::redirect(&mut settings, listen)
    {
        return Err(format!("--listen: {} has no TCP server", file.display()));
    }
    let open = |(name, at)| sockets.open(at).map_err(|error| format!("port {name}: TCP port {at}: {error}"));
    let listeners = tcp_servers(&settings).map(open).collect::<Result<_, _>>()?;
    Ok(Start { settings, listeners })
}
