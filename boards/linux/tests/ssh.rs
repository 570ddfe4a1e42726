//! The console by SSH, with OpenSSH's client.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Barrier;
use std::thread;

use common::terminal::{Terminal, status};
use common::{Program, USER, converse, wait_for};

mod common;

/// The gateway with an SSH server, and what its users have.
struct Gateway {
    program: Program,
    own: tempfile::TempDir,
}

/// A key of this name in `folder`; returns its public part as OpenSSH writes it.
fn make_key(folder: &Path, name: &str, kind: &str) -> String {
    let file = folder.join(name);
    let made = Command::new("ssh-keygen").args(["-q", "-N", "", "-t", kind, "-f"]).arg(&file).status();
    assert!(made.unwrap().success());
    fs::read_to_string(file.with_extension("pub")).unwrap()
}

impl Gateway {
    /// With `anna`, an engineer with a password and the key `good`, and `vera`, a viewer with that key, too.
    fn start(more: &str) -> Self {
        let own = tempfile::tempdir().unwrap();
        let [good, _] = ["good", "wrong"].map(|name| make_key(own.path(), name, "ed25519"));
        // Runs as a program: the password is that of `anna` in the tests.
        for (name, text) in [("right", "let me in"), ("wrong-password", "let me out")] {
            let mut options = OpenOptions::new();
            let mut script =
                options.create_new(true).write(true).mode(0o700).open(own.path().join(name)).unwrap();
            script.write_all(format!("#!/bin/sh\necho '{text}'\n").as_bytes()).unwrap();
        }
        let settings = format!(
            "port ssh ssh server 127.0.0.1:{{port}}\n{USER}user anna key {good}\
             user vera role viewer\nuser vera key {good}{more}"
        );
        let options = ["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"];
        Self { program: Program::with(&settings, &options), own }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.own.path().join(name)
    }

    /// The arguments of ssh(1) for `user`, without those of a method to log in.
    fn arguments(&self, user: &str) -> Vec<String> {
        let known = format!("UserKnownHostsFile={}", self.file("known").display());
        let port = self.program.port.to_string();
        let options = ["StrictHostKeyChecking=accept-new", &known, "IdentitiesOnly=yes", "LogLevel=ERROR"];
        let mut arguments: Vec<String> = ["-F", "none", "-p", &port].map(str::to_owned).into();
        for option in options {
            arguments.extend(["-o".to_owned(), option.to_owned()]);
        }
        arguments.push(format!("{user}@127.0.0.1"));
        arguments
    }

    /// ssh(1) as `user` with the key of this name.
    fn by_key(&self, user: &str, key: &str) -> Command {
        self.with_key(Command::new("ssh"), user, key)
    }

    /// The same by a command that may have options of its own.
    fn with_key(&self, mut command: Command, user: &str, key: &str) -> Command {
        command.args(["-o", "BatchMode=yes", "-i"]).arg(self.file(key)).args(self.arguments(user));
        command.stdin(Stdio::null());
        command
    }

    /// ssh(1) as `user` with the password that this script tells.
    fn by_password(&self, user: &str, script: &str) -> Command {
        let mut command = Command::new("ssh");
        command.args(["-o", "PubkeyAuthentication=no", "-o", "NumberOfPasswordPrompts=1"]);
        command.args(self.arguments(user)).stdin(Stdio::null());
        command.env("SSH_ASKPASS", self.file(script)).env("SSH_ASKPASS_REQUIRE", "force");
        command
    }
}

/// Runs it with `line`; gives what it printed, and its exit status.
fn run(command: &mut Command, line: &str) -> (String, i32) {
    let Output { status, stdout, stderr } = command.arg(line).output().unwrap();
    let said = String::from_utf8_lossy(&stdout) + String::from_utf8_lossy(&stderr);
    (said.into_owned(), status.code().unwrap())
}

/// What ssh(1) returns if it got no session.
const NO_SESSION: i32 = 255;

