//! A server in the network that answers a read behind a write that came later.

use mobgate_simulator::client::frame;

use crate::prelude::*;

const WRITE: [u8; 5] = [6, 0, 7, 0, 9];
const OLD: [u8; 4] = [3, 2, 0, 1];
const NEW: [u8; 4] = [3, 2, 0, 9];
const REQUEST_BYTES: usize = 12;
const SETTINGS: &str = "port plc tcp client 10.0.1.1:502 in-flight 2
    port P502 tcp server 502
    route P502 * * * plc cache 10s";

/// The server carries the write out before it answers the read that it took in before.
#[test]
fn a_response_from_before_a_write_that_was_on_its_way_meanwhile_is_not_kept() {
    with_gateway(1, SETTINGS, |world, rig| {
        let server = rig.network.serve(address(PLC));
        world.spawn(async move {
            let mut stream = server.accept().await;
            let (mut read, mut write) = ([0; REQUEST_BYTES], [0; REQUEST_BYTES]);
            stream.read_exact(&mut read).await.unwrap();
            stream.read_exact(&mut write).await.unwrap();
            let response = |request: &[u8], pdu: &[u8]| {
                frame(u16::from_be_bytes([request[0], request[1]]), request[6], pdu)
            };
            stream.write_all(&response(&write, &WRITE)).await.unwrap();
            stream.write_all(&response(&read, &OLD)).await.unwrap();
            while stream.read_exact(&mut read).await.is_ok() {
                stream.write_all(&response(&read, &NEW)).await.unwrap();
            }
        });
        let mut session = asking(world, rig, 1, [(5, READ), (5, WRITE)]);
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, WRITE);
        assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, OLD);
        for cached in 0..3 {
            world.run_until(session.send(5, &READ));
            assert_eq!(world.run_until(session.next()).reply.unwrap().pdu, NEW);
            assert_eq!(rig.counted("plc", Event::Cached), cached);
        }
    });
}
