//! The console by SSH, with OpenSSH's client and with one that sends packets as no other does.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{ChildStdout, Stdio};

use mobgate_qemu::{Image, Machine, Options, wait_for};
use mobgate_simulator::random::{Random, chosen};

use crate::openssh_client::{NO_SESSION, OpenSsh, make_key, make_passwords, pipe, run, run_at_once};
use crate::payload;
use crate::raw::{Client, KEY, Stage};

/// Sessions at a time.
const SESSIONS: usize = 8;
/// `let me in`, with parameters that cost little.
pub(crate) const PASSWORD: &str =
    "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";

/// The board with an SSH server, and what its users have.
struct Bench {
    // Ended before its folder goes.
    machine: Machine,
    folder: tempfile::TempDir,
}

fn start(folder: &Path) -> Machine {
    Machine::start(folder, Options { image: Image::Ssh, ..Options::default() })
}

impl Bench {
    /// With the engineer `anna`, who has a password, and the viewer `vera`; both have the key `good`.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [good, _] = ["good", "wrong"].map(|name| make_key(folder.path(), name, "ed25519"));
        make_passwords(folder.path());
        let bench = Self { machine: start(folder.path()), folder };
        let mut console = bench.machine.console();
        for line in [
            &format!("user anna role engineer password \"{PASSWORD}\""),
            &format!("user anna key {good}"),
            "user vera role viewer",
            &format!("user vera key {good}"),
            &format!("user vera key {KEY}"),
            "port P502 tcp server 502 clients 4",
            "port ssh ssh server 22 clients 8",
        ] {
            assert_eq!(console.run(line), "", "{line}");
        }
        assert_eq!(console.run("save").trim_end(), "saved");
        bench.machine.logs("listening on TCP port 22");
        bench
    }

    fn ssh(&self) -> OpenSsh {
        OpenSsh::new(self.folder.path(), self.machine.ssh_port())
    }

    /// Runs `line` as `user` with the key `good`; gives what was printed, and the exit status.
    fn run(&self, user: &str, line: &str) -> (String, i32) {
        run(&mut self.ssh().by_key(&[], user, "good"), line)
    }
}

/// What comes up to `end`.
fn read_until(from: &mut ChildStdout, end: &str) -> String {
    let (mut said, mut byte) = (String::new(), [0]);
    while !said.ends_with(end) {
        assert!(from.read_exact(&mut byte).is_ok(), "no {end:?} in {said:?}");
        said.push(char::from(byte[0]));
    }
    said
}

#[test]
fn a_line_runs_by_key_and_a_wrong_key_opens_nothing() {
    let mut bench = Bench::new();
    let (said, status) = bench.run("anna", "show ports");
    assert!(said.contains("ssh server   22") && status == 0, "{status}: {said}");
    bench.machine.logs("logged in as engineer, by key");
    let (said, status) = bench.run("anna", "show prots");
    assert!(said.contains("did you mean ports?") && status == 1, "{status}: {said}");
    let (said, status) = bench.run("vera", "delete user anna");
    assert!(said.contains("needs the role engineer; yours is viewer") && status == 1, "{status}: {said}");
    let (said, status) = run(&mut bench.ssh().by_key(&[], "anna", "wrong"), "show ports");
    assert!(
        said.contains("Permission denied (publickey,password)") && status == NO_SESSION,
        "{status}: {said}"
    );
    bench.machine.logs("a wrong key for anna");
    let (said, status) = bench.run("anna", "update");
    assert!(said.contains("QEMU starts the image that it is given") && status == 1, "{status}: {said}");
    // The host key is the same after a restart: the client would not accept another.
    bench.machine.kill();
    bench.machine = start(bench.folder.path());
    bench.machine.logs("listening on TCP port 22");
    let (said, status) = bench.run("anna", "show version");
    assert!(said.contains("on QEMU mps2-an386") && status == 0, "{status}: {said}");
}

#[test]
fn a_password_opens_a_session_and_a_wrong_one_opens_nothing() {
    let bench = Bench::new();
    for (script, opens) in [("wrong-password", false), ("right", true)] {
        let (said, status) = run(&mut bench.ssh().by_password(&[], "anna", script), "show version");
        assert_eq!(said.contains("on QEMU mps2-an386"), opens, "{script}: {said}");
        assert_eq!(status, if opens { 0 } else { NO_SESSION }, "{script}: {said}");
    }
    bench.machine.logs("a wrong password for anna");
    bench.machine.logs("logged in as engineer");
}

#[test]
fn a_file_that_is_piped_in_is_carried_out_and_its_end_is_that_of_the_session() {
    let bench = Bench::new();
    let piped = |text: &str| pipe(bench.ssh().by_key(&[], "anna", "good"), text);
    // The last line lacks its end.
    let lines = "route P502 248 * =3 P1\n".to_owned()
        + &"route P502 249 * =3 P1\ndelete route 5\n".repeat(50)
        + "save";
    assert_eq!(piped(&lines), ("saved\n".to_owned(), 0));
    assert!(bench.machine.console().run("show routes").contains("248"));
    let (said, status) = piped("show version\nport P8 serial\nshow version\n");
    assert!(said.contains("error: line 2") && said.matches("mobgate 0.").count() == 2, "{said}");
    assert_eq!(status, 1);
}

#[test]
fn a_session_at_a_terminal_edits_and_may_be_left() {
    let bench = Bench::new();
    let mut command = bench.ssh().by_key(&["-tt"], "anna", "good");
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let (mut to, mut from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    read_until(&mut from, "mobgate> ");
    // Left arrow, a letter put in, and Tab.
    to.write_all(b"show vrs\x1b[D\x1b[De\x1b[C\x1b[C\t\r").unwrap();
    read_until(&mut from, "on QEMU mps2-an386");
    to.write_all(b"nonsense\r").unwrap();
    read_until(&mut from, "error: ");
    to.write_all(b"exit\r").unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0), "the user has seen which lines failed");
}

#[test]
fn eight_sessions_run_at_once() {
    let bench = Bench::new();
    run_at_once(SESSIONS, || bench.ssh().by_key(&[], "anna", "good"));
}

#[test]
fn random_packets_at_each_stage_do_no_harm() {
    let seed = chosen("MOBGATE_SEED").unwrap_or_else(|| u64::from(std::process::id()));
    println!("random packets: MOBGATE_SEED={seed}");
    let (mut random, bench) = (Random::new(seed), Bench::new());
    // All come from one address, whose pauses a success ends.
    let good = |after: &str| {
        wait_for(&format!("a session after {after}, MOBGATE_SEED={seed}"), || {
            let client = Client::connect(bench.machine.ssh_port(), 1).ok()?.with_key();
            client
                .reach(Stage::Session)
                .ok()?
                .run("show version")
                .ok()
                .filter(|said| said.contains("mobgate 0."))
        });
    };
    good("the start");
    let free = bench.machine.figures().sockets_free();
    for stage in [Stage::Begin, Stage::Exchange, Stage::Keys, Stage::Service, Stage::Session, Stage::LogIn] {
        let connect = || Client::connect(bench.machine.ssh_port(), 1).map(Client::with_key);
        let (sent, connections) = payload::send(&mut random, stage, connect);
        println!("{stage:?}: {sent} packets by {connections} connections");
        good(&format!("{stage:?}"));
    }
    // A panic would have ended the emulator, and a session that stays would keep its socket.
    wait_for("the ends of all connections", || {
        (bench.machine.figures().sockets_free() >= free).then_some(())
    });
    println!("the stack has held {} bytes", bench.machine.figures().stack_bytes());
}
