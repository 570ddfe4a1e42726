//! npm's modbus-serial asks by every framing that it has in common with the gateway, and responds by Modbus TCP.

use crate::common::{Program, free_port};
use crate::lines::{Line, first_input, modbus_serial, pymodbus};
use crate::outside::{Tool, script};

/// Lets modbus-serial's client use and compare what it knows on `unit`, at `tcp:PORT`, `rtu:PORT` or a serial device.
fn compare(at: &str, unit: u8) {
    let script = script("node/client.js");
    let arguments = [script.to_str().unwrap(), at, &unit.to_string(), &first_input(unit).to_string()];
    let (good, said) = Tool::node().run(&arguments);
    assert!(good && said.contains("all compared"), "at {at} from unit {unit}: {said}");
}

#[test]
fn modbus_serial_asks_by_tcp_by_rtu_over_tcp_and_by_rtu_on_a_line() {
    // Each begins with a device that nobody has written to.
    let [tcp, rtu_server] = [(); 2].map(|()| free_port());
    let _server = pymodbus(format!("tcp:{tcp}").into(), &[1, 2, 3]);
    let line = Line::without_server();
    let program = Program::configured(&format!(
        "port T tcp client 127.0.0.1:{tcp} timeout 5s
         port P502 tcp server {{port}}
         port RS tcp server {rtu_server} rtu
         port L serial {} rtu server 115200 8N1 answer-within 10s
         route P502 1 * * T
         route RS 2 * * T
         route L 3 * * T
",
        line.near_end().display()
    ));
    program.logs("is open");
    compare(&format!("tcp:{}", program.port), 1);
    compare(&format!("rtu:{rtu_server}"), 2);
    compare(line.far_end().to_str().unwrap(), 3);
}

#[test]
fn modbus_serial_responds_by_tcp() {
    let server_port = free_port();
    let _server = modbus_serial(server_port, 7);
    let program = Program::configured(&format!(
        "port T tcp client 127.0.0.1:{server_port} timeout 5s
         port P502 tcp server {{port}}
         route P502 7 * * T
"
    ));
    compare(&format!("tcp:{}", program.port), 7);
}
