//! The start: which settings are in force and which listeners they need.

use std::path::Path;
use std::rc::Rc;

use mobgate::gateway::Gateway;
use mobgate::settings::{Settings, TcpListen};

use crate::cli::{DemoKind, Options};
use crate::reactor::block_on;
use crate::settings::{self, tcp_servers};
use crate::store::FileStore;
use crate::tcp::{Listener, TcpSockets};
use crate::{demo, ethercat};

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
        Some(_) if matches!(options.demo, Some(DemoKind::Ethercat(_))) => {
            Err("--demo ethercat has its own settings: start it without --config".to_owned())
        }
        Some(file) => configured(gateway, file, store, options.listen, sockets),
        None => demonstrated(options, sockets),
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

/// The demo's settings, on the first of its TCP ports that may be opened.
fn demonstrated(options: &Options, sockets: &TcpSockets) -> Result<Start, String> {
    let Options { demo, listen, .. } = options;
    let interface = match demo {
        Some(DemoKind::Ethercat(name)) => Some(name.as_str()),
        Some(DemoKind::Modbus) | None => None,
    };
    if let Some(name) = interface {
        // Who asked for it counts on it.
        let needs = || demo::ethercat_needs(name);
        ethercat::check(name).map_err(|fault| format!("--demo ethercat: {fault}\n{}", needs()))?;
    }
    let default = demo::TCP_PORTS.map(|port| TcpListen { address: None, port });
    let candidates = listen.as_ref().map_or(&default[..], std::slice::from_ref);
    let mut faults = Vec::new();
    for at in candidates {
        match sockets.open(at) {
            Ok(listener) => {
                let ethercat = interface.map(demo::ethercat_settings).unwrap_or_default();
                let settings = settings::parse(&(demo::settings_text(at) + &ethercat))?;
                print!("{}", demo::invitation(at));
                interface.into_iter().for_each(|name| print!("{}", demo::ethercat_invitation(name)));
                return Ok(Start { settings, listeners: vec![listener] });
            }
            Err(error) => faults.push(format!("TCP port {at}: {error}")),
        }
    }
    Err(faults.join("; "))
}