#[test]
fn a_line_runs_by_key_or_password_and_its_exit_status_tells_whether_it_was_refused() {
    let gateway = Gateway::start("");
    let (said, status) = run(&mut gateway.by_key("anna", "good"), "show ports");
    assert!(said.contains("ssh server") && status == 0, "{status}: {said}");
    gateway.program.logs("audit: anna@127.0.0.1: logged in as engineer, by key");
    let (said, status) = run(&mut gateway.by_password("anna", "right"), "show users");
    assert!(said.contains("anna") && status == 0, "{status}: {said}");
    gateway.program.logs("audit: anna@127.0.0.1: logged in as engineer\n");
    let (said, status) = run(&mut gateway.by_key("anna", "good"), "show prots");
    assert!(said.contains("error: line 1") && status == 1, "{status}: {said}");
    // A client offers all its keys.
    let mut both = gateway.by_key("anna", "wrong");
    both.args(["-i", gateway.file("good").to_str().unwrap()]);
    assert_eq!(run(&mut both, "show version").1, 0);
    let (said, status) = run(gateway.by_key("anna", "good").arg("-tt"), "show ports");
    assert!(said.contains("ssh server") && said.contains("\r\n") && status == 0, "{status}: {said:?}");
}

#[test]
fn the_role_of_the_user_applies() {
    let gateway = Gateway::start("");
    let (said, status) = run(&mut gateway.by_key("vera", "good"), "delete user anna");
    assert!(said.contains("needs the role engineer; yours is viewer") && status == 1, "{status}: {said}");
    let (said, status) = run(&mut gateway.by_key("vera", "good"), "show users");
    assert!(said.contains("anna") && status == 0, "{status}: {said}");
}

#[test]
fn a_wrong_key_a_wrong_password_and_an_unknown_user_are_refused_and_pause_the_address() {
    let gateway = Gateway::start("");
    for (mut command, audited) in [
        (gateway.by_key("anna", "wrong"), "audit: 127.0.0.1: a wrong key for anna"),
        (gateway.by_password("anna", "wrong-password"), "audit: 127.0.0.1: a wrong password for anna"),
        (gateway.by_password("nobody", "right"), "audit: 127.0.0.1: a wrong password for an unknown user"),
        (gateway.by_key("nobody", "good"), "audit: 127.0.0.1: a wrong key for an unknown user"),
    ] {
        let (said, status) = run(&mut command, "show ports");
        assert!(said.contains("Permission denied") && status == NO_SESSION, "{status}: {said}");
        gateway.program.logs(audited);
    }
    // One who gets in is forgiven them. Five failures begin a pause, in which nobody gets in by SSH, but locally.
    assert_eq!(run(&mut gateway.by_key("anna", "good"), "show version").1, 0);
    wait_for("a pause", || {
        let mut command = Command::new("ssh");
        command.args(["-o", "NumberOfPasswordPrompts=9", "-o", "PubkeyAuthentication=no"]);
        command.args(gateway.arguments("anna")).env("SSH_ASKPASS", gateway.file("wrong-password"));
        run(command.env("SSH_ASKPASS_REQUIRE", "force"), "show version");
        (run(&mut gateway.by_password("anna", "right"), "show version").1 == NO_SESSION).then_some(())
    });
    converse(&mut gateway.program.session(), "show version\n", "mobgate 0.");
}

#[test]
fn a_file_that_is_piped_in_is_carried_out_and_its_end_is_that_of_the_session() {
    let gateway = Gateway::start("");
    let piped = |text: &str| {
        let mut child =
            gateway.by_key("anna", "good").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        let Output { status, stdout, .. } = child.wait_with_output().unwrap();
        (String::from_utf8(stdout).unwrap(), status.code().unwrap())
    };
    // The last line lacks its end.
    assert_eq!(
        piped("port P7 serial /dev/ttyS7 rtu client 9600 8N1\nroute P7 1 * * local\ndelete route 1\nsave"),
        ("saved\n".to_owned(), 0)
    );
    assert!(fs::read_to_string(gateway.program.config()).unwrap().contains("ttyS7"));
    let (said, status) = piped("show version\nport P8 serial\nshow version\n");
    assert!(said.contains("error: line 2") && said.matches("mobgate 0.").count() == 2, "{said}");
    assert_eq!(status, 1);
    // More than all buffers on the way hold, both ways, and each line is refused.
    let (said, status) =
        piped(&"nonsense, and a rest of the line that is as long as some lines are\n".repeat(12_000));
    assert_eq!((said.lines().count(), status), (12_000, 1));
}

