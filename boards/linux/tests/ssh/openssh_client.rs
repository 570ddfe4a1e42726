//! OpenSSH's client, ssh(1), and what its user has: keys, and passwords that a script tells.
// Each crate's tests use a part of it.
#![allow(dead_code)]

use std::fs::{self, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Barrier;
use std::thread;

/// What ssh(1) returns if it got no session.
pub(crate) const NO_SESSION: i32 = 255;

/// ssh(1) for the server at a port of this machine, with the user's files in a folder.
pub(crate) struct OpenSsh {
    folder: PathBuf,
    port: u16,
}

/// A key of this name in `folder`; returns its public part as OpenSSH writes it.
pub(crate) fn make_key(folder: &Path, name: &str, kind: &str) -> String {
    let file = folder.join(name);
    let made = Command::new("ssh-keygen").args(["-q", "-N", "", "-t", kind, "-f"]).arg(&file).status();
    assert!(made.unwrap().success());
    fs::read_to_string(file.with_extension("pub")).unwrap().trim_end().to_owned()
}

/// The scripts `right` and `wrong-password` in `folder`, which ssh(1) asks for the password of `anna` in the tests.
pub(crate) fn make_passwords(folder: &Path) {
    for (name, password) in [("right", "let me in"), ("wrong-password", "let me out")] {
        let mut options = OpenOptions::new();
        let script = options.create_new(true).write(true).mode(0o700).open(folder.join(name));
        script.unwrap().write_all(format!("#!/bin/sh\necho '{password}'\n").as_bytes()).unwrap();
    }
}

impl OpenSsh {
    pub(crate) fn new(folder: &Path, port: u16) -> Self {
        Self { folder: folder.to_owned(), port }
    }

    /// ssh(1) with `options` as `user`, who has the key of this name.
    pub(crate) fn by_key(&self, options: &[&str], user: &str, key: &str) -> Command {
        let mut command = Command::new("ssh");
        // The first of two options counts.
        command.args(options).args(["-o", "BatchMode=yes", "-i"]).arg(self.folder.join(key));
        command.args(self.arguments(user)).stdin(Stdio::null());
        command
    }

    /// ssh(1) with `options` as `user`, with the password that this script tells.
    pub(crate) fn by_password(&self, options: &[&str], user: &str, script: &str) -> Command {
        let mut command = Command::new("ssh");
        command.args(options).args(["-o", "PubkeyAuthentication=no", "-o", "NumberOfPasswordPrompts=1"]);
        command.args(self.arguments(user)).stdin(Stdio::null());
        command.env("SSH_ASKPASS", self.folder.join(script)).env("SSH_ASKPASS_REQUIRE", "force");
        command
    }

    /// The arguments for `user`, without those of a method to log in. The host key that is seen first is the right one, even when the
    /// server comes back at another port.
    fn arguments(&self, user: &str) -> Vec<String> {
        let known = format!("UserKnownHostsFile={}", self.folder.join("known").display());
        let mut arguments: Vec<String> =
            ["-F", "none", "-p", &self.port.to_string()].map(str::to_owned).into();
        for option in [
            "HostKeyAlias=gateway",
            "StrictHostKeyChecking=accept-new",
            &known,
            "IdentitiesOnly=yes",
            "LogLevel=ERROR",
        ] {
            arguments.extend(["-o".to_owned(), option.to_owned()]);
        }
        arguments.push(format!("{user}@127.0.0.1"));
        arguments
    }
}

/// Runs it with `line`; gives what it printed, and its exit status.
pub(crate) fn run(command: &mut Command, line: &str) -> (String, i32) {
    let Output { status, stdout, stderr } = command.arg(line).output().unwrap();
    let said = String::from_utf8_lossy(&stdout) + String::from_utf8_lossy(&stderr);
    (said.into_owned(), status.code().unwrap())
}

fn spawn(mut command: Command) -> Child {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap()
}

/// Pipes all of `text` in before it reads; gives what was printed, and the exit status.
pub(crate) fn pipe(command: Command, text: &str) -> (String, i32) {
    let mut child = spawn(command);
    child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    let Output { status, stdout, .. } = child.wait_with_output().unwrap();
    (String::from_utf8(stdout).unwrap(), status.code().unwrap())
}

/// A session, its input, and the rest of its output, once it has answered `show version`.
pub(crate) fn begin(command: Command) -> (Child, impl Write, impl BufRead) {
    let mut child = spawn(command);
    let (mut to, from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    to.write_all(b"show version\n").unwrap();
    let (mut from, mut line) = (BufReader::new(from), String::new());
    from.read_line(&mut line).unwrap();
    assert!(line.starts_with("mobgate 0."), "{line:?}");
    (child, to, from)
}

/// Runs that many sessions; none asks for the users, of whom `vera` is one, before all are in.
pub(crate) fn run_at_once(sessions: usize, command: impl Fn() -> Command + Sync) {
    let together = Barrier::new(sessions);
    thread::scope(|scope| {
        for nth in 0..sessions {
            let (together, command) = (&together, &command);
            scope.spawn(move || {
                let (mut child, mut to, from) = begin(command());
                together.wait();
                to.write_all(b"show users\n").unwrap();
                drop(to);
                let said = std::io::read_to_string(from).unwrap();
                assert!(said.contains("vera"), "session {nth}: {said:?}");
                assert_eq!(child.wait().unwrap().code(), Some(0), "session {nth}");
            });
        }
    });
}
