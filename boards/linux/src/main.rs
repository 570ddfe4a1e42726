//! mobgate as a Linux program: the gateway's statics and tasks, start-up, signals and shutdown.

use std::fmt;
use std::path::Path;
use std::process::ExitCode;
use std::rc::Rc;

use embassy_executor::Spawner;
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use mobgate::capture::Capture;
use mobgate::console::serve_files;
use mobgate::fieldbus::{EthercatState, FileBuffer};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::audit::{Actor, AuditMemory, Topic};
use mobgate::gateway::reconfigure;
use mobgate::gateway::{Candidate, Connection, Gateway, Ports};
use mobgate::hal::{OpenError, System};
use mobgate::scanner::ScannerState;
use mobgate::settings::{
    Certificate, PORTS_MAX, PasswordHash, Port, PortId, PortKind, Settings, StreamFraming, TcpListen,
};
use mobgate::web;
use mobgate_linux::cli::{Instead, Options, User};
use mobgate_linux::console::{SESSIONS_MAX, Sessions, socket};
use mobgate_linux::demo::{self, Lines};
use mobgate_linux::reactor::block_on;
use mobgate_linux::signals::{Signal as Caught, Signals};
use mobgate_linux::start;
use mobgate_linux::stdio::TerminalMode;
use mobgate_linux::store::FileStore;
use mobgate_linux::syslog::SyslogSockets;
use mobgate_linux::tcp::{Connector, TcpSockets};
use mobgate_linux::udp::Datagrams;
use mobgate_linux::{
    calendar, capture, console, describe, ethercat, executor, logging, mdns, passwords, service, settings,
    ssh, tls, tty,
};
use rustix::rand::{GetRandomFlags, getrandom};

/// TCP connections of all servers together. Each takes a descriptor, and a process has 1024 by default.
const CONNECTIONS: usize = 256;
/// Connections of the web interface: as many as it has.
const WEB_CONNECTIONS: usize = 8;
/// One frame for each connection and each port.
const RESERVED: usize = CONNECTIONS + PORTS_MAX;
/// As many again for clients that pipeline requests.
const FRAMES: usize = 2 * RESERVED;

static SLOTS: [Slot; FRAMES] = [const { Slot::new() }; FRAMES];
static POOL: FramePool<'static> = FramePool::new(&SLOTS, RESERVED);
static PORT_STATES: Ports<PORTS_MAX> = Ports::new();
static CONNECTION_STATES: [Connection; CONNECTIONS] = [const { Connection::new() }; CONNECTIONS];
static POINTS: ScannerState = ScannerState::new();
static CANDIDATE: Candidate = Candidate::new();
static AUDIT: AuditMemory = AuditMemory::new();
static CAPTURE: Capture = Capture::new();
/// The gateway as an EtherCAT SubDevice.
static ETHERCAT: EthercatState = EthercatState::long();
/// Its files.
static FILES: FileBuffer = FileBuffer::new();
static GATEWAY: Gateway<'static> = Gateway::new(&POOL, &PORT_STATES, &CONNECTION_STATES)
    .with_candidate(&CANDIDATE)
    .with_audit(&AUDIT)
    .with_scanner(&POINTS)
    .with_ethercat_interfaces(&ETHERCAT)
    .with_capture(&CAPTURE)
    .with_same_device(tty::are_same);

/// Longest wait for the syslog server at the end.
const LAST_WORDS_MAX: Duration = Duration::from_millis(500);

/// The capture file requested next; `None` ends the capture.
static CAPTURE_FILE: capture::Wanted = Signal::new();
/// How the program is to end.
static END: Signal<CriticalSectionRawMutex, End> = Signal::new();

enum End {
    /// Stop the program.
    Stop,
    /// Restart with the same options.
    Restart,
}

#[embassy_executor::task]
async fn router() -> ! {
    GATEWAY.route().await
}

#[embassy_executor::task(pool_size = PORTS_MAX)]
async fn port(id: PortId, mut lines: Lines) -> ! {
    match GATEWAY.run_port(id, &mut lines, &Connector, &mut Datagrams).await {}
}

