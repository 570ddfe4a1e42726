//! The sockets over embassy-net, against another embassy-net at the other end of a cable, in virtual time.

use std::net::{Ipv4Addr, SocketAddr};

use embassy_futures::join::{join, join3};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, Ports};
use mobgate::hal::{OpenErrorKind, TcpConnect, TcpHost, TcpStream as _, UdpHost, UdpSocket};
use mobgate::language::apply;
use mobgate::settings::{Host, ServerAddress, Settings, TcpListen};
use mobgate_net::{Connector, Datagrams, Sockets, TcpSockets, TcpStream, address};
use mobgate_simulator::World;

use crate::cable::{FAR, NEAR, wired};

pub(crate) const PORT_502: TcpListen = TcpListen { address: None, port: 502 };

fn at(address: Ipv4Addr, port: u16) -> SocketAddr {
    SocketAddr::new(address.into(), port)
}

pub(crate) fn server(address: Ipv4Addr, port: u16) -> ServerAddress {
    at(address, port).into()
}

/// A connection from `near` to `far`.
async fn connected(near: &'static Sockets, far: &'static Sockets) -> (TcpStream, TcpStream) {
    let (connector, mut host) = (Connector::new(near), TcpSockets::new(far));
    let (made, accepted) = join(connector.connect(&server(FAR, 502)), host.accept(&PORT_502)).await;
    let (accepted, peer) = accepted.unwrap();
    assert_eq!(peer.ip(), NEAR, "the peer's address is told, not the own one");
    (made.unwrap(), accepted)
}

#[test]
fn what_one_side_writes_the_other_reads() {
    let mut world = World::new(1);
    let (near, far, _) = wired(&world, 1, 1);
    world.run_until(async {
        let (mut client, mut server) = connected(near, far).await;
        let mut heard = [0; 8];
        client.write_all(b"ask").await.unwrap();
        assert_eq!(server.read(&mut heard).await.unwrap(), 3);
        server.write_all(b"response").await.unwrap();
        assert_eq!(client.read(&mut heard).await.unwrap(), 8);
        assert_eq!(&heard, b"response");
    });
}

#[test]
fn small_responses_in_a_row_wait_for_no_acknowledgement() {
    let mut world = World::new(1);
    let (near, far, _) = wired(&world, 1, 1);
    world.run_until(async {
        let (mut client, mut server) = connected(near, far).await;
        let start = Instant::now();
        for _ in 0..3 {
            server.write_all(b"response").await.unwrap();
            Timer::after_micros(10).await;
        }
        client.read_exact(&mut [0; 24]).await.unwrap();
        // The peer acknowledges after 10 ms.
        assert!(start.elapsed() < Duration::from_millis(2), "{}", start.elapsed());
    });
}

#[test]
fn several_hosts_accept_at_the_same_port() {
    let mut world = World::new(2);
    let (near, far, _) = wired(&world, 3, 3);
    world.run_until(async {
        let accept = || async { TcpSockets::new(far).accept(&PORT_502).await.unwrap().1 };
        let connect = || async {
            let stream = Connector::new(near).connect(&server(FAR, 502)).await.unwrap();
            Timer::after_millis(1).await;
            drop(stream);
        };
        let (peers, _) =
            join(join3(accept(), accept(), accept()), join3(connect(), connect(), connect())).await;
        assert!(peers.0 != peers.1 && peers.1 != peers.2 && peers.0 != peers.2);
    });
}

#[test]
fn without_a_socket_left_a_connection_is_refused_until_one_is_given_back() {
    let mut world = World::new(3);
    let (near, far, _) = wired(&world, 1, 2);
    world.run_until(async {
        let (first, _server) = connected(near, far).await;
        assert_eq!(near.free(), 0);
        let error = Connector::new(near).connect(&server(FAR, 502)).await.map(drop).unwrap_err();
        assert_eq!(error.kind, OpenErrorKind::Exhausted);
        let error = Datagrams::new(near).bind(&PORT_502).await.map(drop).unwrap_err();
        assert_eq!(error.kind, OpenErrorKind::Exhausted);
        first.close().await;
        assert_eq!(near.free(), 1);
        connected(near, far).await;
    });
}

#[test]
fn a_connection_that_is_closed_or_dropped_ends_for_the_peer_and_gives_its_socket_back() {
    for drops in [false, true] {
        let mut world = World::new(4);
        let (near, far, _) = wired(&world, 1, 1);
        world.run_until(async {
            let (mut client, mut server) = connected(near, far).await;
            server.write_all(b"last words").await.unwrap();
            let start = Instant::now();
            if drops {
                drop(server);
            } else {
                server.close().await;
            }
            let mut heard = [0; 10];
            client.read_exact(&mut heard).await.unwrap();
            assert_eq!(&heard, b"last words", "they are not overtaken by the end");
            assert!(matches!(client.read(&mut heard).await, Ok(0)));
            assert!(start.elapsed() < Duration::from_millis(300), "{}", start.elapsed());
            client.close().await;
            Timer::after_secs(1).await;
            assert_eq!((near.free(), far.free()), (1, 1));
        });
    }
}

