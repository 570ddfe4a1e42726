//! The client against a server of a few lines.

use std::net::{IpAddr, Ipv4Addr};

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use mobgate::hal::{TcpHost, TcpStream};
use mobgate::settings::TcpListen;

use super::load::ClosedLoop;
use super::{Client, NoResponse, Response, frame};
use crate::net::{Network, Path, SimTcpHost};
use crate::world::World;

/// What a server sends when it has read something.
type Reaction = fn(&[u8]) -> Vec<u8>;

const HERE: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

/// Gives each read of the stream to `respond` and sends what that returns; ends at the client's FIN.
async fn serve(mut host: SimTcpHost, response: impl Fn(&[u8]) -> Vec<u8>) {
    let (mut stream, _) = host.accept(&TcpListen { address: None, port: 502 }).await.unwrap();
    let mut buffer = [0; 1024];
    while let Ok(count @ 1..) = stream.read(&mut buffer).await {
        stream.write_all(&response(&buffer[..count])).await.unwrap();
    }
    stream.close().await;
}

fn with_server(path: Path, response: Reaction, scenario: impl AsyncFnOnce(&mut Client)) {
    let network = Network::new(1);
    let mut world = World::new(1);
    world.spawn(serve(network.host(), response));
    world.run_for(Duration::from_ticks(1));
    let mut client = Client::new(network.connect_over(path, HERE, 502).unwrap());
    world.run_until(scenario(&mut client));
}

#[test]
fn a_response_is_found_in_split_and_coalesced_bytes() {
    let pieces =
        Path { piece_bytes_max: Some(3), piece_spacing: Duration::from_millis(1), ..Path::default() };
    let pair: Reaction = |request| match request {
        [0, 1, ..] => [frame(1, 9, &[3, 2, 0, 1]), frame(2, 9, &[0x83, 2])].concat(),
        _ => Vec::new(),
    };
    with_server(pieces, pair, async |client| {
        assert_eq!(client.request(9, &[3, 0, 0, 0, 1]).await, Response::Pdu(vec![3, 2, 0, 1]));
        assert_eq!(client.receive().await.unwrap().pdu, [0x83, 2]);
    });
}

#[test]
fn an_exception_is_told_from_a_response() {
    let refuses: Reaction = |_| frame(1, 9, &[0x83, 11]);
    with_server(Path::default(), refuses, async |client| {
        assert_eq!(client.request(9, &[3, 0, 0, 0, 1]).await.exception(), Some(11));
    });
}

#[test]
fn another_transaction_unit_or_function_is_no_response() {
    let wrong: [Reaction; 3] = [|_| frame(2, 9, &[3, 0]), |_| frame(1, 8, &[3, 0]), |_| frame(1, 9, &[4, 0])];
    for response in wrong {
        with_server(Path::default(), response, async |client| {
            assert!(matches!(client.request(9, &[3, 0, 0, 0, 1]).await, Response::Wrong(_)));
        });
    }
}

#[test]
fn silence_ends_with_the_patience() {
    with_server(
        Path::default(),
        |_| Vec::new(),
        async |client| {
            let asked = Instant::now();
            assert_eq!(client.request(9, &[3]).await, Response::Silence);
            assert_eq!(asked.elapsed(), Duration::from_secs(10));
            assert_eq!(client.receive().await, Err(NoResponse::Silence));
        },
    );
}

#[test]
fn a_closed_loop_counts_what_it_got_and_how_long_it_took() {
    let path = Path { latency: Duration::from_millis(5), ..Path::default() };
    with_server(
        path,
        |request| frame(u16::from_be_bytes([request[0], request[1]]), 9, &[3, 0]),
        async |client| {
            let closed_loop =
                ClosedLoop::until(Instant::from_millis(1_000)).thinking(Duration::from_millis(10));
            let load = closed_loop.run(client, || (9, vec![3, 0, 0, 0, 1]), |_, _, _| ()).await;
            assert_eq!((load.responses, load.silences, load.closed), (50, 0, false));
            assert_eq!(load.latencies.percentile(99.0), Some(Duration::from_millis(10)));
        },
    );
}
