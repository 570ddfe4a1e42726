//! The console by SSH, with OpenSSH's client.

use std::fs;
use std::os::unix::fs::MetadataExt;

use common::terminal::{Terminal, status};
use common::{Program, USER, converse, free_port, wait_for};
use openssh_client::{NO_SESSION, OpenSsh, make_key, make_passwords, pipe, run, run_at_once};

mod common;
#[path = "ssh/openssh_client.rs"]
mod openssh_client;

/// The gateway with an SSH server, and what its users have.
struct Gateway {
    program: Program,
    own: tempfile::TempDir,
    ssh: OpenSsh,
}

impl Gateway {
    /// With `anna`, an engineer with a password and the key `good`, and `vera`, a viewer with that key, too.
    fn start(more: &str) -> Self {
        let own = tempfile::tempdir().unwrap();
        let [good, _] = ["good", "wrong"].map(|name| make_key(own.path(), name, "ed25519"));
        make_passwords(own.path());
        let settings = format!(
            "port ssh ssh server 127.0.0.1:{{port}}\n{USER}user anna key {good}\n\
             user vera role viewer\nuser vera key {good}\n{more}"
        );
        let options = ["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"];
        let program = Program::with(&settings, &options);
        let ssh = OpenSsh::new(own.path(), program.port);
        Self { program, own, ssh }
    }
}

#[test]
fn a_line_runs_by_key_or_password_and_its_exit_status_tells_whether_it_was_refused() {
    let gateway = Gateway::start("");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show ports");
    assert!(said.contains("ssh server") && status == 0, "{status}: {said}");
    gateway.program.logs("audit: anna@127.0.0.1: logged in as engineer, by key");
    let (said, status) = run(&mut gateway.ssh.by_password(&[], "anna", "right"), "show users");
    assert!(said.contains("anna") && status == 0, "{status}: {said}");
    gateway.program.logs("audit: anna@127.0.0.1: logged in as engineer\n");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show prots");
    assert!(said.contains("error: line 1") && status == 1, "{status}: {said}");
    // A client offers all its keys.
    let wrong = gateway.own.path().join("wrong").display().to_string();
    assert_eq!(run(&mut gateway.ssh.by_key(&["-i", &wrong], "anna", "good"), "show version").1, 0);
    let (said, status) = run(&mut gateway.ssh.by_key(&["-tt"], "anna", "good"), "show ports");
    assert!(said.contains("ssh server") && said.contains("\r\n") && status == 0, "{status}: {said:?}");
}

#[test]
fn the_role_of_the_user_applies() {
    let gateway = Gateway::start("");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "vera", "good"), "delete user anna");
    assert!(said.contains("needs the role engineer; yours is viewer") && status == 1, "{status}: {said}");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "vera", "good"), "show users");
    assert!(said.contains("anna") && status == 0, "{status}: {said}");
}

#[test]
fn a_wrong_key_a_wrong_password_and_an_unknown_user_are_refused_and_pause_the_address() {
    let gateway = Gateway::start("");
    for (mut command, audited) in [
        (gateway.ssh.by_key(&[], "anna", "wrong"), "audit: 127.0.0.1: a wrong key for anna"),
        (
            gateway.ssh.by_password(&[], "anna", "wrong-password"),
            "audit: 127.0.0.1: a wrong password for anna",
        ),
        (
            gateway.ssh.by_password(&[], "nobody", "right"),
            "audit: 127.0.0.1: a wrong password for an unknown user",
        ),
        (gateway.ssh.by_key(&[], "nobody", "good"), "audit: 127.0.0.1: a wrong key for an unknown user"),
    ] {
        let (said, status) = run(&mut command, "show ports");
        assert!(said.contains("Permission denied") && status == NO_SESSION, "{status}: {said}");
        gateway.program.logs(audited);
    }
    // One who gets in is forgiven them. Five failures begin a pause, in which nobody gets in by SSH, but locally.
    assert_eq!(run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show version").1, 0);
    wait_for("a pause", || {
        let options = ["-o", "NumberOfPasswordPrompts=9"];
        run(&mut gateway.ssh.by_password(&options, "anna", "wrong-password"), "show version");
        (run(&mut gateway.ssh.by_password(&[], "anna", "right"), "show version").1 == NO_SESSION)
            .then_some(())
    });
    converse(&mut gateway.program.session(), "show version\n", "mobgate 0.");
}

#[test]
fn a_file_that_is_piped_in_is_carried_out_and_its_end_is_that_of_the_session() {
    let gateway = Gateway::start("");
    let piped = |text: &str| pipe(gateway.ssh.by_key(&[], "anna", "good"), text);
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
    let more = format!("port P502 tcp server 127.0.0.1:{}\nroute P502 1 * * local\n", free_port());
    let gateway = Gateway::start(&more);
    let mut terminal = Terminal::new();
    terminal.resize(132);
    let mut command = terminal.run("ssh");
    command.args(gateway.ssh.by_key(&[], "anna", "good").get_args());
    let client = command.stdout(terminal.open()).stderr(terminal.open()).spawn().unwrap();
    terminal.type_in("", "mobgate> ");
    terminal.type_in("show rou\t\r", "NO SOURCE          UNITS   IP                 TAG  DESTINATION");
    terminal.resize(80);
    // The client is told by a signal, which no response follows.
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
    run_at_once(8, || gateway.ssh.by_key(&[], "anna", "good"));
}

#[test]
fn the_host_key_is_made_for_its_owner_alone_and_stays() {
    let gateway = Gateway::start("");
    assert_eq!(run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show version").1, 0);
    let key = gateway.program.file("mobgate.conf.host-key");
    assert_eq!(fs::metadata(&key).unwrap().mode() & 0o777, 0o600);
    let before = fs::read(&key).unwrap();
    // The client knows the key by now, and would not accept another.
    run(&mut gateway.ssh.by_key(&[], "anna", "good"), "reboot");
    wait_for("the program that has started again", || {
        (run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show version").1 == 0).then_some(())
    });
    assert_eq!(fs::read(&key).unwrap(), before);
}

#[test]
fn keys_are_lines_of_the_settings_and_one_that_is_deleted_opens_nothing() {
    let gateway = Gateway::start("");
    let config = run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show config").0;
    let line = config.lines().find(|line| line.starts_with("user anna key ssh-ed25519 AAAAC3")).unwrap();
    let rsa = make_key(gateway.own.path(), "rsa", "rsa");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "anna", "good"), &format!("user anna key {rsa}"));
    assert!(said.contains("expected ssh-ed25519") && status == 1, "{said}");
    let (said, status) = run(&mut gateway.ssh.by_key(&[], "anna", "good"), &format!("delete {line}"));
    assert!(
        said.contains("a key of yours is gone") && status == 1,
        "who deletes it could not come back: {said}"
    );
    converse(&mut gateway.program.session(), &format!("delete {line}\nshow version\n"), "mobgate 0.");
    assert_eq!(run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show version").1, NO_SESSION);
    assert_eq!(run(&mut gateway.ssh.by_password(&[], "anna", "right"), line).1, 0);
    assert_eq!(run(&mut gateway.ssh.by_key(&[], "anna", "good"), "show version").1, 0);
}

#[test]
fn nothing_but_sessions_is_served() {
    let gateway = Gateway::start("");
    let (said, status) = run(&mut gateway.ssh.by_key(&["-s"], "anna", "good"), "sftp");
    assert!(said.contains("subsystem request failed") && status == NO_SESSION, "{status}: {said}");
    let with = |options: &[&str]| run(&mut gateway.ssh.by_key(options, "anna", "good"), "show version");
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
