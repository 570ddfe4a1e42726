//! A gateway whose console is served at a TCP port of this machine, by a thread.

use std::fs;
use std::io::Write;
use std::net::{Ipv4Addr, TcpListener};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use embassy_futures::block_on;
use embassy_futures::join::join_array;
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, Ports, reconfigure};
use mobgate::hal::{System, TcpHost, TcpStream};
use mobgate::language::Loader;
use mobgate::settings::{PortId, TcpListen};
use mobgate_linux::tcp::TcpSockets;
use mobgate_linux::{passwords, reactor};
use mobgate_simulator::console::Medium;
use mobgate_simulator::firmware::Firmware;
use mobgate_ssh::{Board, SEED_BYTES, Visit, serve};
use rustix::rand::{GetRandomFlags, getrandom};

/// Longest wait for anything that is expected.
const PATIENCE: Duration = Duration::from_secs(60);
/// Connections at a time.
const CONNECTIONS: usize = 9;
const SEED: [u8; SEED_BYTES] = [7; SEED_BYTES];
/// What ssh(1) returns if it got no session.
pub(crate) const NO_SESSION: i32 = 255;
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
    /// Connections that were served and have ended, and those of them who had logged in.
    ended: &'static AtomicUsize,
    logged_in: &'static AtomicUsize,
}

pub(crate) fn wait_for<T>(what: &str, mut done: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = done() {
            return value;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        thread::sleep(Duration::from_millis(10)); // between two looks
    }
}

/// A key of this name in `folder`; returns its public part as OpenSSH writes it.
fn make_key(folder: &Path, name: &str, kind: &str) -> String {
    let file = folder.join(name);
    let made = Command::new("ssh-keygen").args(["-q", "-N", "", "-t", kind, "-f"]).arg(&file).status();
    assert!(made.unwrap().success());
    fs::read_to_string(file.with_extension("pub")).unwrap()
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
        // Run as programs: the passwords that ssh(1) asks for.
        for (name, text) in [("right", "let me in"), ("wrong-password", "let me out")] {
            let mut options = fs::OpenOptions::new();
            let mut script =
                options.create_new(true).write(true).mode(0o700).open(folder.path().join(name)).unwrap();
            script.write_all(format!("#!/bin/sh\necho '{text}'\n").as_bytes()).unwrap();
        }
        let slots: &[Slot] = Box::leak((0..64).map(|_| Slot::new()).collect());
        let pool = Box::leak(Box::new(FramePool::new(slots, 0)));
        let ports = Box::leak(Box::new(Ports::<8>::new()));
        let gateway: &Gateway<'_> = Box::leak(Box::new(Gateway::new(pool, ports, &[])));
        let settings = format!("{USERS}user anna key {good}user vera key {good}");
        let mut draft = block_on(reconfigure::draft(gateway));
        let mut loader = Loader::new(&mut draft);
        loader.feed(settings.as_bytes()).and_then(|()| loader.finish()).unwrap();
        gateway.apply(&draft).unwrap();
        drop(draft);
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap().port();
        let counter = || &*Box::leak(Box::<AtomicUsize>::default());
        let server = Self { gateway, port, folder, ended: counter(), logged_in: counter() };
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

    /// The arguments of ssh(1) for `user`, without those of a method to log in.
    fn arguments(&self, user: &str) -> Vec<String> {
        let known = format!("UserKnownHostsFile={}", self.file("known").display());
        let port = self.port.to_string();
        let options = ["StrictHostKeyChecking=accept-new", &known, "IdentitiesOnly=yes", "LogLevel=ERROR"];
        let mut arguments: Vec<String> = ["-F", "none", "-p", &port].map(str::to_owned).into();
        for option in options {
            arguments.extend(["-o".to_owned(), option.to_owned()]);
        }
        arguments.push(format!("{user}@127.0.0.1"));
        arguments
    }

    /// ssh(1) with `options` as `user`, who has the key of this name.
    pub(crate) fn by_key(&self, options: &[&str], user: &str, key: &str) -> Command {
        let mut command = Command::new("ssh");
        command.args(options).args(["-o", "BatchMode=yes", "-i"]).arg(self.file(key));
        command.args(self.arguments(user)).stdin(Stdio::null());
        command
    }

    /// ssh(1) as `user` with the password that this script tells.
    pub(crate) fn by_password(&self, user: &str, script: &str) -> Command {
        let mut command = Command::new("ssh");
        command.args(["-o", "PubkeyAuthentication=no", "-o", "NumberOfPasswordPrompts=1"]);
        command.args(self.arguments(user)).stdin(Stdio::null());
        command.env("SSH_ASKPASS", self.file(script)).env("SSH_ASKPASS_REQUIRE", "force");
        command
    }
}

/// Runs it with `line`; gives what it printed, and its exit status.
pub(crate) fn run(command: &mut Command, line: &str) -> (String, i32) {
    let Output { status, stdout, stderr } = command.arg(line).output().unwrap();
    let said = String::from_utf8_lossy(&stdout) + String::from_utf8_lossy(&stderr);
    (said.into_owned(), status.code().unwrap())
}