#[embassy_executor::task(pool_size = CONNECTIONS)]
async fn connection(index: usize, mut sockets: TcpSockets) -> ! {
    match GATEWAY.run_connection(index, &mut sockets).await {}
}

#[embassy_executor::task]
async fn found_on_the_network() {
    mdns::run(&GATEWAY).await
}

#[embassy_executor::task(pool_size = WEB_CONNECTIONS)]
async fn web_connection(nth: usize, mut sockets: TcpSockets, mut store: FileStore) {
    web::run(&GATEWAY, nth, &mut sockets, (&mut store, &mut console::by_package()), &Process).await
}

#[embassy_executor::task]
async fn ethercat_controller() {
    ethercat::run(&GATEWAY, &ETHERCAT, &FILES).await
}

/// Saves on a MainDevice's request, and serves its files.
#[embassy_executor::task]
async fn keep_settings(mut store: FileStore) {
    let mut files = store.clone();
    join(GATEWAY.keep_settings(&mut store), serve_files(&GATEWAY, &FILES, &mut files, &Process)).await;
}

#[embassy_executor::task]
async fn commits() {
    GATEWAY.watch_commits().await;
}

#[embassy_executor::task]
async fn certificates() {
    tls::watch(&GATEWAY).await
}

#[embassy_executor::task]
async fn service_manager() {
    service::run().await
}

#[embassy_executor::task]
async fn audit_trail() {
    join(GATEWAY.settle_audits(), GATEWAY.forward_audit(&mut SyslogSockets)).await;
}

#[embassy_executor::task]
async fn publishers() {
    GATEWAY.publish(&Connector, calendar::known).await
}

#[embassy_executor::task]
async fn capture_into_file() {
    capture::run(&GATEWAY, &CAPTURE_FILE).await
}

#[embassy_executor::task]
async fn console_on_stdio(store: FileStore) {
    if console::on_stdio(&GATEWAY, store, &Process).await {
        end("Ctrl-C");
    }
}

#[embassy_executor::task]
async fn console_on_socket(sessions: Rc<Sessions>, listener: socket::Listener) {
    console::on_socket(&GATEWAY, &sessions, listener).await
}

#[embassy_executor::task]
async fn console_on_tcp(sessions: Rc<Sessions>, sockets: TcpSockets, listen: TcpListen) {
    console::on_tcp(&sessions, sockets, listen).await
}

#[embassy_executor::task]
async fn console_by_ssh(sessions: Rc<Sessions>) {
    console::by_ssh(&sessions).await
}

#[embassy_executor::task(pool_size = SESSIONS_MAX + ssh::SESSIONS_MAX)]
async fn console_session(sessions: Rc<Sessions>, number: usize, store: FileStore) {
    sessions.serve(number, &GATEWAY, store, &Process).await
}

#[embassy_executor::task]
async fn signals(mut caught: Signals, mut store: FileStore) {
    loop {
        match (caught.next().await, store.path()) {
            (Caught::Reload, Ok(_)) => match reload(&mut store).await {
                Ok(file) => GATEWAY.audit(Topic::Settings, Actor::System, format_args!("{file}: taken over")),
                Err(fault) => log::error!("{fault}; everything stays as it was"),
            },
            (Caught::Reload, Err(_)) => end("SIGHUP"),
            (Caught::End(name), _) => {
                end(name);
            }
        }
    }
}

/// Ends the program because of `reason`.
fn end(reason: &str) {
    GATEWAY.audit(Topic::Start, Actor::System, format_args!("ended by {reason}"));
    END.signal(End::Stop);
}

/// The console's interface to this program.
struct Process;

impl System for Process {
    fn name(&self) -> &str {
        "Linux"
    }

    fn write_serial_line(&self, n: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        Some(out.write_str(&tty::names::nth(n)?))
    }

