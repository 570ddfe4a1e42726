//! The console's Unix socket: its path, its owner, and who may connect.
//!
//! The listening process locks a file beside the socket; the kernel releases the lock however the process ends. So a socket with a
//! free lock is stale and is replaced, and a second gateway finds it in use.

use std::fmt;
use std::fs::{self, DirBuilder, File, OpenOptions, Permissions, TryLockError};
use std::io::{self, ErrorKind, Write as _};
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use mobgate::gateway::Gateway;
use mobgate::gateway::audit::Topic;
use rustix::process::geteuid;

use super::guest::Guest;
use super::peer::{GROUP, Peer};
use crate::cli::SocketPlace;
use crate::descriptor::Descriptor;

/// Folder of the system's gateway.
const SYSTEM_FOLDER: &str = "/run/mobgate";
/// Name of the socket.
const NAME: &str = "console";

/// Accepts connections to the socket.
#[derive(Debug)]
pub struct Listener {
    socket: Descriptor<UnixListener>,
    path: PathBuf,
}

/// The socket's file, removed on drop, and the lock beside it.
#[derive(Debug)]
pub struct Claim {
    path: PathBuf,
    _lock: File,
}

impl Drop for Claim {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Why a socket cannot be opened.
#[derive(Debug)]
enum Refusal {
    /// Another gateway is using it.
    InUse,
    /// An error of the system, or a file in the way.
    Failed(io::Error),
}

impl From<io::Error> for Refusal {
    fn from(error: io::Error) -> Self {
        Self::Failed(error)
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::InUse => {
                f.write_str("in use by another gateway; --socket PATH names another one, --socket off none")
            }
            Self::Failed(error) => error.fmt(f),
        }
    }
}

/// Opens the requested socket, or else the first possible default one. Fails only for a requested one.
pub fn open(wanted: Option<&SocketPlace>) -> Result<Option<(Listener, Claim)>, String> {
    match wanted {
        Some(SocketPlace::Off) => return Ok(None),
        Some(SocketPlace::At(path)) => {
            let opened =
                listen(path).map_err(|refusal| format!("console socket {}: {refusal}", path.display()))?;
            return Ok(Some(opened));
        }
        None => {}
    }
    for folder in folders() {
        let path = folder.join(NAME);
        match make_own(&folder).map_err(Refusal::Failed).and_then(|()| listen(&path)) {
            Ok(opened) => return Ok(Some(opened)),
            Err(Refusal::InUse) => {
                log::warn!("no console socket: {} is {}", path.display(), Refusal::InUse);
                return Ok(None);
            }
            Err(refusal) => log::debug!("console socket {}: {refusal}", path.display()),
        }
    }
    log::warn!("no console socket: no folder for it; --socket PATH names one");
    Ok(None)
}

/// Connects to the gateway's socket at `path`, or at the first default path: the user's own, then the system's.
pub(super) fn connect(path: Option<&Path>) -> Result<UnixStream, String> {
    let fault = |path: &Path, error: io::Error| format!("{}: {error}", path.display());
    if let Some(path) = path {
        return UnixStream::connect(path).map_err(|error| fault(path, error));
    }
    let mut faults = Vec::new();
    for folder in folders().into_iter().rev() {
        let path = folder.join(NAME);
        match is_safe(&folder).and_then(|()| UnixStream::connect(&path)) {
            Ok(stream) => return Ok(stream),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => faults.push(fault(&path, error)),
        }
    }
    let reason = if faults.is_empty() { "is one running?".to_owned() } else { faults.join("; ") };
    Err(format!("no gateway's console is here ({reason}); --socket PATH names one"))
}

/// Default folders of the socket, the system's first.
fn folders() -> Vec<PathBuf> {
    let user = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute());
    let temporary = std::env::temp_dir().join(format!("mobgate-{}", geteuid().as_raw()));
    [Some(SYSTEM_FOLDER.into()), user.map(|folder| folder.join("mobgate")), Some(temporary)]
        .into_iter()
        .flatten()
        .collect()
}

/// Creates the folder if it does not exist.
fn make_own(folder: &Path) -> io::Result<()> {
    // The system's gateway must be reachable for the group; a user's own is private.
    let mode = if folder == Path::new(SYSTEM_FOLDER) { 0o755 } else { 0o700 };
    match DirBuilder::new().mode(mode).create(folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
        _ => is_safe(folder),
    }
}

/// Whether only this user can create files in the folder. Only root can create the system's.
fn is_safe(folder: &Path) -> io::Result<()> {
    let facts = fs::symlink_metadata(folder)?;
    let is_own = facts.is_dir() && facts.uid() == geteuid().as_raw() && facts.mode() & 0o022 == 0;
    if is_own || folder == Path::new(SYSTEM_FOLDER) {
        return Ok(());
    }
    Err(io::Error::new(
        ErrorKind::PermissionDenied,
        "its folder belongs to somebody else, or others may write there",
    ))
}

fn listen(path: &Path) -> Result<(Listener, Claim), Refusal> {
    let mut lock_path = path.as_os_str().to_owned();
    lock_path.push(".lock");
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false).mode(0o600).custom_flags(libc::O_NOFOLLOW);
    let lock = options.open(lock_path)?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(Refusal::InUse),
        Err(TryLockError::Error(error)) => return Err(error.into()),
    }
    match fs::symlink_metadata(path) {
        Ok(facts) if facts.file_type().is_socket() => fs::remove_file(path)?,
        Ok(_) => {
            return Err(io::Error::new(ErrorKind::AlreadyExists, "there is a file that is no socket").into());
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(error.into()),
    }
    let socket = UnixListener::bind(path)?;
    let claim = Claim { path: path.to_owned(), _lock: lock };
    // Anybody may connect: access is decided by the peer's credentials, and refusals are logged.
    fs::set_permissions(path, Permissions::from_mode(0o666))?;
    log::info!("console: mobgate console --socket {}", path.display());
    Ok((Listener { socket: Descriptor::new(socket)?, path: path.to_owned() }, claim))
}

impl fmt::Display for Listener {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path.display().fmt(f)
    }
}

impl Listener {
    /// Accepts the next authorised peer; refuses others.
    pub(super) async fn accept(&mut self, gateway: &Gateway<'_>) -> io::Result<Guest> {
        loop {
            let (mut stream, _) = self.socket.read_with(UnixListener::accept).await?;
            let peer = Peer::of(&stream)?;
            if peer.may_enter() {
                return Guest::by_socket(stream, &peer);
            }
            let what = format_args!(
                "console refused to {peer}: not root, not the gateway's own user, not in the group {GROUP}"
            );
            gateway.audit_refusal(Topic::RefusedClient, None, None, what);
            // A new connection has room for a line; non-blocking in case it has not.
            let _ = stream.set_nonblocking(true);
            let _ = writeln!(
                stream,
                "error: the console is for root, the gateway's own user and the group {GROUP}"
            );
        }
    }
}
