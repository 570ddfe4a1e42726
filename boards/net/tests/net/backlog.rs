//! Many clients that connect at a time to a board of which a few sockets listen.

use std::net::Ipv4Addr;

use embassy_futures::join::{join, join_array};
use embassy_net::ConfigV4;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use mobgate::hal::{OpenErrorKind, TcpConnect, TcpHost, TcpStream as _};
use mobgate_net::{Connector, Sockets, TcpSockets, TcpStream};
use mobgate_simulator::World;

use crate::cable::{Cable, FAR, at, wired};
use crate::sockets::{PORT_502, server};

/// Clients of a board.
const CLIENTS: usize = 16;
/// A SYN that is lost is sent again after a second.
const AT_ONCE: Duration = Duration::from_millis(500);

/// Clients at `near`, and a board at `far` that sends back what it receives; each of its sockets has a task.
fn served(world: &World<'static>, clients: usize) -> (&'static Sockets, &'static Sockets, Cable) {
    let (near, far, cable) = wired(world, clients, CLIENTS + 1);
    for _ in 0..=CLIENTS {
        world.spawn(async move {
            loop {
                let mut stream = TcpSockets::new(far).accept(&PORT_502).await.unwrap().0;
                let mut heard = [0; 8];
                while let Ok(length @ 1..) = stream.read(&mut heard).await {
                    stream.write_all(&heard[..length]).await.unwrap();
                }
                stream.close().await;
            }
        });
    }
    (near, far, cable)
}

async fn connect(sockets: &'static Sockets, to: Ipv4Addr) -> TcpStream {
    Connector::new(sockets).connect(&server(to, 502)).await.unwrap()
}

async fn ask(client: &mut TcpStream) {
    client.write_all(b"ask").await.unwrap();
    client.read_exact(&mut [0; 3]).await.unwrap();
}

/// So many connect in the same moment, and are all accepted soon.
async fn connect_at_a_time<const N: usize>(near: &'static Sockets, soon: Duration) {
    let all = join_array([(); N].map(|()| connect(near, FAR)));
    let mut all = with_timeout(soon, all).await.expect("all are accepted soon");
    for client in &mut all {
        ask(client).await;
    }
}

#[test]
fn clients_that_connect_at_a_time_are_all_accepted() {
    let mut world = World::new(20);
    let (near, ..) = served(&world, CLIENTS);
    world.run_until(connect_at_a_time::<CLIENTS>(near, AT_ONCE));
}

#[test]
fn none_is_refused_although_the_board_is_busy() {
    let mut world = World::new(21);
    let (near, _, cable) = served(&world, CLIENTS + 1);
    world.run_until(async {
        // They know its Ethernet address.
        let _first = connect(near, FAR).await;
        cable.keep_far_busy();
        connect_at_a_time::<CLIENTS>(near, Duration::from_secs(2)).await;
    });
}

#[test]
fn as_many_as_wait_are_accepted_without_asking_again() {
    // Two listen, and eight wait.
    const AT_A_TIME: usize = 10;
    let mut world = World::new(22);
    let (near, _, cable) = served(&world, CLIENTS);
    world.run_until(async {
        let _first = connect(near, FAR).await;
        cable.keep_far_busy();
        connect_at_a_time::<AT_A_TIME>(near, AT_ONCE).await;
    });
}

#[test]
fn a_client_that_asks_again_and_again_waits_once() {
    const OTHERS: usize = 7;
    let mut world = World::new(23);
    let (near, _, cable) = served(&world, CLIENTS);
    world.run_until(async {
        let mut first = connect(near, FAR).await;
        cable.keep_far_busy();
        // The board sees all of them in one look: two sockets take as many, and the others are one.
        for _ in 0..CLIENTS {
            cable.forge([10, 0, 0, 9].into(), 4000, 502);
        }
        first.write_all(b"ask").await.unwrap();
        connect_at_a_time::<OTHERS>(near, AT_ONCE).await;
    });
}