    fn capture(&self, file: Option<&str>) -> Result<(), OpenError> {
        CAPTURE_FILE.signal(file.map(capture::create_new).transpose()?);
        Ok(())
    }

    fn write_date(&self, at: Instant, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        Some(write!(out, "{:.0}", calendar::date(at)))
    }

    fn write_certificate(&self, certificate: &Certificate, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        Some(tls::write(certificate, out))
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        passwords::is_right(hash, password).await
    }

    async fn hash_password(&self, password: &str) -> Option<PasswordHash> {
        passwords::hash(password).await
    }

    fn random(&self, into: &mut [u8]) -> bool {
        // As many as a token needs come at once.
        getrandom(&mut *into, GetRandomFlags::empty()).is_ok_and(|count| count == into.len())
    }

    fn reboot(&self) {
        END.signal(End::Restart);
    }
}

fn main() -> ExitCode {
    let options = Options::of_command_line();
    let ended = match (&options.instead, &options.check) {
        (Some(Instead::Console(join)), _) => return console::client::run(join),
        (Some(Instead::User(User::Add(user))), _) => return console::user::add(user),
        (Some(Instead::Make(make)), _) => describe::write(make).map(|()| End::Stop),
        (None, Some(file)) => check(file).map(|()| End::Stop),
        (None, None) => run(options),
    };
    logging::finish();
    match ended {
        Ok(End::Stop) => return ExitCode::SUCCESS,
        Ok(End::Restart) => eprintln!("mobgate: cannot start again: {}", start::again()),
        Err(fault) => eprintln!("mobgate: {fault}"),
    }
    ExitCode::FAILURE
}

/// Checks the settings in `file` and prints the result.
fn check(file: &Path) -> Result<(), String> {
    let mut settings = Settings::new();
    let mut store = FileStore::untouched(Some(file.to_owned()));
    block_on(settings::read(&GATEWAY, &mut store, &mut settings))?;
    GATEWAY.apply(&settings).map_err(|error| format!("{}: {error}", file.display()))?;
    settings.warnings().for_each(|warning| println!("{}: {warning}", file.display()));
    for certificate in settings.certificates() {
        let state = tls::state(certificate);
        if !state.is_empty() {
            println!("{}: certificate {}: {state}", file.display(), certificate.name);
        }
    }
    println!("{}: good", file.display());
    Ok(())
}

fn run(options: Options) -> Result<End, String> {
    logging::start().map_err(|error| format!("no thread for the log: {error}"))?;
    // First: once a port is open, signals may arrive.
    let caught = Signals::catch().map_err(|error| format!("signals cannot be caught: {error}"))?;
    let sockets = TcpSockets::default();
    let console = console::open_tcp(options.console, &sockets)?;
    let mut store = FileStore::new(options.config.clone());
    let settings = start::read(&GATEWAY, &options, &mut store)?;
    // After the settings: a start that fails on them leaves no socket behind. Before the ports: once one is open, the console must
    // be available.
    let (socket, _claim_until_the_end) = socket::open(options.socket.as_ref())?.unzip();
    let start = start::listen(settings, &options, &sockets)?;
    if let Some(file) = &options.capture {
        CAPTURE_FILE.signal(Some(capture::create(file)?));
    }
    CAPTURE.set_epoch(capture::epoch_us());
    reconfigure::take_over(&GATEWAY, &mut store, &start.settings).map_err(|error| error.to_string())?;
    audit_start(&options);
    tls::start(&GATEWAY);
    let is_ssh = |port: &Port| matches!(&port.kind, PortKind::TcpServer(server) if server.framing == StreamFraming::Ssh);
    ssh::start(&GATEWAY, options.config.clone(), start.settings.ports.iter().flatten().any(is_ssh));
    start.settings.warnings().for_each(|warning| log::warn!("{warning}"));

    let _raw_until_the_end = TerminalMode::raw();
    let listen = console.as_ref().map(|(listen, _)| *listen);
    let spawn = |spawner| spawn(spawner, options, store, sockets, caught, (socket, listen));
    Ok(executor::run(spawn, async {
        // The tasks have been polled once, so they now hold their listeners.
        drop((start, console));
        let end = END.wait().await;
        if matches!(end, End::Stop) {
            service::stops();
        }
        last_words().await;
        end
    }))
}

