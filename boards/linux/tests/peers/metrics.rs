//! Prometheus's own tool and its client library read the metrics.

use std::fs::File;
use std::process::{Command, Stdio};

use crate::common::{USER, ask, converse, free_port, listening, with_console};
use crate::outside::{Tool, promtool, script};

/// Reads a unit's first register.
const READ: [u8; 5] = [3, 0, 0, 0, 1];

#[test]
fn promtool_has_no_complaint_and_a_client_library_reads_every_counter_with_port_and_unit() {
    let (port, (_never_responds, silent)) = (free_port(), listening());
    let program = with_console(&format!(
        "{USER}mdns off\nport web http server 127.0.0.1:{port}\nport P502 tcp server 127.0.0.1:{{port}}\n\
         port slow tcp client 127.0.0.1:{silent} timeout 100ms\nroute P502 1 * * local\nroute P502 7 * * slow\n"
    ));
    let mut client = program.connect();
    for unit in [1, 1, 1, 1, 1, 7] {
        ask(&mut client, unit, &READ);
    }
    let fetch = |metrics: &str| {
        let script = script("metrics.py");
        let file = program.file("metrics");
        let words = [script.to_str().unwrap(), &port.to_string(), metrics, file.to_str().unwrap()];
        let (good, said) = Tool::python().run(&words);
        assert!(good, "{said}");
        said
    };
    // Until the port says otherwise they need a log-in.
    assert!(fetch("closed").contains("401 without a log-in"));
    converse(&mut program.session(), "edit port web metrics\nshow config\n", " metrics");
    let said = fetch("open");
    assert!(said.contains("P502 requests 6") && said.contains("slow requests 1"), "{said}");
    assert!(said.contains("slow 7 up"), "{said}");
    assert!(said.contains("9 families"), "{said}");
    let text = File::open(program.file("metrics")).unwrap();
    let checked = Command::new(promtool()).args(["check", "metrics"]).stdin(Stdio::from(text)).output();
    let checked = checked.unwrap();
    let complaints = String::from_utf8_lossy(&[checked.stdout, checked.stderr].concat()).into_owned();
    assert!(checked.status.success() && complaints.trim().is_empty(), "{complaints}");
}
