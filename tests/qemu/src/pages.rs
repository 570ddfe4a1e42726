//! What two pages of the web interface that are open and live cost the board while a transaction runs, their own instructions within
//! included, and by themselves.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::path::Path;
use std::thread::{sleep, spawn};
use std::time::Duration;

use crate::cost::{INSTRUCTIONS_PER_TICK, TICKS_ROUND, TRIALS, typical, web_interface};
use crate::figure::{Target, figure};
use crate::{Bus, Figures, Image, Machine, Options, PATIENCE};

/// `let me in`, with parameters that cost little.
const USER: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"";
const PAGES: usize = 2;
/// The files of the page.
const FILES: [&str; 4] = ["/", "/page.css", "/page.js", "/icon.svg"];
/// Seconds within which the pages' own instructions are counted, and looks at their count in each, before it comes round.
const SECONDS: usize = 10;
const LOOKS: usize = 10;

/// Prints both, and what the interface takes of the image.
pub fn figures(folder: &Path) {
    let options = Options { counts_instructions: true, image: Image::Web, ..Options::default() };
    let machine = Machine::start(folder, options);
    let bus = Bus::new([1]);
    machine.wire(1, &bus);
    let (mut console, mut figures, mut client) = (machine.console(), machine.figures(), machine.client());
    for line in [USER, "port web http server 80 cleartext"] {
        assert_eq!(console.run(line), "", "{line}");
    }
    machine.logs("listening on TCP port 80");
    web_interface(FILES.iter().map(|path| length(machine.web_port(), path)).sum());
    let mut transaction =
        |figures: &mut Figures| typical(figures, TRIALS, || assert_eq!(client.read(1, 0, 10).len(), 22)).all;
    let (alone, idle) = (transaction(&mut figures), per_second(&mut figures));
    let token = log_in(machine.web_port());
    (0..PAGES).for_each(|_| follow(machine.web_port(), &token));
    let (beside, live) = (transaction(&mut figures), per_second(&mut figures));
    let more = 100.0 * (beside - alone) / alone;
    figure("qemu_web_transaction_instructions", alone, "instructions", Target::None);
    figure("qemu_two_pages_transaction", more, "%", Target::None);
    let own = (live - idle) / PAGES as f64;
    figure("qemu_page_instructions", own, "instructions/s", Target::None);
}

/// Instructions in a second of nothing else.
fn per_second(figures: &mut Figures) -> f64 {
    let mut before = figures.busy().0;
    let mut ticks = 0;
    for _ in 0..SECONDS * LOOKS {
        sleep(Duration::from_secs(1) / LOOKS as u32);
        let now = figures.busy().0;
        ticks += now.wrapping_sub(before) % TICKS_ROUND;
        before = now;
    }
    f64::from(ticks) * INSTRUCTIONS_PER_TICK / SECONDS as f64
}

/// Sends a request, and gives the connection.
fn ask(port: u16, head: &str, body: &str) -> TcpStream {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(format!("{head}Host: localhost\r\n\r\n{body}").as_bytes()).unwrap();
    stream
}

fn length(port: u16, path: &str) -> f64 {
    let mut response = Vec::new();
    ask(port, &format!("GET {path} HTTP/1.1\r\n"), "").read_to_end(&mut response).unwrap();
    let text = String::from_utf8_lossy(&response).into_owned();
    // A file is one chunk, which begins with its length.
    let length = text.split_once("\r\n\r\n").and_then(|(_, chunk)| chunk.split("\r\n").next());
    let length = length.and_then(|length| u32::from_str_radix(length, 16).ok());
    f64::from(length.unwrap_or_else(|| panic!("{path}: {text}")))
}

fn log_in(port: u16) -> String {
    let body = "{\"user\":\"anna\",\"password\":\"let me in\",\"token\":true}";
    let length = body.len();
    let head = format!(
        "POST /api/v1/session HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n"
    );
    let mut response = String::new();
    ask(port, &head, body).read_to_string(&mut response).unwrap();
    let token = response.split_once("\"token\":\"").and_then(|(_, rest)| rest.split_once('"'));
    token.unwrap_or_else(|| panic!("{response}")).0.to_owned()
}

/// Takes live values, as a page does, in a thread that ends with the board. Returns once the first have come.
fn follow(port: u16, token: &str) {
    let mut stream =
        ask(port, &format!("GET /api/v1/events HTTP/1.1\r\nAuthorization: Bearer {token}\r\n"), "");
    let (mut come, mut piece) = (String::new(), [0; 4_096]);
    while !come.contains("\n\n") {
        let count = stream.read(&mut piece).unwrap();
        assert!(count > 0, "it ended after {come:?}");
        come.push_str(&String::from_utf8_lossy(&piece[..count]));
    }
    assert!(come.starts_with("HTTP/1.1 200"), "{come}");
    spawn(move || while stream.read(&mut piece).is_ok_and(|count| count > 0) {});
}
