//! RTU over TCP and Modbus UDP, on the side of the clients.

use mobgate_simulator::client::frame;
use mobgate_simulator::net::Weather;

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

fn rtu_client(rig: &Rig<'_>) -> Client {
    Client::rtu(rig.network.connect(machine(1), 5_000).unwrap()).with_patience(SECOND)
}

#[test]
fn rtu_requests_in_pieces_or_in_a_row_are_answered_in_order() {
    for piece in [1, 3, 7] {
        with_devices(|world, rig, _| {
            let path = Path { piece_bytes_max: Some(piece), piece_spacing: 5 * MS, ..Path::default() };
            let stream = rig.network.connect_over(path, machine(1), 5_000).unwrap();
            let mut client = Client::rtu(stream).with_patience(SECOND);
            let requests: Vec<u8> = [READ, WRITE, READ].iter().flat_map(|pdu| rtu::frame(5, pdu)).collect();
            assert!(world.run_until(client.send_bytes(&requests)));
            assert_eq!(world.run_until(client.response(0, 5, &READ)), value(5));
            assert_eq!(world.run_until(client.response(0, 5, &WRITE)), Response::Pdu(WRITE.to_vec()));
            assert_eq!(world.run_until(client.response(0, 5, &READ)), value(5));
        });
    }
}

#[test]
fn corrupt_rtu_requests_get_no_response_and_the_next_one_does() {
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
            let response = world.run_until(client.request(5, &READ));
            assert_eq!(response, value(5), "round {round}, behind {bytes:02x?}");
        }
        assert_eq!(device.writes(), []);
        assert!(rig.counted("R", Event::Noise) >= 200);
    });
}

#[test]
fn in_bad_weather_a_client_that_asks_again_gets_its_own_responses() {
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
                    let Some(response) = world.run_until(client.receive(left)) else { break };
                    let id = u16::from_be_bytes([response[0], response[1]]);
                    assert_eq!(response, frame(id, 5, &[3, 2, 5, questions[&id]]));
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
