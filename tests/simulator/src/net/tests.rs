//! Connections: how bytes travel and how they end.

use std::net::{IpAddr, Ipv4Addr};

use embassy_time::{Duration, Instant, with_timeout};
use embedded_io_async::{ErrorKind, Read, Write};
use mobgate::hal::{OpenErrorKind, TcpHost, TcpStream};
use mobgate::settings::TcpListen;

use super::{ClientStream, GatewayStream, Network, Path};
use crate::world::World;

const HERE: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 7));
const LISTEN: TcpListen = TcpListen { address: None, port: 502 };

/// A connection over `path`, and `scenario` with its two ends.
fn connected(path: Path, scenario: impl AsyncFnOnce(ClientStream, GatewayStream)) {
    let network = Network::new(3);
    let mut world = World::new(3);
    let mut host = network.host();
    let accepted = world.spawn(async move { host.accept(&LISTEN).await.unwrap() });
    world.run_for(Duration::from_ticks(1));
    let client = network.connect_over(path, HERE, 502).unwrap();
    world.run_until(async {
        let (server, peer) = accepted.await;
        assert_eq!(peer.ip(), HERE);
        scenario(client, server).await;
    });
}

async fn read_some(stream: &mut impl Read) -> Vec<u8> {
    let mut buffer = [0; 256];
    let count = stream.read(&mut buffer).await.unwrap();
    buffer[..count].to_vec()
}

#[test]
fn bytes_arrive_in_order_after_the_latency() {
    let path = Path { latency: Duration::from_millis(20), ..Path::default() };
    connected(path, async |mut client, mut server| {
        let sent = Instant::now();
        client.write_all(&[1, 2]).await.unwrap();
        client.write_all(&[3]).await.unwrap();
        assert_eq!(read_some(&mut server).await, [1, 2, 3]);
        assert_eq!(sent.elapsed(), Duration::from_millis(20));
        server.write_all(&[4]).await.unwrap();
        server.flush().await.unwrap();
        assert_eq!(sent.elapsed(), Duration::from_millis(60), "flushed when the acknowledgement is back");
    });
}

#[test]
fn writes_are_cut_into_pieces_and_lose_nothing() {
    let path = Path { piece_bytes_max: Some(4), ..Path::default() };
    connected(path, async |mut client, mut server| {
        let sent: Vec<u8> = (0..100).collect();
        client.write_all(&sent).await.unwrap();
        let mut received = Vec::new();
        while received.len() < sent.len() {
            let piece = read_some(&mut server).await;
            assert!((1..=4).contains(&piece.len()));
            received.extend(piece);
        }
        assert_eq!(received, sent);
    });
}

#[test]
fn coalesced_writes_arrive_together() {
    let path = Path { coalesce: Duration::from_millis(40), ..Path::default() };
    connected(path, async |mut client, mut server| {
        client.write_all(&[1]).await.unwrap();
        embassy_time::Timer::after_millis(10).await;
        client.write_all(&[2]).await.unwrap();
        assert_eq!(read_some(&mut server).await, [1, 2]);
        assert_eq!(Instant::now().as_millis(), 40);
    });
}

#[test]
fn a_full_window_makes_the_writer_wait_for_the_reader() {
    let path = Path { window_bytes: 10, ..Path::default() };
    connected(path, async |mut client, mut server| {
        server.write_all(&[0; 10]).await.unwrap();
        assert!(with_timeout(Duration::from_secs(60), server.write(&[1])).await.is_err());
        assert_eq!(read_some(&mut client).await.len(), 10);
        server.write_all(&[1]).await.unwrap();
    });
}

#[test]
fn a_close_delivers_what_was_written_and_then_the_end() {
    connected(Path::default(), async |mut client, mut server| {
        server.write_all(&[5]).await.unwrap();
        server.close().await;
        assert_eq!(read_some(&mut client).await, [5]);
        assert_eq!(read_some(&mut client).await, []);
        assert_eq!(client.write(&[1]).await, Err(ErrorKind::ConnectionReset));
    });
}

#[test]
fn a_dropped_server_stream_is_a_reset() {
    connected(Path::default(), async |mut client, server| {
        drop(server);
        assert_eq!(client.read(&mut [0; 4]).await, Err(ErrorKind::ConnectionReset));
    });
}

#[test]
fn a_client_ends_by_fin_by_reset_or_without_a_word() {
    connected(Path::default(), async |mut client, mut server| {
        client.write_all(&[1]).await.unwrap();
        client.finish();
        assert_eq!(read_some(&mut server).await, [1]);
        assert_eq!(read_some(&mut server).await, []);
        server.write_all(&[2]).await.unwrap();
        assert_eq!(read_some(&mut client).await, [2], "half closed is not closed");
    });
    connected(Path::default(), async |client, mut server| {
        client.reset();
        assert_eq!(server.read(&mut [0; 4]).await, Err(ErrorKind::ConnectionReset));
    });
    connected(Path::default(), async |client, mut server| {
        client.vanish();
        assert!(with_timeout(Duration::from_secs(3_600), server.read(&mut [0; 4])).await.is_err());
        server.write_all(&[1]).await.unwrap();
    });
}

#[test]
fn several_hosts_share_a_listener_and_the_last_takes_it_away() {
    let network = Network::new(1);
    let mut hosts = [network.host(), network.host()];
    let mut world = World::new(1);
    assert!(network.connect(HERE, 502).is_err(), "nobody listens yet");
    let accepted: Vec<_> = hosts
        .iter_mut()
        .map(|host| world.spawn(async move { host.accept(&LISTEN).await.unwrap().1.port() }))
        .collect();
    world.run_for(Duration::from_ticks(1));
    let _clients = [network.connect(HERE, 502).unwrap(), network.connect(HERE, 502).unwrap()];
    let mut waiting = network.connect(HERE, 502).unwrap();
    let ports: Vec<u16> = accepted.into_iter().map(|accepted| world.run_until(accepted)).collect();
    assert_ne!(ports[0], ports[1]);
    drop(world);
    drop(hosts);
    assert!(!network.is_listening(502));
    let mut world = World::new(2);
    assert_eq!(world.run_until(waiting.read(&mut [0; 1])), Err(ErrorKind::ConnectionReset));
}

#[test]
fn a_port_that_cannot_be_had_says_why() {
    let network = Network::new(1);
    network.refuse_listeners(502, Some(OpenErrorKind::Denied));
    let mut world = World::new(1);
    let mut host = network.host();
    assert_eq!(world.run_until(host.accept(&LISTEN)).err().unwrap().kind, OpenErrorKind::Denied);
}
