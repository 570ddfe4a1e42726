//! The console by SSH: serves the connections of SSH servers by russh, in a thread of its own.
//!
//! The path of a session: the core accepts a connection and calls `serve`, which hands its socket to the thread; there tokio runs
//! the protocol, and a `Client` logs in as the gateway decides. What a client then types reaches the console through a pair of
//! sockets as an `Entrant`, and what the console writes comes back. So the cryptography delays no line, and a session is one of
//! the console like others.

use std::borrow::Cow;
use std::io;
use std::net::{IpAddr, Shutdown, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::Duration;

use mobgate::gateway::Gateway;
use mobgate::settings::PortId;
use russh::keys::{Algorithm, PrivateKey};
use russh::server::{Config, run_stream};
use russh::{Preferred, SshId, cipher, compression, kex, mac};
use tokio::runtime;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::sleep;

mod client;
mod entrant;
mod host_key;
mod session;

use self::client::{Client, Event, News, methods};
pub use self::entrant::{Entrant, SESSIONS_MAX, Who, next_entrant};

/// A client that has not logged in after this time is disconnected.
const LOG_IN_MAX: Duration = Duration::from_secs(60);
/// Refused attempts to log in, each with a key or a password, that end a connection.
const ATTEMPTS_MAX: usize = 10;
/// A refusal takes this long, whatever the reason.
const REFUSAL: Duration = Duration::from_millis(300);
/// A client that sends nothing for this long gets a keepalive; after this many unanswered ones it is disconnected.
const KEEPALIVE: Duration = Duration::from_secs(60);
const KEEPALIVES_MAX: usize = 3;
/// A connection without a packet for this long is closed. Sessions end earlier: their console ends them.
const IDLE_MAX: Duration = Duration::from_secs(40 * 60);
/// Bytes that a client may send ahead, and those of a packet.
const WINDOW_BYTES: u32 = 64 * 1024;
const PACKET_BYTES_MAX: u32 = 32 * 1024;

/// What the program serves connections with, once [`start`] has been called.
static SETUP: OnceLock<Setup> = OnceLock::new();

struct Setup {
    gateway: &'static Gateway<'static>,
    /// The host key's file, if there is a file of settings that it can be beside.
    host_key: Option<PathBuf>,
    /// To the thread; `None` if it cannot serve.
    connections: OnceLock<Option<UnboundedSender<Connection>>>,
}

/// A connection on its way to the thread.
struct Connection {
    stream: TcpStream,
    port: PortId,
    peer: IpAddr,
    news: News,
}

/// Shuts a connection down when dropped, which ends whatever serves it.
struct Cut(TcpStream);

impl Drop for Cut {
    fn drop(&mut self) {
        let _ = self.0.shutdown(Shutdown::Both);
    }
}

/// Tells that a connection has ended when dropped.
struct Ending(News);

impl Drop for Ending {
    fn drop(&mut self) {
        self.0.signal(Event::Ended);
    }
}

/// Lets connections be served for the gateway, whose settings are in the file `settings`. The thread starts, and the host key is made,
/// with the first connection, or with `at_once`.
pub fn start(gateway: &'static Gateway<'static>, settings: Option<PathBuf>, at_once: bool) {
    let setup =
        Setup { gateway, host_key: settings.as_deref().map(host_key::beside), connections: OnceLock::new() };
    let setup = SETUP.get_or_init(|| setup);
    if at_once {
        setup.connections();
    }
}

/// Serves the connection `io` until it ends; calls `logged_in` once somebody has logged in.
pub(crate) async fn serve(io: &TcpStream, port: PortId, peer: SocketAddr, logged_in: &dyn Fn()) {
    let Some(connections) = SETUP.get().and_then(Setup::connections) else { return };
    let (Ok(stream), Ok(cut)) = (io.try_clone(), io.try_clone()) else { return };
    let (_cut, news) = (Cut(cut), News::default());
    // The thread ends with the program.
    let _ = connections.send(Connection { stream, port, peer: peer.ip(), news: news.clone() });
    while let Event::LoggedIn = news.wait().await {
        logged_in();
    }
}

impl Setup {
    fn connections(&self) -> Option<&UnboundedSender<Connection>> {
        let start = || self.start().inspect_err(|error| log::error!("SSH cannot be served: {error}")).ok();
        self.connections.get_or_init(start).as_ref()
    }

    fn start(&self) -> Result<UnboundedSender<Connection>, String> {
        let config = Arc::new(config(host_key::open(self.host_key.as_deref())?));
        let runtime = runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| format!("no runtime: {error}"))?;
        let ((sender, connections), gateway) = (unbounded_channel(), self.gateway);
        let work = move || runtime.block_on(accept(connections, config, gateway));
        let thread = thread::Builder::new().name("ssh".into()).spawn(work);
        thread.map_err(|error| format!("no thread: {error}")).map(|_| sender)
    }
}

