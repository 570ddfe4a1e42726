//! RTU over TCP and Modbus UDP, on the side of the clients.

use mobgate_simulator::client::frame;
use mobgate_simulator::client::rtu::RtuClient;
use mobgate_simulator::net::{UdpClient, Weather};

use crate::prelude::*;

const WRITE: [u8; 5] = [6, 0, 1, 0, 9];

const SETTINGS: &str = "port plc tcp client 10.0.1.1:502 in-flight 16 timeout 300ms
    port R tcp server 5000 rtu clients 4
    port U udp server 5020 pipeline 4 requests 6
    route R 1-247 * * plc
    route U 1-247 * * plc";

fn with_devices(scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device)) {
    with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        rig.attach_tcp(world, PLC, [device.clone()]);
        scenario(world, rig, &device);
        world.run_for(10 * SECOND);
        assert_eq!(rig.frames_in_use(), 0);
    });
}

fn rtu_client(rig: &Rig<'_>) -> RtuClient {
    RtuClient::new(rig.network.connect(machine(1), 5_000).unwrap()).with_patience(SECOND)
}

#[test]
fn an_rtu_frame_in_a_tcp_stream_is_answered_by_one() {
    with_devices(|world, rig, device| {
        let mut client = rtu_client(rig);
        let asked = Instant::now();
        assert_eq!(world.run_until(client.request(5, &READ)), value(5));
        assert_eq!(asked.elapsed(), MS, "no pause is waited for");
        assert_eq!(world.run_until(client.request(5, &WRITE)), Answer::Pdu(WRITE.to_vec()));
        assert_eq!(device.writes().len(), 1);
        assert_eq!(world.run_until(client.request(5, &[3, 0xff, 0xff, 0, 1])).exception(), Some(2));
        assert_eq!(world.run_until(client.request(5, &[3, 0, 0, 0, 126])).exception(), Some(3), "malformed");
        assert_eq!(world.run_until(client.request(250, &READ)).exception(), Some(0x0a), "no rule");
        assert_eq!(world.run_until(client.request(9, &READ)).exception(), Some(0x0b), "no such unit");
    });
}

#[test]
fn a_request_whose_length_is_unknown_is_ended_by_a_pause() {
    with_devices(|world, rig, _| {
        let mut client = rtu_client(rig);
        let asked = Instant::now();
        let answer = world.run_until(client.request(5, &[0x50, 1, 2, 3, 4, 5]));
        assert_eq!(answer.exception(), Some(1), "the device does not know it");
        assert_eq!(asked.elapsed(), 101 * MS);
    });
}

#[test]
fn rtu_requests_in_pieces_or_in_a_row_are_answered_in_order() {
    for piece in [1, 3, 7] {
        with_devices(|world, rig, _| {
            let path = Path { piece_bytes_max: Some(piece), piece_spacing: 5 * MS, ..Path::default() };
            let stream = rig.network.connect_over(path, machine(1), 5_000).unwrap();
            let mut client = RtuClient::new(stream).with_patience(SECOND);
            let requests: Vec<u8> = [READ, WRITE, READ].iter().flat_map(|pdu| rtu::frame(5, pdu)).collect();
            assert!(world.run_until(client.send_bytes(&requests)));
            assert_eq!(world.run_until(client.answer(5, &READ)), value(5));
            assert_eq!(world.run_until(client.answer(5, &WRITE)), Answer::Pdu(WRITE.to_vec()));
            assert_eq!(world.run_until(client.answer(5, &READ)), value(5));
        });
    }
}