#[test]
fn an_interactive_session_edits_completes_and_is_as_wide_as_the_terminal() {
    let gateway = Gateway::start("port P502 tcp server 127.0.0.1:1\nroute P502 1 * * local\n");
    let mut terminal = Terminal::new();
    terminal.resize(132);
    let mut command = terminal.run("ssh");
    command
        .arg("-o")
        .arg("BatchMode=yes")
        .arg("-i")
        .arg(gateway.file("good"))
        .args(gateway.arguments("anna"));
    let client = command.stdout(terminal.open()).stderr(terminal.open()).spawn().unwrap();
    terminal.type_in("", "mobgate> ");
    terminal.type_in("show rou\t\r", "NO SOURCE          UNITS   IP                 TAG  DESTINATION");
    terminal.resize(80);
    // The client is told by a signal, which no answer follows.
    wait_for("the new width", || {
        let said = terminal.type_in("show routes\r", "mobgate> ");
        said.contains("NO SOURCE UNITS IP TAG DESTINATION KIND POLICY\r\n").then_some(())
    });
    terminal.type_in("nonsense\r", "error: ");
    terminal.keyboard.write_all(b"exit\r").unwrap();
    assert_eq!(status(client).code(), Some(0), "the user has seen which lines failed");
    assert!(terminal.is_cooked());
}

#[test]
fn eight_sessions_run_at_once() {
    let gateway = Gateway::start("");
    let (together, gateway) = (Barrier::new(8), &gateway);
    thread::scope(|scope| {
        for nth in 0..8 {
            let together = &together;
            scope.spawn(move || {
                let mut command = gateway.by_key("anna", "good");
                let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
                let (mut to, from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
                to.write_all(b"show version\n").unwrap();
                let mut from = std::io::BufReader::new(from);
                let mut line = String::new();
                std::io::BufRead::read_line(&mut from, &mut line).unwrap();
                assert!(line.starts_with("mobgate 0."), "session {nth}: {line:?}");
                // All are in.
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

#[test]
fn the_host_key_is_made_for_its_owner_alone_and_stays() {
    let gateway = Gateway::start("");
    assert_eq!(run(&mut gateway.by_key("anna", "good"), "show version").1, 0);
    let key = gateway.program.file("mobgate.conf.host-key");
    assert_eq!(fs::metadata(&key).unwrap().mode() & 0o777, 0o600);
    let before = fs::read(&key).unwrap();
    // The client knows the key by now, and would not accept another.
    run(&mut gateway.by_key("anna", "good"), "reboot");
    wait_for("the program that has started again", || {
        (run(&mut gateway.by_key("anna", "good"), "show version").1 == 0).then_some(())
    });
    assert_eq!(fs::read(&key).unwrap(), before);
}

#[test]
fn keys_are_lines_of_the_settings_and_one_that_is_deleted_opens_nothing() {
    let gateway = Gateway::start("");
    let config = run(&mut gateway.by_key("anna", "good"), "show config").0;
    let line = config.lines().find(|line| line.starts_with("user anna key ssh-ed25519 AAAAC3")).unwrap();
    let rsa = make_key(gateway.own.path(), "rsa", "rsa");
    let (said, status) = run(&mut gateway.by_key("anna", "good"), &format!("user anna key {rsa}"));
    assert!(said.contains("expected ssh-ed25519") && status == 1, "{said}");
    let (said, status) = run(&mut gateway.by_key("anna", "good"), &format!("delete {line}"));
    assert!(
        said.contains("a key of yours is gone") && status == 1,
        "who deletes it could not come back: {said}"
    );
    converse(&mut gateway.program.session(), &format!("delete {line}\nshow version\n"), "mobgate 0.");
    assert_eq!(run(&mut gateway.by_key("anna", "good"), "show version").1, NO_SESSION);
    assert_eq!(run(&mut gateway.by_password("anna", "right"), line).1, 0);
    assert_eq!(run(&mut gateway.by_key("anna", "good"), "show version").1, 0);
}

#[test]
fn nothing_but_sessions_is_served() {
    let gateway = Gateway::start("");
    let (said, status) = run(gateway.by_key("anna", "good").arg("-s"), "sftp");
    assert!(said.contains("subsystem request failed") && status == NO_SESSION, "{status}: {said}");
    let with = |options: &[&str]| {
        let mut command = Command::new("ssh");
        command.args(options);
        run(&mut gateway.with_key(command, "anna", "good"), "show version")
    };
    let (said, status) = with(&["-o", "ExitOnForwardFailure=yes", "-R", "0:127.0.0.1:9"]);
    assert!(said.contains("forwarding failed") && status == NO_SESSION, "{status}: {said}");
    for old in [
        "Ciphers=aes128-ctr",
        "KexAlgorithms=diffie-hellman-group14-sha256",
        "HostKeyAlgorithms=rsa-sha2-512",
    ] {
        let (said, status) = with(&["-o", old, "-o", "LogLevel=INFO"]);
        assert!(said.contains("Unable to negotiate") && status == NO_SESSION, "{old}: {status}: {said}");
    }
}
