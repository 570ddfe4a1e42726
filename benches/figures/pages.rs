//! What two pages that are open, with live values, take of a saturated line's rate, and add to the instructions of its transactions.

use std::cell::Cell;
use std::process::Command;
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
/// The same where instructions are counted, which takes fifty times as long.
const COUNTED_RUN: Duration = Duration::from_secs(10);
/// How long clients then pause between transactions for a tenth of the line's rate.
const SELDOM: Duration = Duration::from_millis(600);
/// Tells this program, when it runs under callgrind, how many pages to open, and how many milliseconds clients pause.
const COUNTED: &str = "MOBGATE_COUNTED_PAGES_PAUSE";
/// A hundredth of the 9 200 instructions that a transaction takes the program.
const MORE_MAX: f64 = 92.0;
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

/// Transactions of the line, and events of all pages, with so many of these, while clients ask, and pause in between.
fn transactions(pages: u8, pause: Duration, run: Duration) -> (f64, u32) {
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
        let until = Instant::now() + run;
        for host in 1..=CLIENTS {
            let mut client = rig.client(machine(host), 502);
            world.spawn(async move {
                let clients = ClosedLoop::until(until).thinking(pause);
                clients.run(&mut client, || (1, read(host).to_vec()), |_, _, _| {}).await;
            });
        }
        world.run_for(run);
        (device.counters().requests[3] as f64, events.get())
    })
}

pub(crate) fn figures() {
    let saturated = |pages| transactions(pages, Duration::MIN, RUN);
    let ((alone, _), (beside, events)) = (saturated(0), saturated(PAGES));
    // Else the pages were not there.
    assert!(events >= u32::from(PAGES) * 50, "{events} events");
    figure("two_pages_line_rate_loss", 100.0 * (1.0 - beside / alone), "%", Target::AtMost(0.5));
}

/// Counts the core's user instructions by callgrind, in which this program runs again: with pages and without, and with clients that ask
/// without a pause or with one. The difference is that of transactions alone: what pages take by themselves, as often as they are sent
/// something, is in both.
pub(crate) fn instructions() {
    if let Ok(wanted) = std::env::var(COUNTED) {
        let (pages, pause) = wanted.split_once(' ').expect("two numbers");
        let pause = Duration::from_millis(pause.parse().unwrap());
        let (transactions, events) = transactions(pages.parse().unwrap(), pause, COUNTED_RUN);
        return println!("{transactions} {events}");
    }
    let each = |pages| {
        let ([few, some, _], [most, more, events]) = (counted(pages, SELDOM), counted(pages, Duration::MIN));
        assert!(more > 5.0 * some, "{more} and {some} transactions");
        let seconds = COUNTED_RUN.as_secs() as f64;
        assert!(pages == 0 || events >= f64::from(pages) * (seconds - 2.0), "{events} events");
        (most - few) / (more - some)
    };
    let (alone, beside) = (each(0), each(PAGES));
    figure("page_transaction_instructions", alone, "instructions", Target::None);
    figure("two_pages_transaction", beside - alone, "instructions", Target::AtMost(MORE_MAX));
}

/// The core's instructions, transactions and events of a run in which clients pause so long.
fn counted(pages: u8, pause: Duration) -> [f64; 3] {
    let report = tempfile::NamedTempFile::new().expect("a file for the report");
    let program = std::env::current_exe().expect("the path of this program");
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--compress-strings=no", "--compress-pos=no"])
        .arg(format!("--callgrind-out-file={}", report.path().display()))
        .arg(program)
        .arg("page_instructions")
        .env(COUNTED, format!("{pages} {}", pause.as_millis()))
        .output()
        .expect("valgrind");
    let said = String::from_utf8_lossy(&output.stdout);
    let counts =
        said.trim().split_once(' ').map(|(first, second)| [first, second].map(|count| count.parse().ok()));
    let Some([Some(transactions), Some(events)]) = counts else {
        panic!("{said}{}", String::from_utf8_lossy(&output.stderr));
    };
    [of_core(&std::fs::read_to_string(report.path()).expect("a report")), transactions, events]
}

/// Instructions of lines of the core, wherever they are inlined, without the web interface's own: the simulated devices, clients and
/// network take ten times as many.
fn of_core(report: &str) -> f64 {
    let (mut is_core, mut is_call, mut sum) = (false, false, 0);
    for line in report.lines() {
        if let Some(file) = ["fl=", "fi=", "fe="].iter().find_map(|key| line.strip_prefix(key)) {
            is_core = file.starts_with("src/") && !file.starts_with("src/web");
        } else if line.starts_with("calls=") {
            // The next line is what is called.
            is_call = true;
        } else if line.starts_with(|first: char| first.is_ascii_digit()) {
            let cost: Option<u64> = line.split_once(' ').and_then(|(_, cost)| cost.parse().ok());
            sum += if is_core && !is_call { cost.unwrap_or_default() } else { 0 };
            is_call = false;
        }
    }
    sum as f64
}
