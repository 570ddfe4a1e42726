//! MainDevices in other programs, which reach the simulated segment over a pair of virtual network interfaces.
//!
//! A test runs itself again in a user and network namespace of its own, so it needs no right and no traffic leaves it.

use std::cell::RefCell;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::rc::Rc;

use embassy_time::Timer;
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::esc::{Chip, Kind, Segment};

use crate::chips::simple_device;

/// Tells the test that it is the one in the namespace.
const INSIDE: &str = "MOBGATE_OWN_NETWORK";
/// Ends of the virtual cable: for the MainDevice, for the segment.
pub(crate) const MASTER_END: &str = "ecm0";
pub(crate) const SEGMENT_END: &str = "ecs0";

/// Runs `body` in a network of its own, in which the two ends of a cable are up. `test` is the full name of the calling test.
pub(crate) fn in_own_network(test: &str, body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        lay_cable();
        return body();
    }
    let mut again = Command::new("unshare");
    again.args(["--map-root-user", "--net"]).arg(std::env::current_exe().unwrap());
    again.args(["--exact", test, "--nocapture"]).env(INSIDE, "1");
    let output = again.output().expect("unshare is installed: apt-get install util-linux");
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(output.status.success(), "in the namespace:\n{said}");
    assert!(said.contains("1 passed"), "the test's name is {test}:\n{said}");
}

fn lay_cable() {
    let ip = |arguments: &[&str]| {
        let status = Command::new("ip").args(arguments).status();
        assert!(status.expect("ip is installed: apt-get install iproute2").success(), "ip {arguments:?}");
    };
    ip(&["link", "add", MASTER_END, "type", "veth", "peer", "name", SEGMENT_END]);
    for end in [MASTER_END, SEGMENT_END] {
        // Without this the kernel talks IPv6 on the cable.
        let _ = std::fs::write(format!("/proc/sys/net/ipv6/conf/{end}/disable_ipv6"), "1");
        ip(&["link", "set", end, "up"]);
    }
}

/// A Python that has pysoem: the one that `MOBGATE_PYTHON` names, or else the virtual environment's.
pub(crate) fn python() -> OsString {
    let prepared = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/python/bin/python3");
    let python = std::env::var_os("MOBGATE_PYTHON").unwrap_or(prepared.into());
    let found = Command::new(&python).args(["-c", "import pysoem"]).output();
    let good = found.is_ok_and(|output| output.status.success());
    assert!(good, "pysoem is missing: apt-get install python3-venv && tests/peers/setup");
    python
}

/// Starts a script of `tests/ethercat/masters` at the MainDevice's end of the cable.
pub(crate) fn start_master(script: &str, arguments: &[String]) -> Child {
    let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests/ethercat/masters", script].iter().collect();
    Command::new(python()).arg(path).arg(MASTER_END).args(arguments).stdin(Stdio::null()).spawn().unwrap()
}

/// Waits until `program` has ended, and sees to it that it ended well.
pub(crate) async fn ends_well(program: &mut Child) {
    let status = loop {
        if let Some(status) = program.try_wait().unwrap() {
            break status;
        }
        Timer::after_millis(10).await;
    };
    assert!(status.success(), "the MainDevice's script: {status}");
}

#[test]
fn pysoem_brings_simple_devices_to_op_over_a_virtual_cable() {
    in_own_network("outside::pysoem_brings_simple_devices_to_op_over_a_virtual_cable", || {
        let chips = (0..2).map(|_| Chip::new(Kind::ET1100, simple_device()));
        let segment = Rc::new(RefCell::new(Segment::new(chips)));
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let mut script = start_master("simple_devices.py", &[]);
        serve(&socket, &segment, ends_well(&mut script)).unwrap();
        let chip = segment.borrow().chip(1);
        let mut outputs = [0; 2];
        chip.borrow_mut().read(mobgate_simulator::esc::now(), 0x1000, &mut outputs);
        assert_eq!(outputs, [0x12, 0x34]);
    });
}
