//! What two pages that are open, with live values, take of a saturated line's rate.

use std::cell::Cell;
use std::rc::Rc;

use embedded_io_async::{Read, Write};
use mobgate::hal::{NoUpdate, System};
use mobgate::web;
use mobgate_simulator::console::Medium;
use mobgate_simulator::net::Network;

use crate::line::{Speed, TURNAROUND, read};
use crate::prelude::*;

const PAGES: u8 = 2;
const CLIENTS: u8 = 8;
const BAUD: u32 = 115_200;
const RUN: Duration = Duration::from_secs(60);
const SETTINGS: &str = "port web http server 80 cleartext
user anna role viewer password \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"
";

/// A system that knows every password.
struct Board;

impl System for Board {
    fn name(&self) -> &str {
        "board"
    }

    async fn is_password(&self, _: Option<&str>, _: &str) -> bool {
        true
    }

    fn random(&self, into: &mut [u8]) -> bool {
        into.fill(7);
        true
    }

    fn reboot(&self) {}
}

/// Sends a request, and hands over what comes until the connection ends.
async fn call(network: &Network, from: u8, head: &str, body: &str, mut each: impl FnMut(&str)) {
    let mut stream = network.connect(machine(from), 80).unwrap();
    let length = body.len();
    let request = format!("{head}Host: 10.0.0.1\r\nContent-Length: {length}\r\n\r\n{body}");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut piece = [0; 2_048];
    while let Ok(count @ 1..) = stream.read(&mut piece).await {
        each(&String::from_utf8_lossy(&piece[..count]));
    }
}

/// Logs in, and takes events forever.
async fn page(network: Network, from: u8, events: Rc<Cell<u32>>) {
    let (mut token, body) = (String::new(), r#"{"user":"anna","password":"x","token":true}"#);
    let json = "POST /api/v1/session HTTP/1.1\r\nContent-Type: application/json\r\n";
    call(&network, from, json, body, |text| token.push_str(text)).await;
    let token = token.split_once("\"token\":\"").expect("a token").1.split('"').next().unwrap().to_owned();
    let head = format!("GET /api/v1/events HTTP/1.1\r\nAuthorization: Bearer {token}\r\n");
    loop {
        call(&network, from, &head, "", |text| {
            events.set(events.get() + text.matches("data: ").count() as u32);
        })
        .await;
    }
}

/// Transactions of the line, and events of all pages, with so many of them.
fn transactions(pages: u8) -> (f64, u32) {
    let settings = format!("{}{SETTINGS}", Speed::new(BAUD).settings());
    rig::with_gateway(1, &settings, |world, rig| {
        let device = Device::new(1).with_turnaround(TURNAROUND);
        rig.attach(world, "bus", [device.clone()]);
        let (gateway, events) = (rig.gateway, Rc::new(Cell::new(0)));
        for nth in 0..usize::from(PAGES) {
            let (mut host, mut store) = (rig.network.host(), Medium::default());
            let mut update = NoUpdate("this is a bench");
            world.spawn(async move {
                web::run(gateway, nth, &mut host, (&mut store, &mut update), &Board).await;
            });
        }
        // The listener is open.
        world.run_for(Duration::from_millis(10));
        for nth in 0..pages {
            world.spawn(page(rig.network.clone(), 100 + nth, events.clone()));
        }
        let until = Instant::now() + RUN;
        for host in 1..=CLIENTS {
            let mut client = rig.client(machine(host), 502);
            world.spawn(async move {
                ClosedLoop::until(until).run(&mut client, || (1, read(host).to_vec()), |_, _, _| {}).await
            });
        }
        world.run_for(RUN);
        (device.counters().requests[3] as f64, events.get())
    })
}

pub(crate) fn figures() {
    let ((alone, _), (beside, events)) = (transactions(0), transactions(PAGES));
    // Else the pages were not there.
    assert!(events >= u32::from(PAGES) * 50, "{events} events");
    figure("two_pages_line_rate_loss", 100.0 * (1.0 - beside / alone), "%", Target::AtMost(0.5));
}