#[test]
fn clients_that_come_and_go_wait_for_nobody() {
    let mut world = World::new(26);
    let (near, ..) = served(&world, CLIENTS);
    world.run_until(async {
        let _first = connect(near, FAR).await;
        for round in 0..50 {
            let clients = with_timeout(Duration::from_millis(10), async {
                [connect(near, FAR).await, connect(near, FAR).await, connect(near, FAR).await]
            });
            let clients = clients.await.unwrap_or_else(|_| panic!("round {round}: all sockets seem taken"));
            for client in clients {
                client.close().await;
            }
        }
    });
}

#[test]
fn with_all_sockets_connected_a_client_waits_for_the_next_that_is_free() {
    let mut world = World::new(27);
    let (near, ..) = served(&world, CLIENTS + 2);
    world.run_until(async {
        let mut all = Vec::new();
        for _ in 0..=CLIENTS {
            all.push(connect(near, FAR).await);
        }
        let left = async {
            Timer::after_millis(300).await;
            all.pop().unwrap().close().await;
            Instant::now()
        };
        let came = async {
            let client = connect(near, FAR).await;
            (client, Instant::now())
        };
        let (left, (mut newcomer, came)) = join(left, came).await;
        ask(&mut newcomer).await;
        assert!(came < left + Duration::from_millis(100), "{left} {came}: it need not ask again");
    });
}

#[test]
fn a_client_that_has_gone_does_not_wait_for_ever() {
    let mut world = World::new(28);
    let (near, _, cable) = served(&world, CLIENTS + 2);
    world.run_until(async {
        let mut all = Vec::new();
        for _ in 0..=CLIENTS {
            all.push(connect(near, FAR).await);
        }
        // As many as can wait.
        for port in 0..8 {
            cable.forge([10, 0, 0, 9].into(), 4000 + port, 502);
        }
        Timer::after_secs(4).await;
        // The next one has a place.
        let left = async {
            Timer::after_millis(300).await;
            all.pop().unwrap().close().await;
        };
        let (_, newcomer) = join(left, with_timeout(AT_ONCE, connect(near, FAR))).await;
        ask(&mut newcomer.expect("it waits, and is accepted")).await;
    });
}

#[test]
fn a_flood_from_elsewhere_ends_no_connection() {
    const FLOOD: u16 = 200;
    let mut world = World::new(24);
    let (near, _, cable) = served(&world, 2);
    world.run_until(async {
        let mut client = connect(near, FAR).await;
        for round in 0..10 {
            for port in 0..FLOOD {
                cable.forge([10, 0, 0, 100 + round].into(), 4000 + port, 502);
            }
            let start = Instant::now();
            ask(&mut client).await;
            assert!(start.elapsed() < Duration::from_millis(50), "{}", start.elapsed());
            Timer::after_millis(30).await;
        }
        // What the flood has half opened times out.
        Timer::after_secs(35).await;
        let newcomer = with_timeout(AT_ONCE, connect(near, FAR)).await;
        ask(&mut newcomer.expect("a new client is accepted")).await;
        ask(&mut client).await;
    });
}

#[test]
fn a_socket_that_does_not_take_its_syn_is_free_again_after_100_ms() {
    let moved = Ipv4Addr::new(10, 0, 0, 44);
    let mut world = World::new(25);
    let (near, far, _) = served(&world, 4);
    world.run_until(async {
        connect(near, FAR).await.close().await;
        // The clients still know the old address.
        far.stack().set_config_v4(ConfigV4::Static(at(moved)));
        let refused = Connector::new(near).connect(&server(moved, 503)).await.map(drop).unwrap_err();
        assert_eq!(refused.kind, OpenErrorKind::Refused, "no socket listens there");
        let start = Instant::now();
        let in_vain = || with_timeout(Duration::from_millis(5), connect(near, FAR));
        let in_vain = join_array([(); 2].map(|()| in_vain())).await;
        assert!(in_vain.iter().all(Result::is_err), "nobody has this address");
        ask(&mut with_timeout(AT_ONCE, connect(near, moved)).await.expect("a socket is free again")).await;
        assert!((100..210).contains(&start.elapsed().as_millis()), "{}", start.elapsed());
    });
}
