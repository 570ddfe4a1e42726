//! A validator of JSON schemas by others takes the schema of the settings, and finds that they fit.

use crate::common::{USER, free_port, with_console};
use crate::outside::{Tool, script};

/// Lines of most kinds, with options of each type.
const LINES: &str = "port P502 tcp server 127.0.0.1:{port} clients 4 idle 5m
port many tcp client
port one tcp client 127.0.0.1:1 retries 2 timeout 2s
port udp udp server 127.0.0.1:{port}
port line serial /dev/none rtu client 19200 8E1 retries 3 proof read holding 0 count 2 for 20-29
port poll scanner
server many unit 1-5 at 127.0.0.1:1 tag +10
route P502 1-64 * * one functions 3,4,16 merge near 8 priority high
device meter unit 5 order 2301 label \"Boiler # 2\"
point power meter holding 0 count 2 as f32 read high
point lamps local coil 0 count 12
";

#[test]
fn settings_as_json_fit_their_schema() {
    let port = free_port();
    let _program = with_console(&format!("{LINES}{USER}mdns off\nport web http server 127.0.0.1:{port}\n"));
    let script = script("settings_schema.py");
    let (good, said) = Tool::python().run(&[script.to_str().unwrap(), &port.to_string()]);
    assert!(good && said.contains("all fit"), "{said}");
}
