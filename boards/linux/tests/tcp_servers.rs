//! The program as a client of TCP servers, and its UDP server.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use common::{PATIENCE, Program, ask, free_port, listening, wait_for};
use mobgate_simulator::own_network::{MASTER_END, in_own_network, ip};

mod common;

const READ: [u8; 5] = [3, 0, 0, 0, 1];

fn settings(server: u16, words: &str) -> String {
    format!(
        "port plc tcp client 127.0.0.1:{server} {words}
         port P502 tcp server {{port}}
         route P502 * * * plc
"
    )
}

/// Answers every request of a connection with a register that holds its unit, until the connection ends.
fn serve(mut stream: TcpStream) {
    stream.set_nodelay(true).unwrap();
    let mut request = [0; 12];
    while stream.read_exact(&mut request).is_ok() {
        let response = [&request[..4], &[0, 5, request[6], 3, 2, 0, request[6]]].concat();
        // In two segments.
        stream.write_all(&response[..8]).unwrap();
        thread::sleep(Duration::from_millis(2)); // so that they are not sent as one
        stream.write_all(&response[8..]).unwrap();
    }
}

#[test]
fn a_server_that_is_not_there_is_answered_0a_at_once_with_a_hint_and_asked_when_it_comes() {
    let server = free_port();
    let program = Program::configured(&settings(server, ""));
    let mut client = program.connect();
    for _ in 0..3 {
        let asked = Instant::now();
        assert_eq!(ask(&mut client, 7, &READ), [0x83, 0x0a]);
        // Not after the time-out for connections, which is 3 s.
        assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
    }
    program.logs("connection refused (nobody listens there");
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, server)).unwrap();
    thread::spawn(move || listener.incoming().for_each(|stream| serve(stream.unwrap())));
    wait_for("the connection", || (ask(&mut client, 7, &READ) == [3, 2, 0, 7]).then_some(()));
    assert_eq!(ask(&mut client, 9, &READ), [3, 2, 0, 9]);
}

#[test]
fn a_connection_that_breaks_is_made_again_and_leaves_no_descriptor() {
    let (listener, server) = listening();
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut request = [0; 12];
            // One response, then silence and the end behind the next request.
            if stream.read_exact(&mut request).is_ok() {
                let response = [&request[..4], &[0, 5, request[6], 3, 2, 0, request[6]]].concat();
                stream.write_all(&response).unwrap();
                let _ = stream.read_exact(&mut request);
            }
        }
    });
    let program = Program::configured(&settings(server, "timeout 5s"));
    let mut client = program.connect();
    assert_eq!(ask(&mut client, 7, &READ), [3, 2, 0, 7]);
    let descriptors = program.descriptors();
    for _ in 0..20 {
        let asked = Instant::now();
        assert_eq!(ask(&mut client, 7, &READ), [3, 2, 0, 7]);
        assert!(asked.elapsed() < Duration::from_secs(4), "the end is seen, and not waited for");
    }
    wait_for("the connections' end", || (program.descriptors() <= descriptors).then_some(()));
}

#[test]
fn sixteen_requests_are_open_at_a_server_at_a_time() {
    let (listener, server) = listening();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut requests = [[0; 12]; 16];
        // Nothing is answered before all have come, and the last is answered first.
        requests.iter_mut().for_each(|request| stream.read_exact(request).unwrap());
        for request in requests.iter().rev() {
            stream.write_all(&[&request[..4], &[0, 5, request[6], 3, 2, 0, request[6]]].concat()).unwrap();
        }
        let _ = stream.read(&mut [0]);
    });
    let program = Program::configured(&settings(server, "in-flight 16 timeout 10s"));
    let mut client = program.connect();
    for unit in 1..=16 {
        client.write_all(&[&[0, unit, 0, 0, 0, 6, unit], &READ[..]].concat()).unwrap();
    }
    for unit in (1..=16).rev() {
        let mut response = [0; 11];
        client.read_exact(&mut response).unwrap();
        assert_eq!(response, [0, unit, 0, 0, 0, 5, unit, 3, 2, 0, unit]);
    }
}

