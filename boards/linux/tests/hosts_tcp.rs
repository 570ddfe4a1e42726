//! The TCP sockets as the core's connection tasks see them.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use futures_lite::future::{or, poll_once, zip};
use mobgate::hal::{OpenErrorKind, TcpHost, TcpStream as _};
use mobgate::settings::TcpListen;
use mobgate_linux::reactor::block_on;
use mobgate_linux::tcp::{self, TcpSockets};
use mobgate_simulator::ports::free_port;

const LOOPBACK: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);

fn loopback() -> TcpListen {
    TcpListen { address: Some(LOOPBACK), port: free_port() }
}

fn connect(listen: &TcpListen) -> TcpStream {
    TcpStream::connect((LOOPBACK, listen.port)).unwrap()
}

/// Plays `test` with an open listener's sockets, a client that has connected, and the connection that was accepted from it.
fn served(test: impl AsyncFnOnce(TcpStream, tcp::TcpStream)) {
    let (listen, mut sockets) = (loopback(), TcpSockets::default());
    block_on(async {
        let _open = sockets.open(&listen).unwrap();
        let client = connect(&listen);
        let (stream, peer) = sockets.accept(&listen).await.unwrap();
        assert_eq!(peer, client.local_addr().unwrap());
        test(client, stream).await;
    });
}

#[test]
fn two_tasks_share_one_listener_and_each_gets_a_connection() {
    let (listen, sockets) = (loopback(), TcpSockets::default());
    let (mut one, mut two) = (sockets.clone(), sockets.clone());
    block_on(async {
        let _open = sockets.open(&listen).unwrap();
        let clients = [connect(&listen), connect(&listen)];
        let (first, second) = zip(one.accept(&listen), two.accept(&listen)).await;
        let peers = [first.unwrap().1, second.unwrap().1];
        assert_eq!(peers, clients.map(|client| client.local_addr().unwrap()));
    });
}

#[test]
fn without_an_address_ipv4_and_ipv6_peers_are_told_by_their_own_address() {
    let listen = TcpListen { address: None, port: free_port() };
    let mut sockets = TcpSockets::default();
    block_on(async {
        let _open = sockets.open(&listen).unwrap();
        let client = connect(&listen);
        let (_stream, peer) = sockets.accept(&listen).await.unwrap();
        assert_eq!(peer, client.local_addr().unwrap());
    });
}

#[test]
fn a_listener_closes_when_the_last_waiting_task_leaves() {
    let (listen, mut sockets) = (loopback(), TcpSockets::default());
    block_on(async {
        let gave_up = or(async { sockets.accept(&listen).await.map(drop).is_ok() }, async {
            Timer::after_millis(10).await;
            false
        });
        assert!(!gave_up.await);
    });
    assert!(TcpStream::connect((LOOPBACK, listen.port)).is_err());
}

#[test]
fn a_listener_stays_open_while_its_only_task_serves_a_connection() {
    let (listen, mut sockets) = (loopback(), TcpSockets::default());
    block_on(async {
        let open = sockets.open(&listen).unwrap();
        let _first = connect(&listen);
        let (stream, _) = sockets.accept(&listen).await.unwrap();
        drop(open);
        connect(&listen); // refused, and a panic, if the listener had closed
        drop(stream);
    });
    assert!(TcpStream::connect((LOOPBACK, listen.port)).is_err());
}

#[test]
fn dropping_a_pending_accept_loses_no_connection() {
    let (listen, mut sockets) = (loopback(), TcpSockets::default());
    block_on(async {
        let _open = sockets.open(&listen).unwrap();
        assert!(poll_once(sockets.accept(&listen)).await.is_none());
        let client = connect(&listen);
        let (_stream, peer) = sockets.accept(&listen).await.unwrap();
        assert_eq!(peer, client.local_addr().unwrap());
    });
}

#[test]
fn an_accepted_socket_has_nagle_off_and_keepalive_and_user_timeout_set() {
    served(async |_client, stream| {
        let socket = socket2::SockRef::from(&stream);
        assert!(socket.tcp_nodelay().unwrap());
        assert!(socket.keepalive().unwrap());
        assert_eq!(socket.tcp_keepalive_time().unwrap(), Duration::from_secs(30));
        assert_eq!(socket.tcp_keepalive_interval().unwrap(), Duration::from_secs(5));
        assert_eq!(socket.tcp_keepalive_retries().unwrap(), 3);
        assert_eq!(socket.tcp_user_timeout().unwrap(), Some(Duration::from_secs(30)));
    });
}

#[test]
fn bytes_pass_both_ways_and_a_fin_reads_as_the_end() {
    served(async |mut client, mut stream| {
        client.write_all(b"ask").unwrap();
        let mut text = [0; 8];
        assert_eq!(stream.read(&mut text).await.unwrap(), 3);
        stream.write_all(b"response").await.unwrap();
        assert_eq!(client.read(&mut text).unwrap(), 8);
        client.shutdown(std::net::Shutdown::Write).unwrap();
        assert_eq!(stream.read(&mut text).await.unwrap(), 0);
    });
}

#[test]
fn closing_lets_the_last_response_arrive_though_requests_are_unread() {
    served(async |mut client, mut stream| {
        client.write_all(&[0; 4096]).unwrap();
        stream.write_all(b"last").await.unwrap();
        stream.close().await;
        let mut text = Vec::new();
        client.read_to_end(&mut text).unwrap();
        assert_eq!(text, b"last");
    });
}

#[test]
fn closing_takes_a_bounded_time_when_the_peer_keeps_its_side_open() {
    served(async |_client, stream| {
        let start = Instant::now();
        stream.close().await;
        // Much later than it takes on a busy machine, and much earlier than TCP gives up.
        assert!(start.elapsed() < Duration::from_secs(10));
    });
}

#[test]
fn a_port_in_use_and_an_address_of_nobody_are_told_apart() {
    let taken = std::net::TcpListener::bind((LOOPBACK, 0)).unwrap();
    let listen = TcpListen { address: Some(LOOPBACK), port: taken.local_addr().unwrap().port() };
    assert_eq!(TcpSockets::default().open(&listen).unwrap_err().kind, OpenErrorKind::InUse);

    // TEST-NET-1 (RFC 5737): no machine has it.
    let nowhere: SocketAddr = "192.0.2.1:5020".parse().unwrap();
    let listen = TcpListen { address: Some(nowhere.ip()), port: nowhere.port() };
    assert_eq!(TcpSockets::default().open(&listen).unwrap_err().kind, OpenErrorKind::NotFound);
}
