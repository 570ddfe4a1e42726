//! Data points between pymodbus and pymodbus: a controller's worked slave and master, each with the gateway as the other side.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;

use crate::common::{free_port, wait_for, with_console};
use crate::lines::Line;
use crate::outside::{Running, Tool, script};

const SLAVE: &str = "point inputs   local holding 0
point ints     local holding 1 count 8 as i16
point floats   local holding 10 count 8 as f32
point outputs  local holding 100
point int-outs local holding 101 count 4 as i16
point outs     local holding 110 count 4 as f32
";

fn client(at: &str, what: &str) {
    let script = script("points_client.py");
    let (good, said) = Tool::python().run(&[script.to_str().unwrap(), at, what]);
    assert!(good && said.contains("all compared"), "{what} at {at}: {said}");
}

fn server(port: u16) -> Running {
    let mut server = Tool::python().start([script("points_server.py").into(), port.to_string().into()]);
    let mut said = String::new();
    BufReader::new(server.0.stdout.as_mut().unwrap()).read_line(&mut said).unwrap();
    assert_eq!(said, "ready\n", "pymodbus's server");
    server
}

/// Types `lines`; all that is said until the version that is asked for behind them.
fn console(session: &mut UnixStream, lines: &str) -> String {
    session.write_all(format!("{lines}\nshow version\n").as_bytes()).unwrap();
    let mut said = String::new();
    while !said.contains("mobgate 0.") {
        let mut piece = [0; 4096];
        let count = session.read(&mut piece).unwrap_or_else(|error| panic!("{error} after {said}"));
        assert!(count > 0, "the session ended after {said}");
        said += &String::from_utf8_lossy(&piece[..count]);
    }
    said
}

#[test]
fn the_worked_slave_is_read_and_written_by_pymodbus_over_tcp_and_a_serial_line() {
    let line = Line::without_server();
    let program = with_console(&format!(
        "port P502 tcp server {{port}}
port plc serial {} rtu server 115200 8E1
route P502 1 * * local
route plc 1 * * local
{SLAVE}",
        line.near_end().display()
    ));
    program.logs("is open");
    let mut session = program.session();
    let said = console(
        &mut session,
        "write inputs 165\nwrite ints -4 -3 -2 -1 0 1 2 3\nwrite floats -1 -0.5 0 0.5 1 1.5 2 2.5",
    );
    assert!(!said.contains("error"), "{said}");
    for at in [format!("tcp:{}", program.port), line.far_end().display().to_string()] {
        client(&at, "read");
        client(&at, "write");
        let said = console(&mut session, "show points");
        for values in ["[0] 77", "[0] 1000 -1000 2000 -2000", "[0] 0.25 -0.25 1000000 -1000000"] {
            assert!(said.contains(values), "{values} is not in\n{said}");
        }
        console(&mut session, "write outputs 0\nwrite int-outs 0 0 0 0\nwrite outs 0 0 0 0");
    }
}

#[test]
fn the_worked_master_polls_pymodbus_and_writes_to_it_by_hand_and_automatically() {
    let port = free_port();
    let _server = server(port);
    let program = with_console(&format!(
        "port plc tcp client 127.0.0.1:{port} timeout 5s
port P502 tcp server {{port}}
port scan scanner
route scan 1 * * plc
route P502 1 * * local
device plc unit 1
point di   plc holding 0
point ai   plc holding 1 count 8 as i16 read low
point af   plc holding 10 count 8 as f32 read low
point do   plc holding 100 write manual
point ao   plc holding 101 count 4 as i16 write auto
point fo   plc holding 110 count 4 as f32 write auto
point s-di local holding 0 of di
point s-ai local holding 1 of ai
point s-af local holding 10 of af
point s-ao local holding 101 of ao
point s-fo local holding 110 of fo
"
    ));
    let mut session = program.session();
    wait_for("the first poll", || console(&mut session, "read af").contains("ok;").then_some(()));
    client(&format!("tcp:{}", program.port), "read");
    let said = console(
        &mut session,
        "write do 77\nwrite ao 5 -6 7 -8\nbegin fo\nwrite fo 1.5\nwrite fo at 3 -2.5\nfinish fo",
    );
    assert!(!said.contains("error"), "{said}");
    // What the server holds, not what was written.
    let said = console(&mut session, "read do\nread ao\nread fo");
    for values in ["[0] 77\n", "[0] 5 -6 7 -8\n", "[0] 1.5 0 0 -2.5\n"] {
        assert!(said.contains(values), "{values} is not in\n{said}");
    }
    assert_eq!(said.matches("0002h ok;").count(), 3, "{said}");
    let said = console(&mut session, "show devices\nshow points");
    assert!(said.contains("alive") && !said.contains("never"), "{said}");
}
