//! Identifies the peer of a Unix socket, and decides whether it may use the console.

use std::fmt;
use std::io;
use std::os::fd::{AsFd, AsRawFd};

use rustix::net::sockopt::socket_peercred;
use rustix::process::geteuid;

use crate::hint::group_id;

/// Members of this group may use the console.
pub(super) const GROUP: &str = "mobgate";
/// Most groups of a process (`NGROUPS_MAX`).
const GROUPS_MAX: usize = 65536;

/// A process, with its credentials at connection time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Peer {
    process: i32,
    user: u32,
    groups: Vec<u32>,
}

impl Peer {
    /// The process connected to `socket`, according to the kernel.
    pub(super) fn of(socket: impl AsFd) -> io::Result<Self> {
        let credentials = socket_peercred(&socket)?;
        let mut groups = groups(&socket)?;
        groups.push(credentials.gid.as_raw());
        Ok(Self { process: credentials.pid.as_raw_nonzero().get(), user: credentials.uid.as_raw(), groups })
    }

    /// Whether it may use the console: root, the gateway's own user, and members of [`GROUP`].
    pub(super) fn may_enter(&self) -> bool {
        self.is_one_of(geteuid().as_raw(), group_id(GROUP))
    }

    fn is_one_of(&self, own: u32, group: Option<u32>) -> bool {
        self.user == 0 || self.user == own || group.is_some_and(|group| self.groups.contains(&group))
    }
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "user {} (process {})", self.user, self.process)
    }
}

/// The supplementary groups of the peer process.
fn groups(socket: &impl AsFd) -> io::Result<Vec<u32>> {
    let mut groups = vec![0_u32; GROUPS_MAX];
    let mut bytes = (GROUPS_MAX * size_of::<u32>()) as libc::socklen_t;
    // SAFETY: the kernel writes at most `bytes` bytes to `groups`, which is that large, and stores the number written in `bytes`.
    let got = unsafe {
        libc::getsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_PEERGROUPS,
            groups.as_mut_ptr().cast(),
            &mut bytes,
        )
    };
    if got != 0 {
        return Err(io::Error::last_os_error());
    }
    groups.truncate(bytes as usize / size_of::<u32>());
    Ok(groups)
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use rustix::process::{getegid, geteuid, getgroups, getpid};

    use super::Peer;

    #[test]
    fn root_the_own_user_and_members_of_the_group_may_enter_and_nobody_else() {
        let peer = |user, groups: &[u32]| Peer { process: 1, user, groups: groups.to_vec() };
        assert!(peer(0, &[]).is_one_of(990, Some(990)));
        assert!(peer(990, &[]).is_one_of(990, None));
        assert!(peer(1000, &[1000, 990]).is_one_of(991, Some(990)));
        assert!(!peer(1000, &[1000, 989]).is_one_of(991, Some(990)));
        assert!(!peer(1000, &[1000, 0]).is_one_of(0, None));
    }

    #[test]
    fn the_kernel_tells_who_is_connected() {
        let (one, _other) = UnixStream::pair().unwrap();
        let peer = Peer::of(&one).unwrap();
        assert_eq!((peer.user, peer.process), (geteuid().as_raw(), getpid().as_raw_nonzero().get()));
        assert!(peer.groups.contains(&getegid().as_raw()));
        for group in getgroups().unwrap() {
            assert!(peer.groups.contains(&group.as_raw()));
        }
    }
}