/// Writes into the audit trail what starts, and by whom.
fn audit_start(options: &Options) {
    let (by, version, file) = (start::by(), env!("CARGO_PKG_VERSION"), options.config.as_deref());
    let settings = file.map_or("without a file".to_owned(), |file| format!("with {}", file.display()));
    GATEWAY.audit(Topic::Start, Actor::System, format_args!("start of {version} {by}, {settings}"));
}

/// Gives the syslog server, if there is one, some time to take the last lines.
async fn last_words() {
    let until = Instant::now() + LAST_WORDS_MAX;
    let is_forwarded = GATEWAY.settings(|settings| settings.syslog().is_some());
    while is_forwarded && !GATEWAY.is_audit_sent() && Instant::now() < until {
        Timer::after_millis(1).await;
    }
}

fn spawn(
    spawner: Spawner,
    options: Options,
    store: FileStore,
    sockets: TcpSockets,
    caught: Signals,
    (socket, console): (Option<socket::Listener>, Option<TcpListen>),
) {
    let lines = demo::spawn(&options.demo, options.config.as_deref(), spawner);
    // Each pool has room for the tasks spawned here, and this runs once: no `unwrap` can fail.
    spawner.spawn(router().unwrap());
    spawner.spawn(signals(caught, store.clone()).unwrap());
    for index in 0..PORTS_MAX {
        spawner.spawn(port(PortId(index as u8), lines.clone()).unwrap());
    }
    for index in 0..CONNECTIONS {
        spawner.spawn(connection(index, sockets.clone()).unwrap());
    }
    for nth in 0..WEB_CONNECTIONS {
        spawner.spawn(web_connection(nth, sockets.clone(), store.clone()).unwrap());
    }
    spawner.spawn(ethercat_controller().unwrap());
    spawner.spawn(keep_settings(store.clone()).unwrap());
    spawner.spawn(capture_into_file().unwrap());
    spawner.spawn(audit_trail().unwrap());
    spawner.spawn(found_on_the_network().unwrap());
    spawner.spawn(publishers().unwrap());
    spawner.spawn(certificates().unwrap());
    spawner.spawn(service_manager().unwrap());
    spawner.spawn(commits().unwrap());
    let [sessions, by_ssh] = [SESSIONS_MAX, ssh::SESSIONS_MAX].map(|count| {
        let sessions = Rc::new(Sessions::new(count));
        for number in 0..count {
            spawner.spawn(console_session(sessions.clone(), number, store.clone()).unwrap());
        }
        sessions
    });
    spawner.spawn(console_by_ssh(by_ssh).unwrap());
    if let Some(listener) = socket {
        spawner.spawn(console_on_socket(sessions.clone(), listener).unwrap());
    }
    if let Some(listen) = console {
        spawner.spawn(console_on_tcp(sessions, sockets, listen).unwrap());
    }
    spawner.spawn(console_on_stdio(store).unwrap());
}

/// Applies the settings in the file, all or nothing; returns the file's name. Unsaved settings are kept in a file beside it.
async fn reload(store: &mut FileStore) -> Result<String, String> {
    let file = store.path().map_err(|error| error.to_string())?.display().to_string();
    // Holding the draft keeps others from changing or saving settings meanwhile.
    let mut draft = reconfigure::draft(&GATEWAY).await;
    if GATEWAY.has_unsaved() {
        let aside = store.keep_aside(&GATEWAY.settings(settings::print))?;
        log::warn!("{}: has the changes that were not saved", aside.display());
    }
    settings::read(&GATEWAY, store, &mut draft).await?;
    GATEWAY.audit_difference(Actor::System, &draft);
    reconfigure::take_over(&GATEWAY, store, &draft).map_err(|error| format!("{file}: {error}"))?;
    Ok(file)
}