#[test]
fn a_peer_that_does_not_end_its_side_holds_no_socket() {
    let mut world = World::new(5);
    let (near, far, _) = wired(&world, 1, 1);
    world.run_until(async {
        let (mut client, server) = connected(near, far).await;
        server.close().await;
        assert_eq!(far.free(), 1);
        Timer::after_millis(10).await;
        assert!(client.write(b"more").await.is_err(), "it was reset");
    });
}

#[test]
fn a_connection_outlives_a_short_interruption_and_not_a_long_one() {
    let mut world = World::new(6);
    let (near, far, cable) = wired(&world, 1, 1);
    world.run_until(async {
        let (mut client, mut server) = connected(near, far).await;
        cable.pull();
        client.write_all(b"late").await.unwrap();
        Timer::after_secs(5).await;
        cable.plug_in();
        let mut heard = [0; 4];
        server.read_exact(&mut heard).await.unwrap();

        cable.pull();
        let start = Instant::now();
        // Nobody writes: it is the keepalive that finds out.
        assert!(server.read(&mut heard).await.is_err());
        assert!(start.elapsed() < Duration::from_secs(45), "{}", start.elapsed());
        drop((server, client));
        Timer::after_secs(1).await;
        assert_eq!((near.free(), far.free()), (1, 1));
    });
}

#[test]
fn a_connection_that_cannot_be_made_says_why() {
    let mut world = World::new(7);
    let (near, far, _) = wired(&world, 2, 1);
    world.run_until(async {
        let connector = Connector::new(near);
        let refused = connector.connect(&server(FAR, 503)).await.map(drop).unwrap_err();
        assert_eq!(refused.kind, OpenErrorKind::Refused);
        let elsewhere = server(Ipv4Addr::new(192, 168, 9, 9), 502);
        let elsewhere = connector.connect(&elsewhere);
        assert_eq!(elsewhere.await.map(drop).unwrap_err().kind, OpenErrorKind::NotFound);
        let v6 = "[fe80::1]:502".parse::<SocketAddr>().unwrap().into();
        let v6 = connector.connect(&v6);
        assert_eq!(v6.await.map(drop).unwrap_err().kind, OpenErrorKind::Unsupported);
        let nobody = server(Ipv4Addr::new(10, 0, 0, 77), 502);
        let nobody = connector.connect(&nobody);
        assert!(with_timeout(Duration::from_secs(3), nobody).await.is_err(), "given up by the caller");
        assert_eq!((near.free(), far.free()), (2, 1));
    });
}

#[test]
fn a_server_listens_at_the_boards_own_address_or_says_that_it_is_not() {
    let mut world = World::new(8);
    let (near, far, _) = wired(&world, 1, 1);
    let listen = |address: &str| TcpListen { address: Some(address.parse().unwrap()), port: 502 };
    world.run_until(async {
        let mut host = TcpSockets::new(far);
        assert_eq!(host.listen(&listen("10.0.0.9")).unwrap_err().kind, OpenErrorKind::NotFound);
        assert_eq!(host.listen(&listen("::1")).unwrap_err().kind, OpenErrorKind::Unsupported);
        for good in ["10.0.0.2", "0.0.0.0"] {
            host.listen(&listen(good)).unwrap();
            let listen = listen(good);
            let connector = Connector::new(near);
            let (made, accepted) = join(connector.connect(&server(FAR, 502)), host.accept(&listen)).await;
            join(made.unwrap().close(), accepted.unwrap().0.close()).await;
        }
    });
}

#[test]
fn the_address_follows_the_settings() {
    let mut world = World::new(11);
    let (near, far, _) = wired(&world, 1, 1);
    let slots = [const { Slot::new() }; 1];
    let pool = FramePool::new(&slots, 0);
    let ports = Ports::<0>::new();
    let gateway = Gateway::new(&pool, &ports, &[]).with_own_network();
    let mut settings = Settings::new();
    world.run_until(async {
        let reached = async {
            apply(&mut settings, "network address 10.0.0.44/24 gateway 10.0.0.1").unwrap();
            gateway.apply(&settings).unwrap();
            Timer::after_millis(1).await;
            let state = address::state(far.stack());
            assert_eq!(state.address.unwrap().to_string(), "10.0.0.44/24");
            assert_eq!((state.link, state.hardware), (true, [2, 0, 0, 0, 0, 2]));
            let (connector, mut host) = (Connector::new(near), TcpSockets::new(far));
            join(connector.connect(&server([10, 0, 0, 44].into(), 502)), host.accept(&PORT_502))
                .await
                .0
                .unwrap();

            apply(&mut settings, "network dhcp name cabinet-7").unwrap();
            gateway.apply(&settings).unwrap();
            Timer::after_millis(1).await;
            assert_eq!(address::state(far.stack()).address, None, "nobody gives one here");
        };
        select(address::follow(&gateway, far.stack()), reached).await;
    });
}