#[test]
fn damaged_rtu_requests_get_no_answer_and_the_next_one_does() {
    with_devices(|world, rig, device| {
        let mut random = Random::new(1);
        let mut client = rtu_client(rig);
        for round in 0..200 {
            let mut bytes = rtu::frame(5, &WRITE);
            match random.index(4) {
                0 => bytes[random.index(8)] ^= 1 << random.index(8),
                1 => bytes.truncate(1 + random.index(7)),
                2 => drop(bytes.remove(random.index(8))),
                _ => bytes = (0..1 + random.index(400)).map(|_| random.byte()).collect(),
            }
            assert!(world.run_until(client.send_bytes(&bytes)));
            // Half of the time the good one comes right behind.
            if random.chance(0.5) {
                world.run_for(150 * MS);
            }
            let answer = world.run_until(client.request(5, &READ));
            assert_eq!(answer, value(5), "round {round}, behind {bytes:02x?}");
        }
        assert_eq!(device.writes(), []);
        assert!(rig.counted("R", Event::Noise) >= 200);
    });
}

#[test]
fn an_rtu_client_that_leaves_takes_its_request_with_it() {
    with_devices(|world, rig, device| {
        device.set_faults(Faults::new(1).with(When::Always, Fault::Late(200 * MS, 200 * MS)));
        let mut client = rtu_client(rig);
        assert!(world.run_until(client.send_bytes(&rtu::frame(5, &READ))));
        world.run_for(50 * MS);
        drop(client);
        world.run_for(SECOND);
        assert_eq!(rig.counted("R", Event::Left), 1);
        assert_eq!(rig.counted("R", Event::RequesterGone), 1);
    });
}

fn ask(world: &mut World<'_>, client: &UdpClient, transaction: u16, unit: u8, pdu: &[u8]) -> Option<Vec<u8>> {
    client.send(&frame(transaction, unit, pdu));
    world.run_until(client.receive(SECOND))
}

#[test]
fn a_datagram_is_answered_to_its_sender() {
    with_devices(|world, rig, device| {
        let clients = [1, 1, 2].map(|host| rig.network.udp_client(machine(host), 5_020));
        clients.iter().for_each(|client| client.send(&frame(77, 5, &READ)));
        for client in &clients {
            assert_eq!(world.run_until(client.receive(SECOND)), Some(frame(77, 5, &[3, 2, 5, 7])));
        }
        let [client, ..] = clients;
        assert_eq!(ask(world, &client, 1, 5, &WRITE), Some(frame(1, 5, &WRITE)));
        assert_eq!(device.writes().len(), 1);
        assert_eq!(ask(world, &client, 2, 5, &[3, 0, 0, 0, 126]), Some(frame(2, 5, &[0x83, 3])));
        assert_eq!(ask(world, &client, 3, 250, &READ), Some(frame(3, 250, &[0x83, 0x0a])), "no rule");
        assert_eq!(ask(world, &client, 4, 9, &READ), Some(frame(4, 9, &[0x83, 0x0b])), "no such unit");
        assert_eq!(world.run_until(client.receive(SECOND)), None);
    });
}

#[test]
fn a_datagram_that_is_not_one_frame_is_dropped() {
    with_devices(|world, rig, _| {
        let client = rig.network.udp_client(machine(1), 5_020);
        let good = frame(1, 5, &READ);
        let two = [good.clone(), good.clone()].concat();
        let protocol = [&[0, 1, 0, 1], &good[4..]].concat();
        let bad = [&[][..], &good[..5], &good[..11], &two, &protocol, &[0; 12], &[0xff; 2_000]];
        bad.iter().for_each(|bytes| client.send(bytes));
        assert_eq!(world.run_until(client.receive(SECOND)), None);
        assert_eq!(rig.counted("U", Event::Malformed), bad.len() as u32);
        assert_eq!(ask(world, &client, 2, 5, &READ), Some(frame(2, 5, &[3, 2, 5, 7])));
    });
}

#[test]
fn datagrams_of_strangers_are_dropped_in_restricted_mode() {
    with_devices(|world, rig, device| {
        rig.console("edit port U allow 10.0.0.2").unwrap();
        world.run_for(MS);
        let [stranger, known] = [1, 2].map(|host| rig.network.udp_client(machine(host), 5_020));
        assert_eq!(ask(world, &stranger, 1, 5, &WRITE), None);
        assert_eq!(rig.counted("U", Event::Unwelcome), 1);
        assert_eq!(ask(world, &known, 1, 5, &WRITE), Some(frame(1, 5, &WRITE)));
        assert_eq!(device.writes().len(), 1);
    });
}

