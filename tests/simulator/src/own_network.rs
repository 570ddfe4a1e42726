//! Tests in a network of their own, with a virtual cable between two interfaces: a test runs itself again in a user and network
//! namespace, so it needs no right and no traffic leaves it. And MainDevices in other programs, at one end of the cable. What is
//! missing or not allowed panics, and so does a test that fails in there.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Tells the test that it is the one in the namespace.
const INSIDE: &str = "MOBGATE_OWN_NETWORK";
/// The end of the virtual cable for the MainDevice.
pub const MASTER_END: &str = "ecm0";
/// The end of the virtual cable for the SubDevice.
pub const SEGMENT_END: &str = "ecs0";
/// The ends of a second cable, for a ring.
pub const SECOND_MASTER_END: &str = "ecm1";
/// The other end of the second cable.
pub const SECOND_SEGMENT_END: &str = "ecs1";

const REPOSITORY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Runs `body` in a network of its own, in which the two ends of a cable are up. `test` is the full name of the calling test.
pub fn in_own_network(test: &str, body: impl FnOnce()) {
    if is_inside() {
        prepare();
        return body();
    }
    require_user_namespaces();
    let output = again().args(["--exact", test, "--nocapture"]).output();
    let output = output.expect("unshare is installed: apt-get install util-linux");
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(output.status.success(), "in the namespace:\n{said}");
    assert!(said.contains("1 passed"), "the test's name is {test}:\n{said}");
    // For its figures.
    print!("{said}");
}

/// Ends a test by its name, and with what to do, where the system gives its user no namespaces.
pub fn require_user_namespaces() {
    let tried = Command::new("unshare").args(["--user", "--map-root-user", "true"]).output();
    let tried = tried.expect("unshare is installed: apt-get install util-linux");
    let test = std::thread::current().name().unwrap_or("this test").to_owned();
    assert!(
        tried.status.success(),
        "{test} needs user namespaces: {}allow them by one of\n  \
         sudo sysctl -w kernel.unprivileged_userns_clone=1                 # Debian\n  \
         sudo sysctl -w kernel.apparmor_restrict_unprivileged_userns=0     # Ubuntu\n  \
         sudo sysctl -w user.max_user_namespaces=15000                     # where there are none at all\n\
         or, in a container, run that with --security-opt seccomp=unconfined",
        String::from_utf8_lossy(&tried.stderr)
    );
}

/// Whether this program runs in a network of its own.
pub fn is_inside() -> bool {
    std::env::var_os(INSIDE).is_some()
}

/// This program once more, in a network of its own.
pub fn again() -> Command {
    let mut again = Command::new("unshare");
    again.args(["--map-root-user", "--net"]).arg(std::env::current_exe().unwrap()).env(INSIDE, "1");
    again
}

/// Switches the loopback interface on, and lays the cable.
pub fn prepare() {
    ip("link set lo up");
    lay_cable();
}

/// Connects both ends and switches them on.
pub fn lay_cable() {
    lay(MASTER_END, SEGMENT_END);
}

/// Lays the second cable.
pub fn lay_second_cable() {
    lay(SECOND_MASTER_END, SECOND_SEGMENT_END);
}

fn lay(master: &str, segment: &str) {
    ip(&format!("link add {master} type veth peer name {segment}"));
    for end in [master, segment] {
        // Without this the kernel talks IPv6 on the cable.
        let _ = std::fs::write(format!("/proc/sys/net/ipv6/conf/{end}/disable_ipv6"), "1");
        ip(&format!("link set {end} up"));
    }
}

/// Runs the program `ip` with these words.
pub fn ip(words: &str) {
    let status = Command::new("ip").args(words.split(' ')).status();
    assert!(status.expect("ip is installed: apt-get install iproute2").success(), "ip {words}");
}

/// A Python that has `module`: the one that `MOBGATE_PYTHON` names, or else the virtual environment's.
pub fn python(module: &str) -> OsString {
    let prepared = Path::new(REPOSITORY).join("target/python/bin/python3");
    let python = std::env::var_os("MOBGATE_PYTHON").unwrap_or(prepared.into());
    let found = Command::new(&python).args(["-c", &format!("import {module}")]).output();
    let good = found.is_ok_and(|output| output.status.success());
    assert!(good, "{module} is missing: cargo xtask install peers");
    python
}

/// Starts a script of `tests/ethercat/masters` with pysoem at the MainDevice's end of the cable.
pub fn start_master(script: &str, arguments: &[String]) -> Child {
    start_master_with("pysoem", script, arguments)
}

/// Starts a script of `tests/ethercat/masters` at the MainDevice's end of the cable, which needs the Python `module`.
pub fn start_master_with(module: &str, script: &str, arguments: &[String]) -> Child {
    let path: PathBuf = [REPOSITORY, "tests/ethercat/masters", script].iter().collect();
    let mut script = Command::new(python(module));
    // The scripts' folder is no place for what Python makes of them.
    script.env("PYTHONDONTWRITEBYTECODE", "1").arg(path).arg(MASTER_END).args(arguments);
    script.stdin(Stdio::null()).spawn().unwrap()
}