#[test]
fn a_datagram_is_answered_to_whoever_sent_it() {
    let (listener, server) = listening();
    thread::spawn(move || listener.incoming().for_each(|stream| serve(stream.unwrap())));
    let udp = free_port();
    let ports = format!("port U udp server {udp}\nroute U 1-247 * * plc\n");
    let program = Program::configured(&(settings(server, "") + &ports));
    program.logs("listening on UDP port");
    let clients = [(); 3].map(|()| UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap());
    for round in 0..100 {
        for (unit, client) in (1..).zip(&clients) {
            client.send_to(&[&[round, 1, 0, 0, 0, 6, unit], &READ[..]].concat(), ("127.0.0.1", udp)).unwrap();
        }
        for (unit, client) in (1..).zip(&clients) {
            client.set_read_timeout(Some(PATIENCE)).unwrap();
            let mut response = [0; 300];
            let (length, from) = client.recv_from(&mut response).unwrap();
            assert_eq!(response[..length], [round, 1, 0, 0, 0, 5, unit, 3, 2, 0, unit]);
            assert_eq!(from.port(), udp);
        }
    }
    // A client that is gone before its response comes: the port survives what the system says of that.
    let gone = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    gone.send_to(&[&[0, 1, 0, 0, 0, 6, 1], &READ[..]].concat(), ("127.0.0.1", udp)).unwrap();
    drop(gone);
    let [client, ..] = clients;
    client.send_to(&[0, 2, 0, 0, 0, 6, 250, 3, 0, 0, 0, 1], ("127.0.0.1", udp)).unwrap();
    let mut response = [0; 300];
    let (length, _) = client.recv_from(&mut response).unwrap();
    assert_eq!(response[..length], [0, 2, 0, 0, 0, 3, 250, 0x83, 0x0a], "no rule");
    drop(program);
}

#[test]
fn one_port_asks_many_servers_by_address_and_by_name_on_few_sockets() {
    const SERVERS: u8 = 12;
    let mut lines = String::new();
    for unit in 1..=SERVERS {
        // By its name a server on IPv4 alone is found, too, where the name has an address of IPv6 as well.
        let (listener, at) = listening();
        let host = if unit % 2 == 0 { "localhost" } else { "127.0.0.1" };
        lines += &format!("server plant unit {unit} at {host}:{at} tag =1\n");
        thread::spawn(move || {
            for stream in listener.incoming() {
                thread::spawn(move || serve_as(stream.unwrap(), unit));
            }
        });
    }
    let program = Program::configured(&format!(
        "port plant tcp client sockets 4
         port P502 tcp server {{port}}
         {lines}server plant unit 100 at nobody.invalid
         server plant unit 101 at 127.0.0.1:{}
         route P502 * * * plant\n",
        free_port()
    ));
    let before = program.descriptors();
    let mut client = program.connect();
    let mut other = program.connect();
    for round in 0..20 {
        if round == 3 {
            // Nobody waits for the look-up of a name that nobody has.
            other.write_all(&[&[0, 1, 0, 0, 0, 6, 100][..], &READ].concat()).unwrap();
        }
        for unit in 1..=SERVERS {
            assert_eq!(
                ask(&mut client, unit, &READ),
                [3, 2, unit, 1],
                "the unit's own server, as its unit 1"
            );
        }
        assert_eq!(ask(&mut client, 101, &READ), [0x83, 0x0a]);
        assert_eq!(ask(&mut client, 50, &READ), [0x83, 0x0a], "no server has it");
        let descriptors = program.descriptors();
        assert!(descriptors <= before + 8, "{descriptors} descriptors, {before} at the start");
    }
    let mut response = [0; 9];
    other.set_read_timeout(Some(PATIENCE)).unwrap();
    other.read_exact(&mut response).unwrap();
    assert_eq!(response[7..], [0x83, 0x0a]);
    program.logs("no connection to nobody.invalid:502");
}

/// Answers every request of a connection with a register that holds `server` and the unit asked.
fn serve_as(mut stream: TcpStream, server: u8) {
    let mut request = [0; 12];
    while stream.read_exact(&mut request).is_ok() {
        let response = [&request[..4], &[0, 5, request[6], 3, 2, server, request[6]]].concat();
        stream.write_all(&response).unwrap();
    }
}

#[test]
fn a_server_at_a_public_address_that_limits_nobody_is_warned_of() {
    in_own_network("a_server_at_a_public_address_that_limits_nobody_is_warned_of", || {
        ip(&format!("addr add 203.0.113.7/24 dev {MASTER_END}"));
        let lines = "port open tcp server {port}\nport limited tcp server 1502 allow 10.0.0.0/8\n\
                     port own tcp server 127.0.0.1:1503\n";
        let program = Program::configured(lines);
        let warning = format!("TCP port {} serves whoever reaches 203.0.113.7", program.port);
        program.logs(&warning);
        program.logs("listening on TCP port 1503");
        assert_eq!(program.log().matches("serves whoever").count(), 1, "{}", program.log());
    });
}
