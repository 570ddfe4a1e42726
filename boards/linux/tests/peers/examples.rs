//! The examples of the documents, with their settings as they stand there: devices and addresses of a plant are replaced by those of
//! a test.

use std::net::{Ipv4Addr, SocketAddr, TcpStream};

use socket2::{Domain, Socket, Type};

use crate::common::{PATIENCE, Program, ask, example, wait_for};
use crate::lines::Line;
use crate::mosquitto::{Broker, Device, Listener, json};
use crate::outside::Tool;

const READ: [u8; 5] = [3, 0, 0, 0, 4];
const WRITE: [u8; 5] = [6, 0, 3, 0x12, 0x34];
const ILLEGAL_FUNCTION: [u8; 2] = [0x86, 1];

/// The program with the settings of the document `name`, in which each pair's first text becomes the second one.
fn program(name: &str, pairs: &[(&str, &str)]) -> Program {
    let mut settings = example(name);
    for (from, to) in pairs {
        assert!(settings.contains(from), "{name}: {from}");
        settings = settings.replace(from, to);
    }
    Program::configured(&format!("mdns off\n{settings}"))
}

/// A client with this address.
fn client_at(program: &Program, address: Ipv4Addr) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.bind(&SocketAddr::from((address, 0)).into()).unwrap();
    socket.connect(&SocketAddr::from((Ipv4Addr::LOCALHOST, program.port)).into()).unwrap();
    socket.set_tcp_nodelay(true).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    socket.into()
}

#[test]
fn three_clients_share_an_inverter_and_one_of_them_writes() {
    let inverter = Device::start();
    inverter.set(3, 7);
    let at = format!("127.0.0.1:{}", inverter.port);
    let program = program(
        "solar-inverter.md",
        &[
            ("192.168.1.50:502", &at),
            ("tcp server 502", "tcp server {port}"),
            ("192.168.1.0/24", "127.0.0.0/8"),
            ("192.168.1.20", "127.0.0.20"),
        ],
    );
    let mut manager = client_at(&program, Ipv4Addr::new(127, 0, 0, 20));
    let mut others = [21, 22].map(|host| client_at(&program, Ipv4Addr::new(127, 0, 0, host)));
    assert_eq!(ask(&mut manager, 1, &WRITE), WRITE);
    let read = [3, 8, 0, 0, 0, 0, 0, 0, 0x12, 0x34];
    for client in &mut others {
        assert_eq!(ask(client, 1, &WRITE), ILLEGAL_FUNCTION);
        assert_eq!(ask(client, 1, &READ), read);
    }
    // Within a second or not: the two may have been read once or twice.
    let (connections, requests) = inverter.served();
    assert_eq!(connections, 1);
    assert!((2..=3).contains(&requests), "{requests}");
    inverter.set(3, 9);
    assert_eq!(ask(&mut manager, 1, &READ)[8..], [0, 9], "the manager gets fresh values");
}

#[test]
fn a_plc_and_a_scada_system_share_a_line() {
    let (field, plc) = (Line::with_pymodbus(&[1, 2]), Line::without_server());
    let [field_end, plc_end] = [&field, &plc].map(|line| line.near_end().display().to_string());
    let program = program(
        "plc-and-scada.md",
        &[
            ("/dev/ttyUSB0", &plc_end),
            ("/dev/ttyUSB1", &field_end),
            ("rtu client 19200 8E1", "rtu client 19200 8E1 timeout 5s late-window 200ms"),
            ("tcp server 502", "tcp server {port}"),
            // What pymodbus's units have.
            ("100-119", "10-19"),
        ],
    );
    wait_for("both lines", || (program.log().matches("is open").count() == 2).then_some(()));
    let mut scada = program.connect();
    // Input register 7 of unit 2 is 0207h.
    assert_eq!(ask(&mut scada, 2, &[4, 0, 7, 0, 1]), [4, 2, 2, 7]);
    assert_eq!(ask(&mut scada, 1, &[6, 0, 10, 0, 5]), [6, 0, 10, 0, 5]);
    assert_eq!(ask(&mut scada, 1, &[6, 0, 9, 0, 5]), [0x86, 2], "this one is the PLC's");
    let end = plc.far_end().display().to_string();
    let words =
        ["-m", "rtu", "-b", "19200", "-P", "even", "-o", "10", "-1", "-a", "1", "-r", "11", "-t", "4"];
    let (_, said) = Tool::mbpoll().run(&[&words[..], &["-c", "1", &end]].concat());
    assert!(said.contains("[11]: \t5"), "{said}");
    let (_, said) = Tool::mbpoll().run(&[&words[..], &[&end, "6"]].concat());
    assert!(said.contains("Written 1 references."), "{said}");
    assert_eq!(ask(&mut scada, 1, &[3, 0, 10, 0, 1]), [3, 2, 0, 6]);
}

#[test]
fn home_assistant_is_told_of_meters_and_gets_their_values() {
    let broker = Broker::with_password("");
    let meters = Device::start();
    // 1234.5 as a number of 32 bits.
    meters.set(52, 0x449a);
    meters.set(53, 0x5000);
    let (bus, at) = (format!("tcp client 127.0.0.1:{}", meters.port), format!("127.0.0.1:{}", broker.port));
    let program = program(
        "home-assistant.md",
        &[
            ("serial /dev/ttyUSB0 rtu client 9600 8N1", &bus),
            ("tcp server 502", "tcp server {port}"),
            ("192.168.1.8", &at),
        ],
    );
    let listener = Listener::start(broker.port, &["-u", "gateway", "-P", "let me in"]);
    for meter in ["house", "garage"] {
        let topic = format!("homeassistant/sensor/mobgate/{meter}-power/config");
        let told = json(&listener.wait(&topic, |_| true).text);
        assert_eq!(told["state_topic"], format!("mobgate/points/{meter}-power"));
        let value = listener.wait(&format!("mobgate/points/{meter}-power"), |text| text.contains("good"));
        assert_eq!(json(&value.text)["value"], 1234.5);
    }
    // Others still ask.
    assert_eq!(ask(&mut program.connect(), 1, &[4, 0, 52, 0, 2]), [4, 4, 0x44, 0x9a, 0x50, 0]);
}