#[test]
fn an_accept_that_is_given_up_leaves_no_listener() {
    let mut world = World::new(9);
    let (near, far, _) = wired(&world, 1, 1);
    world.run_until(async {
        select(TcpSockets::new(far).accept(&PORT_502), Timer::after_millis(5)).await;
        assert_eq!(far.free(), 1);
        let refused = Connector::new(near).connect(&server(FAR, 502)).await.map(drop).unwrap_err();
        assert_eq!(refused.kind, OpenErrorKind::Refused);
    });
}

#[test]
fn datagrams_go_both_ways_and_long_ones_are_cut_off() {
    let mut world = World::new(10);
    let (near, far, _) = wired(&world, 1, 1);
    world.run_until(async {
        let (mut asking, mut responding) = (Datagrams::new(near), Datagrams::new(far));
        let mut asking = asking.bind(&TcpListen { address: None, port: 5000 }).await.unwrap();
        let mut responding = responding.bind(&PORT_502).await.unwrap();
        asking.send(b"question", at(FAR, 502)).await.unwrap();
        let mut heard = [0; 5];
        assert_eq!(responding.receive(&mut heard).await, Ok((5, at(NEAR, 5000))));
        assert_eq!(&heard, b"quest");
        responding.send(b"yes", at(NEAR, 5000)).await.unwrap();
        assert_eq!(asking.receive(&mut heard).await, Ok((3, at(FAR, 502))));
        // Nobody there is no error.
        asking.send(b"lost", at(Ipv4Addr::new(192, 168, 9, 9), 1)).await.unwrap();
    });
    assert_eq!((near.free(), far.free()), (1, 1));
}

/// A name server that knows one name, and answers that others do not exist (RFC 1035 4.1).
async fn name_server(sockets: &'static Sockets, name: &[u8], address: Ipv4Addr) {
    let mut host = Datagrams::new(sockets);
    let mut socket = host.bind(&TcpListen { address: None, port: 53 }).await.unwrap();
    loop {
        let mut query = [0; 512];
        let (length, from) = socket.receive(&mut query).await.unwrap();
        let question = &query[12..length];
        let is_known = question.starts_with(name);
        // The id, a recursive response, one question, and one response or none.
        let mut response = query[..2].to_vec();
        response.extend([0x81, if is_known { 0x80 } else { 0x83 }, 0, 1, 0, is_known.into(), 0, 0, 0, 0]);
        response.extend(question);
        if is_known {
            // The name of the question, A, IN, a minute, four bytes.
            response.extend([0xc0, 12, 0, 1, 0, 1, 0, 0, 0, 60, 0, 4]);
            response.extend(address.octets());
        }
        socket.send(&response, from).await.unwrap();
    }
}

#[test]
fn a_name_is_looked_up_when_a_connection_is_made() {
    let mut world = World::new(8);
    let (near, far, cable) = wired(&world, 2, 3);
    world.run_until(async {
        let named = |name: &str| ServerAddress { host: Host::Name(name.try_into().unwrap()), port: 502 };
        let connector = Connector::new(near);
        let known = named("meter.example");
        let error = connector.connect(&known).await.map(drop).unwrap_err();
        assert!(error.hint.starts_with("no name server"), "{error}");
        assert_eq!(near.free(), 2, "a name that nobody is asked for holds no socket");

        let mut own = near.stack().config_v4().unwrap();
        own.dns_servers.push(FAR).unwrap();
        near.stack().set_config_v4(embassy_net::ConfigV4::Static(own));
        let serve = name_server(far, b"\x05meter\x07example\0", FAR);
        let ask = async {
            let mut host = TcpSockets::new(far);
            let (made, accepted) = join(connector.connect(&known), host.accept(&PORT_502)).await;
            let mut made = made.unwrap();
            made.write_all(b"ask").await.unwrap();
            assert_eq!(accepted.unwrap().0.read(&mut [0; 8]).await.unwrap(), 3);
            let error = connector.connect(&named("nobody.example")).await.map(drop).unwrap_err();
            assert!(
                error.kind == OpenErrorKind::NotFound && error.hint.contains("name is not known"),
                "{error}"
            );
            // Who asks for a name limits the time.
            cable.pull();
            let in_vain = with_timeout(Duration::from_secs(3), connector.connect(&known)).await;
            assert!(in_vain.is_err() || in_vain.is_ok_and(|made| made.is_err()));
        };
        select(serve, ask).await;
    });
}
