//! Start-up: finds the settings and opens their listeners; who starts the program, and how it starts again.

use std::os::unix::process::CommandExt;
use std::process::Command;
use std::rc::Rc;

use mobgate::gateway::Gateway;
use mobgate::settings::Settings;
use rustix::process::geteuid;

use crate::cli::Options;
use crate::demo;
use crate::reactor::block_on;
use crate::settings::{self, tcp_servers};
use crate::store::FileStore;
use crate::tcp::{Listener, TcpSockets};

/// Set for the program that this one becomes when it starts again.
const STARTED_BY: &str = "MOBGATE_STARTED_BY";

/// Settings, and their listeners, which are held until the accepting tasks have taken them.
pub struct Start {
    /// The settings to apply.
    pub settings: Settings,
    /// The open listeners.
    pub listeners: Vec<Rc<Listener>>,
}

/// Reads the configuration file; `None` means the demo's settings. Opens nothing.
pub fn read(
    gateway: &Gateway<'_>,
    options: &Options,
    store: &mut FileStore,
) -> Result<Option<Settings>, String> {
    let file = match &options.config {
        Some(file) if !options.demo.has_settings() => file,
        _ => return demo::check(&options.demo, options.config.as_deref()).map(|()| None),
    };
    let mut settings = Settings::new();
    block_on(settings::read(gateway, store, &mut settings))?;
    if let Some(listen) = options.listen
        && !settings::redirect(&mut settings, listen)
    {
        return Err(format!("--listen: {} has no TCP server", file.display()));
    }
    Ok(Some(settings))
}

/// Opens the TCP ports of `settings`, or of the demo. Fails if one cannot be opened: its user relies on it.
pub fn listen(settings: Option<Settings>, options: &Options, sockets: &TcpSockets) -> Result<Start, String> {
    let Some(settings) = settings else {
        let (settings, listeners) = demo::start(&options.demo, options.listen, sockets)?;
        return Ok(Start { settings, listeners });
    };
    let open = |(name, at)| sockets.open(at).map_err(|error| format!("port {name}: TCP port {at}: {error}"));
    let listeners = tcp_servers(&settings).map(open).collect::<Result<_, _>>()?;
    Ok(Start { settings, listeners })
}

/// Who has started the program.
pub fn by() -> String {
    match std::env::var(STARTED_BY) {
        Ok(by) => by,
        Err(_) if std::env::var_os("INVOCATION_ID").is_some() => "by the service manager".to_owned(),
        Err(_) => format!("by user {}", geteuid().as_raw()),
    }
}

/// Replaces this process by a new one of the same program; returns only on an error.
pub fn again() -> std::io::Error {
    let mut arguments = std::env::args_os();
    let name = arguments.next().unwrap_or_else(|| "mobgate".into());
    Command::new("/proc/self/exe").arg0(name).args(arguments).env(STARTED_BY, "by reboot").exec()
}
