//! A board as it is found on its network: another embassy-net asks, in virtual time. What is said is looked at where it is made, in
//! boards/mdns.

use std::net::Ipv4Addr;

use embassy_net::udp::{PacketMetadata, UdpSocket};
use embassy_time::{Duration, with_timeout};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Connection, Gateway, Ports};
use mobgate::language::apply;
use mobgate::settings::Settings;
use mobgate_net::{Sockets, mdns};
use mobgate_simulator::World;

use crate::cable::{NEAR, wired};

const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
const PORT: u16 = 5353;
/// Longer than both announcements take.
const WHILE: Duration = Duration::from_secs(3);

/// PTR? _modbus._tcp.local, as in RFC 1035, 4.1.
const QUERY: &[u8] = b"\0\x07\0\0\0\x01\0\0\0\0\0\0\x07_modbus\x04_tcp\x05local\0\0\x0c\0\x01";

/// A gateway with these settings answers at `near`.
fn board(world: &World<'static>, near: &'static Sockets, lines: &[&str]) -> &'static Gateway<'static> {
    let slots: &[Slot] = Box::leak(Box::new([const { Slot::new() }; 2]));
    let pool = Box::leak(Box::new(FramePool::new(slots, 0)));
    let ports = Box::leak(Box::new(Ports::<4>::new()));
    let connections: &[Connection] = Box::leak(Box::new([const { Connection::new() }; 16]));
    let gateway: &Gateway<'static> =
        Box::leak(Box::new(Gateway::new(pool, ports, connections).with_own_network()));
    change(gateway, lines);
    world.spawn(mdns::run(gateway, near.stack()));
    gateway
}

fn change(gateway: &Gateway<'_>, lines: &[&str]) {
    let mut settings = gateway.settings(Settings::clone);
    lines.iter().for_each(|line| _ = apply(&mut settings, line).unwrap());
    gateway.apply(&settings).unwrap();
}

/// What comes to `port` of `far`, which may ask first, until nothing has come for a while.
async fn heard(far: &'static Sockets, port: u16, ask: bool) -> Vec<Vec<u8>> {
    let (mut one, mut other) = ([PacketMetadata::EMPTY; 4], [PacketMetadata::EMPTY; 4]);
    let (mut receive, mut transmit) = ([0; 2048], [0; 2048]);
    let mut socket = UdpSocket::new(far.stack(), &mut one, &mut receive, &mut other, &mut transmit);
    socket.bind(port).unwrap();
    far.stack().join_multicast_group(GROUP).unwrap();
    if ask {
        socket.send_to(QUERY, (GROUP, PORT)).await.unwrap();
    }
    let mut messages = Vec::new();
    loop {
        let next = socket.recv_from_with(|message, from| (message.to_vec(), from.endpoint));
        let Ok((message, from)) = with_timeout(WHILE, next).await else { return messages };
        assert_eq!(from, (NEAR, PORT).into());
        messages.push(message);
    }
}

fn has(message: &[u8], text: &[u8]) -> bool {
    message.windows(text.len()).any(|window| window == text)
}

#[test]
fn a_board_says_twice_what_it_has_and_answers_who_asks() {
    let mut world = World::new(1);
    let (near, far, _) = wired(&world, 1, 1);
    let gateway = board(&world, near, &["port P502 tcp server 502 clients 2"]);
    // Its Ethernet address ends in these.
    let name = b"mobgate-000001";
    let announced = world.run_until(heard(far, PORT, false));
    assert_eq!(announced.len(), 2);
    assert!(announced.iter().all(|message| has(message, name) && has(message, &NEAR.octets())));
    let answers = world.run_until(heard(far, PORT, true));
    assert!(matches!(&answers[..], [answer] if has(answer, name) && answer[..2] == [0, 0]), "{answers:x?}");
    let answers = world.run_until(heard(far, 40_000, true));
    assert!(matches!(&answers[..], [answer] if has(answer, name) && answer[..2] == [0, 7]), "{answers:x?}");

    change(gateway, &["mdns on name cabinet-7"]);
    let announced = world.run_until(heard(far, PORT, false));
    assert_eq!(announced.len(), 2, "{announced:x?}");
    assert!(announced.iter().all(|message| has(message, b"\x09cabinet-7")));
    change(gateway, &["mdns off"]);
    assert_eq!(world.run_until(heard(far, PORT, true)), Vec::<Vec<u8>>::new());
}

#[test]
fn ten_questions_a_second_are_answered() {
    let mut world = World::new(1);
    let (near, far, _) = wired(&world, 1, 1);
    board(&world, near, &["port P502 tcp server 502 clients 2"]);
    world.run_until(heard(far, PORT, false));
    let answers = world.run_until(async {
        let (mut one, mut other) = ([PacketMetadata::EMPTY; 4], [PacketMetadata::EMPTY; 4]);
        let (mut receive, mut transmit) = ([0; 2048], [0; 2048]);
        let mut socket = UdpSocket::new(far.stack(), &mut one, &mut receive, &mut other, &mut transmit);
        socket.bind(PORT).unwrap();
        let mut answers = 0;
        for _ in 0..40 {
            socket.send_to(QUERY, (GROUP, PORT)).await.unwrap();
            let answer = socket.recv_from_with(|_, _| ());
            answers += u32::from(with_timeout(Duration::from_millis(10), answer).await.is_ok());
        }
        answers
    });
    assert_eq!(answers, 10);
}
