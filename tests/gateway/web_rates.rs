//! How often the web interface may be called.

use std::cell::Cell;

use embassy_futures::select::{select, select4};
use mobgate::hal::NoUpdate;
use mobgate::web;
use mobgate_simulator::console::Medium;

use crate::cut_off::{Board, user};
use crate::prelude::*;
use crate::web_user::{JSON, User};

/// Requests of all clients together in a second: one each 2 ms.
const RATE_MAX: u32 = 500;

#[test]
fn requests_of_all_clients_together_get_one_turn_each_2_ms_whatever_they_ask_for() {
    let settings = format!("{}\nport web http server 80 cleartext\nport P502 tcp server 502\n", user());
    let log_in = r#"{"user":"anna","password":"one"}"#;
    for (what, kind, body, status) in [
        ("GET /api/v1/status", "", "", 401),
        ("GET /metrics", "", "", 401),
        ("GET /nothing", "", "", 404),
        ("POST /api/v1/session", JSON, log_in, 200),
    ] {
        rig::with_gateway(1, &settings, |world, rig| {
            let served = Cell::new(0);
            let connection = async |nth| {
                let (mut host, mut store) = (rig.network.host(), Medium::default());
                let mut update = NoUpdate("this is a simulation");
                web::run(rig.gateway, nth, &mut host, (&mut store, &mut update), &Board).await;
            };
            let client = async || {
                Timer::after(MS).await;
                // Without turns no time would pass.
                while served.get() < 2 * RATE_MAX {
                    let (got, _) =
                        User::new(&rig.network, "10.0.0.99").call(what, kind, body.as_bytes()).await;
                    assert_eq!(got, status, "{what}");
                    served.set(served.get() + 1);
                }
            };
            let interface = select4(connection(0), connection(1), connection(2), connection(3));
            let clients = select4(client(), client(), client(), client());
            world.run_until(select(select(interface, clients), Timer::after(SECOND + MS)));
            let rate = RATE_MAX - RATE_MAX / 100..=RATE_MAX + 1;
            assert!(rate.contains(&served.get()), "{what}: {} requests in a second", served.get());
        });
    }
}