#[test]
fn open_requests_by_udp_are_bounded_for_a_peer_and_in_all() {
    with_devices(|world, rig, device| {
        device.set_faults(Faults::new(1).with(When::Always, Fault::Late(100 * MS, 100 * MS)));
        let clients = [1, 2, 3].map(|host| rig.network.udp_client(machine(host), 5_020));
        for client in &clients {
            (1..=5).for_each(|transaction| client.send(&frame(transaction, 5, &READ)));
            world.run_for(MS);
        }
        world.run_for(SECOND);
        let answered = clients.map(|client| {
            let mut answers = 0;
            while let Some(answer) = world.run_until(client.receive(MS)) {
                answers += usize::from(answer[7] == 3);
                assert!(answer[7] == 3 || answer[7..] == [0x83, 6], "{answer:02x?}");
            }
            answers
        });
        assert_eq!(answered, [4, 2, 0]);
        assert_eq!(rig.counted("U", Event::QueueFull), 9);
    });
}

#[test]
fn a_datagram_that_comes_twice_is_carried_out_once_while_it_is_open() {
    with_devices(|world, rig, device| {
        device.set_faults(Faults::new(1).with(When::Always, Fault::Late(50 * MS, 50 * MS)));
        let client = rig.network.udp_client(machine(1), 5_020);
        (0..3).for_each(|_| client.send(&frame(1, 5, &WRITE)));
        assert_eq!(world.run_until(client.receive(SECOND)), Some(frame(1, 5, &WRITE)));
        assert_eq!(world.run_until(client.receive(SECOND)), None, "one answer");
        assert_eq!(device.writes().len(), 1);
        assert_eq!(rig.counted("U", Event::Duplicate), 2);
    });
}

#[test]
fn in_bad_weather_a_client_that_asks_again_gets_its_own_answers() {
    with_devices(|world, rig, _| {
        let latency = (Duration::from_micros(100), 20 * MS);
        rig.network.set_weather(Weather { loss: 0.2, doubling: 0.2, latency });
        let client = rig.network.udp_client(machine(1), 5_020);
        let mut random = Random::new(3);
        let mut questions = HashMap::new();
        let mut answered = 0;
        for transaction in 1..=500_u16 {
            let address = random.byte();
            questions.insert(transaction, address);
            'tries: for _ in 0..20 {
                client.send(&frame(transaction, 5, &[3, 0, address, 0, 1]));
                let until = Instant::now() + 60 * MS;
                while Instant::now() < until {
                    let left = until.saturating_duration_since(Instant::now());
                    let Some(answer) = world.run_until(client.receive(left)) else { break };
                    let id = u16::from_be_bytes([answer[0], answer[1]]);
                    assert_eq!(answer, frame(id, 5, &[3, 2, 5, questions[&id]]));
                    if id == transaction {
                        answered += 1;
                        break 'tries;
                    }
                }
            }
        }
        assert_eq!(answered, 500);
    });
}

#[test]
fn a_changed_udp_port_drops_what_was_open_and_goes_on() {
    with_devices(|world, rig, device| {
        device.set_faults(Faults::new(1).with(When::Requests(1..=1), Fault::Late(100 * MS, 100 * MS)));
        let client = rig.network.udp_client(machine(1), 5_020);
        client.send(&frame(1, 5, &READ));
        world.run_for(10 * MS);
        rig.console("edit port U pipeline 2").unwrap();
        assert_eq!(world.run_until(client.receive(SECOND)), None);
        assert_eq!(ask(world, &client, 2, 5, &READ), Some(frame(2, 5, &[3, 2, 5, 7])));
        rig.console("edit port U listen 5021").unwrap();
        world.run_for(MS);
        assert_eq!(ask(world, &client, 3, 5, &READ), None);
    });
}
