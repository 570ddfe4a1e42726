//! The page of the QEMU board in a real browser: what it shows on Linux, from a gateway with nothing but one user to devices that others
//! read. `cargo xtask test qemu-browser` runs it.

use std::process::Command;
use std::time::Duration;

use mobgate_qemu::{Bus, Image, Machine, Options, image};
use serde_json::json;

#[test]
fn a_board_is_set_up_and_watched_in_a_browser() {
    let folder = image::root().join("target/browser");
    let modules = folder.join("node_modules");
    assert!(modules.join("playwright-core").exists(), "no playwright-core: cargo xtask install browser");
    let flash = tempfile::tempdir().unwrap();
    let machine = Machine::start(flash.path(), Options { image: Image::Web, ..Options::default() });
    let bus = Bus::new([1, 2, 3]);
    // At 9600 baud the board sends a request for 9 ms.
    bus.response_after(Duration::from_millis(60));
    machine.wire(1, &bus);
    let mut console = machine.console();
    // The first user is made at the board.
    for line in ["delete routes", "delete port P1", "delete port P2", "delete port P3", "delete port P502"] {
        assert_eq!(console.run(line), "", "{line}");
    }
    assert_eq!(console.run("user anna role engineer"), "");
    console.type_keys("password anna\rlet me in\rlet me in\r");
    console.read_until("mobgate*> ");
    assert_eq!(console.run("port web http server 80 cleartext"), "");
    assert_eq!(console.run("save").trim_end(), "saved");
    machine.logs("listening on TCP port 80");
    let script = image::root().join("boards/linux/tests/browser/page.js");
    let pictures = folder.join("qemu");
    let what = json!({
        "base": format!("http://127.0.0.1:{}", machine.web_port()),
        "device": "uart1",
        "modbus": 502,
        "reached": machine.port(),
        "folder": pictures,
        "pid": machine.id(),
        "name": "qemu_",
        "views": false,
        "soon": 300,
    });
    let mut browser = Command::new("node");
    browser.env("NODE_PATH", &modules).arg(script).arg(what.to_string());
    let status = browser.status().unwrap_or_else(|error| panic!("node: {error}"));
    assert!(status.success(), "{status}; the pictures are in {}", pictures.display());
    println!("the stack has held {} bytes", machine.figures().stack_bytes());
}
