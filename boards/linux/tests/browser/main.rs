//! The page in a real browser: from a gateway with nothing but one user to devices that others read, by clicks alone; then each view at the
//! sizes of a phone and a desk, dark and light, by keyboard, and judged by axe-core. `cargo xtask test browser` runs it.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::Duration;

use mobgate_simulator::device::{Memory, rtu};
use serde_json::json;
use serial2::SerialPort;

#[path = "../common/mod.rs"]
mod common;

use common::{Program, USER, free_port};

/// The devices: register 7 of the first holds 256 + 7.
const UNITS: [u8; 3] = [1, 2, 3];
/// What a short request and its response take at 9600 baud. A pseudo terminal takes no time, and from that the gateway computes response
/// times of 0, for which `tune` proposes nothing.
const ON_THE_WIRE: Duration = Duration::from_millis(20);

/// Responds as the devices until the line hangs up. A frame ends where its check is right: the gateway sends one at a time.
fn serve(line: SerialPort) {
    thread::spawn(move || {
        let mut memories = UNITS.map(Memory::new);
        let (mut frame, mut piece) = (Vec::new(), [0; 256]);
        loop {
            match line.read(&mut piece) {
                Ok(0) => return,
                Ok(count) => frame.extend_from_slice(&piece[..count]),
                // The rest of a frame that is for nobody here.
                Err(error) if error.kind() == ErrorKind::TimedOut => frame.clear(),
                Err(_) => return,
            }
            let Some((unit, pdu)) = rtu::open(&frame) else { continue };
            if let Some(place) = UNITS.iter().position(|known| *known == unit) {
                let response = memories[place].execute(pdu).unwrap_or_else(|code| vec![pdu[0] | 0x80, code]);
                // It is not an event that could be awaited.
                thread::sleep(ON_THE_WIRE);
                line.write_all(&rtu::frame(unit, &response)).unwrap();
            }
            frame.clear();
        }
    });
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/browser")
}

#[test]
fn a_gateway_is_set_up_and_watched_in_a_browser() {
    let modules = folder().join("node_modules");
    assert!(modules.join("playwright-core").exists(), "no playwright-core: cargo xtask install browser");
    let (mut far, near) = SerialPort::pair().unwrap();
    far.set_read_timeout(Duration::from_millis(200)).unwrap();
    let device = rustix::termios::ttyname(&near, Vec::new()).unwrap().into_string().unwrap();
    serve(far);
    let modbus = free_port();
    // The server whose port is awaited is the interface: nothing else is set.
    let settings = format!("{USER}mdns off\nport web http server 127.0.0.1:{{port}}\n");
    let program = Program::configured(&settings);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser/page.js");
    let what = json!({
        "base": format!("http://127.0.0.1:{}", program.port),
        "device": device,
        "modbus": modbus,
        "reached": modbus,
        "folder": folder(),
        "pid": program.id(),
        "name": "",
        "views": true,
        "soon": 0,
    });
    let mut browser = Command::new("node");
    browser.env("NODE_PATH", &modules).arg(script).arg(what.to_string());
    let status = browser.status().unwrap_or_else(|error| panic!("node: {error}"));
    assert!(status.success(), "{status}; the pictures are in {}", folder().display());
}
