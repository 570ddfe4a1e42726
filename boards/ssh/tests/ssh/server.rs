//! A gateway whose console is served at a TCP port of this machine, by a thread.

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use embassy_futures::block_on;
use embassy_futures::join::join_array;
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, Ports, reconfigure};
use mobgate::hal::{System, TcpHost, TcpStream};
use mobgate::language::{LineBuffer, Loader};
use mobgate::settings::{PortId, TcpListen};
use mobgate_linux::tcp::TcpSockets;
use mobgate_linux::{passwords, reactor};
use mobgate_simulator::console::Medium;
use mobgate_simulator::firmware::Firmware;
use mobgate_simulator::ports::free_port;
use mobgate_simulator::waiting::wait_for;
use mobgate_ssh::{Board, SEED_BYTES, Visit, serve};
use rustix::rand::{GetRandomFlags, getrandom};

use crate::openssh_client::{OpenSsh, make_key, make_passwords};

/// Connections at a time.
const CONNECTIONS: usize = 9;
const SEED: [u8; SEED_BYTES] = [7; SEED_BYTES];
/// An engineer whose password is `let me in`, as in the tests of the Linux program, and a viewer with the same.
const USERS: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"\n\
    user vera role viewer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"\n";

struct Host;

impl System for Host {
    fn name(&self) -> &str {
        "a host"
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        passwords::is_right(hash, password).await
    }

    fn random(&self, into: &mut [u8]) -> bool {
        getrandom(&mut *into, GetRandomFlags::empty()) == Ok(into.len())
    }

    fn reboot(&self) {}
}

/// The gateway, its port, and what its users have.
pub(crate) struct Server {
    pub(crate) gateway: &'static Gateway<'static>,
    pub(crate) port: u16,
    pub(crate) folder: tempfile::TempDir,
    pub(crate) ssh: OpenSsh,
    /// Connections that were served and have ended, and those of them who had logged in.
    ended: &'static AtomicUsize,
    logged_in: &'static AtomicUsize,
}

/// Serves one connection after the other.
async fn serve_all(server: &Server, mut sockets: TcpSockets, passwords: bool) {
    let listen = TcpListen { address: Some(Ipv4Addr::LOCALHOST.into()), port: server.port };
    loop {
        let (mut stream, peer) = sockets.accept(&listen).await.unwrap();
        let visit = Visit { peer: peer.ip(), port: PortId(0) };
        let (store, update) = (Medium::default(), Firmware::default());
        let board = Board { seed: &SEED, system: &Host, passwords, store, update };
        let logged_in = || _ = server.logged_in.fetch_add(1, Ordering::Relaxed);
        // How it ended is what the client sees.
        let _ = serve(server.gateway, &mut stream, visit, board, &logged_in).await;
        stream.close().await;
        server.ended.fetch_add(1, Ordering::Relaxed);
    }
}

impl Server {
    /// With `anna` and `vera`, who have passwords if the board has, and the key `good`.
    pub(crate) fn start(passwords: bool) -> &'static Self {
        let folder = tempfile::tempdir().unwrap();
        let [good, _] = ["good", "wrong"].map(|name| make_key(folder.path(), name, "ed25519"));
        make_key(folder.path(), "other", "ecdsa");
        make_passwords(folder.path());
        let slots: &[Slot] = Box::leak((0..64).map(|_| Slot::new()).collect());
        let pool = Box::leak(Box::new(FramePool::new(slots, 0)));
        let ports = Box::leak(Box::new(Ports::<8>::new()));
        let gateway: &Gateway<'_> = Box::leak(Box::new(Gateway::new(pool, ports, &[])));
        let settings = format!("{USERS}user anna key {good}\nuser vera key {good}\n");
        let mut draft = block_on(reconfigure::draft(gateway));
        let mut line = LineBuffer::default();
        let mut loader = Loader::new(&mut draft, &mut line);
        loader.feed(settings.as_bytes()).and_then(|()| loader.finish()).unwrap();
        gateway.apply(&draft).unwrap();
        drop(draft);
        let port = free_port();
        let counter = || &*Box::leak(Box::<AtomicUsize>::default());
        let ssh = OpenSsh::new(folder.path(), port);
        let server = Self { gateway, port, folder, ssh, ended: counter(), logged_in: counter() };
        let server: &Self = Box::leak(Box::new(server));
        thread::spawn(move || {
            let sockets = TcpSockets::default();
            let all = [(); CONNECTIONS].map(|()| serve_all(server, sockets.clone(), passwords));
            reactor::block_on(join_array(all))
        });
        wait_for("the port", || std::net::TcpStream::connect((Ipv4Addr::LOCALHOST, port)).ok());
        server
    }

    pub(crate) fn ended(&self) -> usize {
        self.ended.load(Ordering::Relaxed)
    }

    pub(crate) fn logged_in(&self) -> usize {
        self.logged_in.load(Ordering::Relaxed)
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}