/// Modern algorithms, and none for older clients.
fn config(key: PrivateKey) -> Config {
    const KEX: &[kex::Name] = &[
        kex::MLKEM768X25519_SHA256,
        kex::CURVE25519,
        kex::CURVE25519_PRE_RFC_8731,
        kex::EXTENSION_SUPPORT_AS_SERVER,
        kex::EXTENSION_OPENSSH_STRICT_KEX_AS_SERVER,
    ];
    Config {
        server_id: SshId::Standard(Cow::Borrowed("SSH-2.0-mobgate")),
        methods: methods(),
        keys: vec![key],
        preferred: Preferred {
            kex: Cow::Borrowed(KEX),
            key: Cow::Borrowed(&[Algorithm::Ed25519]),
            cipher: Cow::Borrowed(&[cipher::CHACHA20_POLY1305, cipher::AES_256_GCM]),
            // Unused with these ciphers, but the list must not be empty.
            mac: Cow::Borrowed(&[mac::HMAC_SHA256_ETM]),
            compression: Cow::Borrowed(&[compression::NONE]),
            ..Preferred::DEFAULT
        },
        max_auth_attempts: ATTEMPTS_MAX,
        auth_rejection_time: REFUSAL,
        // A request for the list of methods.
        auth_rejection_time_initial: Some(Duration::ZERO),
        inactivity_timeout: Some(IDLE_MAX),
        keepalive_interval: Some(KEEPALIVE),
        keepalive_max: KEEPALIVES_MAX,
        window_size: WINDOW_BYTES,
        maximum_packet_size: PACKET_BYTES_MAX,
        ..Config::default()
    }
}

/// Serves connections as they come. There are as many at a time as the gateway has.
async fn accept(
    mut connections: UnboundedReceiver<Connection>,
    config: Arc<Config>,
    gateway: &'static Gateway<'static>,
) {
    while let Some(connection) = connections.recv().await {
        let config = config.clone();
        tokio::spawn(async move {
            let peer = connection.peer;
            let ended = serve_one(connection, config, gateway).await;
            log::debug!("SSH connection of {peer} has ended: {ended:?}");
        });
    }
}

/// Serves a connection until its end.
async fn serve_one(
    Connection { stream, port, peer, news }: Connection,
    config: Arc<Config>,
    gateway: &'static Gateway<'static>,
) -> Result<(), russh::Error> {
    let _ending = Ending(news.clone());
    // russh serves in another task, which ends with the socket.
    let _cut = Cut(stream.try_clone()?);
    let stream = tokio::net::TcpStream::from_std(stream)?;
    let is_in = Arc::new(AtomicBool::new(false));
    let client = Client::new(gateway, Who { user: String::new(), peer, port }, news, is_in.clone());
    let too_late = async {
        sleep(LOG_IN_MAX).await;
        if is_in.load(Relaxed) {
            std::future::pending().await
        }
    };
    tokio::select! {
        ended = async { run_stream(config, stream, client).await?.await } => ended,
        () = too_late => Err(io::Error::from(io::ErrorKind::TimedOut).into()),
    }
}
