//! mobgate as a Linux program: the gateway's statics and tasks, and what happens at the start and at signals.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::rc::Rc;

use async_signal::{Signal as SystemSignal, Signals};
use clap::Parser;
use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use futures_lite::StreamExt;
use mobgate::config::{PORTS_MAX, PortId, Settings, TcpListen};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, PortPlace, Seat};
use mobgate_linux::cli::Options;
use mobgate_linux::demo::{self, Demo};
use mobgate_linux::lines::Lines;
use mobgate_linux::settings::{self, tcp_servers};
use mobgate_linux::tcp::{Listener, TcpSockets};
use mobgate_linux::{executor, logging};

/// TCP connections of all servers together. Each takes a descriptor, of which a process has 1024 by default.
const SEATS: usize = 256;
/// Frames: one for each seat and each port, and as many again for those who ask several things at a time.
const FRAMES: usize = 2 * RESERVED;
const RESERVED: usize = SEATS + PORTS_MAX;

static SLOTS: [Slot; FRAMES] = [const { Slot::new() }; FRAMES];
static POOL: FramePool<'static> = FramePool::new(&SLOTS, RESERVED);
static PLACES: [PortPlace; PORTS_MAX] = [const { PortPlace::new() }; PORTS_MAX];
static SEAT_PLACES: [Seat; SEATS] = [const { Seat::new() }; SEATS];
static GATEWAY: Gateway<'static> = Gateway::new(&POOL, &PLACES, &SEAT_PLACES);

/// The end of the program.
static END: Signal<CriticalSectionRawMutex, ()> = Signal::new();

#[embassy_executor::task]
async fn router() {
    GATEWAY.route().await
}

#[embassy_executor::task(pool_size = PORTS_MAX)]
async fn port(id: PortId, mut lines: Lines) {
    GATEWAY.run_port(id, &mut lines).await
}

#[embassy_executor::task(pool_size = SEATS)]
async fn seat(index: usize, mut sockets: TcpSockets) {
    GATEWAY.run_seat(index, &mut sockets).await
}

#[embassy_executor::task]
async fn demo_devices(demo: Demo) {
    demo.run().await
}

#[embassy_executor::task]
async fn signals(mut signals: Signals, config: Option<PathBuf>) {
    while let Some(Ok(signal)) = signals.next().await {
        match (signal, &config) {
            (SystemSignal::Hup, Some(file)) => reload(file),
            _ => {
                log::info!("ended by {signal:?}");
                END.signal(());
            }
        }
    }
}

fn main() -> ExitCode {
    let options = Options::parse();
    let ended = match &options.check {
        Some(file) => check(file),
        None => run(options),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("mobgate: {fault}");
            ExitCode::FAILURE
        }
    }
}

/// Says whether the settings in `file` are good.
fn check(file: &Path) -> Result<(), String> {
    let settings = settings_of(file)?;
    GATEWAY.apply(&settings).map_err(|error| format!("{}: {error}", file.display()))?;
    settings.warnings().for_each(|warning| println!("{}: {warning}", file.display()));
    println!("{}: good", file.display());
    Ok(())
}

fn run(options: Options) -> Result<(), String> {
    logging::start();
    // First of all: who sees a port open may send a signal.
    let signals = Signals::new([SystemSignal::Term, SystemSignal::Int, SystemSignal::Hup])
        .map_err(|error| format!("signals cannot be caught: {error}"))?;
    let sockets = TcpSockets::default();
    let (settings, listeners) = match &options.config {
        Some(file) => configured(file, options.listen, &sockets)?,
        None => demonstrated(options.listen, &sockets)?,
    };
    GATEWAY.apply(&settings).map_err(|error| error.to_string())?;
    settings.warnings().for_each(|warning| log::warn!("{warning}"));

    let demo = options.runs_demo().then(Demo::default);
    let lines = demo.as_ref().map(|demo| Lines::with_demo(demo.serial())).unwrap_or_default();
    executor::run(|spawner| spawn(spawner, demo, lines, sockets, signals, options), async {
        // The seats have their listeners by now.
        drop(listeners);
        END.wait().await
    });
    Ok(())
}

fn spawn(
    spawner: Spawner,
    demo: Option<Demo>,
    lines: Lines,
    sockets: TcpSockets,
    caught: Signals,
    options: Options,
) {
    // A pool has as many places as tasks are spawned here, once, so none of these can be refused.
    spawner.spawn(router().unwrap());
    spawner.spawn(signals(caught, options.config).unwrap());
    for index in 0..PORTS_MAX {
        spawner.spawn(port(PortId(index as u8), lines.clone()).unwrap());
    }
    for index in 0..SEATS {
        spawner.spawn(seat(index, sockets.clone()).unwrap());
    }
    if let Some(demo) = demo {
        spawner.spawn(demo_devices(demo).unwrap());
    }
}

/// Settings, and the listeners that they ask for, held until their tasks have taken them.
type Start = (Settings, Vec<Rc<Listener>>);

/// The file's settings. A TCP port that cannot be opened ends the program: whoever configured it counts on it.
fn configured(file: &Path, listen: Option<TcpListen>, sockets: &TcpSockets) -> Result<Start, String> {
    let mut settings = settings_of(file)?;
    if let Some(listen) = listen
        && !settings::redirect(&mut settings, listen)
    {
        return Err(format!("--listen: {} has no TCP server", file.display()));
    }
    let opened: Result<_, String> = tcp_servers(&settings)
        .map(|(name, at)| sockets.open(at).map_err(|error| format!("port {name}: TCP port {at}: {error}")))
        .collect();
    Ok((settings, opened?))
}

/// The demo's settings, on the first of its ports that may be opened.
fn demonstrated(listen: Option<TcpListen>, sockets: &TcpSockets) -> Result<Start, String> {
    let default = demo::TCP_PORTS.map(|port| TcpListen { address: None, port });
    let candidates = listen.as_ref().map_or(&default[..], std::slice::from_ref);
    let mut fault = String::new();
    for at in candidates {
        match sockets.open(at) {
            Ok(listener) => {
                let text = demo::settings_text(at);
                let settings = settings::parse(text.as_bytes()).map_err(|error| error.to_string())?;
                print!("{}", demo::invitation(at));
                return Ok((settings, vec![listener]));
            }
            Err(error) => fault = format!("TCP port {at}: {error}"),
        }
    }
    Err(fault)
}

fn settings_of(file: &Path) -> Result<Settings, String> {
    settings::read(file).map_err(|refusal| format!("{}: {refusal}", file.display()))
}

/// Takes over what the file says now, or nothing of it.
fn reload(file: &Path) {
    let applied =
        settings_of(file).and_then(|settings| GATEWAY.apply(&settings).map_err(|error| error.to_string()));
    match applied {
        Ok(()) => log::info!("{}: taken over", file.display()),
        Err(fault) => log::error!("{fault}; everything stays as it was"),
    }
}
