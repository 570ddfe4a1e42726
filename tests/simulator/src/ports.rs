//! TCP ports for programs that tests start.

use std::net::{Ipv4Addr, TcpListener};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A port that was free a moment ago. None that the system gives to whoever asks for any, such as a client: it would be taken
/// again before the program has started on a busy machine. Nor one that was given to another test, in whatever process: who
/// connects to that test's program would take it for its own.
pub fn free_port() -> u16 {
    static GIVEN: AtomicU32 = AtomicU32::new(0);
    let first = std::process::id().wrapping_mul(131);
    loop {
        let nth = first.wrapping_add(GIVEN.fetch_add(1, Relaxed));
        let port = 10_000 + (nth % 22_000) as u16;
        if reserve(port) && TcpListener::bind((Ipv4Addr::UNSPECIFIED, port)).is_ok() {
            return port;
        }
    }
}

/// Has `port` for this process until its end, unless another one has it: by a name that, as the port, is known in this network only.
pub fn reserve(port: u16) -> bool {
    static RESERVED: Mutex<Vec<UnixListener>> = Mutex::new(Vec::new());
    let Ok(name) = SocketAddr::from_abstract_name(format!("mobgate-test-port-{port}")) else { return false };
    let claim = UnixListener::bind_addr(&name);
    claim.map(|claim| RESERVED.lock().expect("a list").push(claim)).is_ok()
}
