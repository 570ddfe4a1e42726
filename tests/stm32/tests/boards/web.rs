//! The web interface: its page, a log-in, and settings that are changed by it.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Machine, Network};

use crate::network::{BOARD, STATION};
use crate::{on_each_board, set_up, started};

on_each_board!(@ h743zi, NUCLEO_H743ZI, a_page_is_served_and_a_user_changes_the_settings_by_it);

/// `let me in`, with parameters that cost little.
const USER: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"";
const LOG_IN: &str = "{\"user\":\"anna\",\"password\":\"let me in\",\"token\":true}";
/// Longest time for a response.
const ANSWERED: Duration = Duration::from_secs(10);

/// The board, and a client of its web interface.
struct Web {
    machine: Machine,
    network: Network,
    token: String,
}

impl Web {
    /// The response to a request: its head and its body.
    fn ask(&mut self, what: &str, kind: &str, body: &str) -> (String, Vec<u8>) {
        let Self { machine, network, token } = self;
        let client = network.connect(machine, BOARD, 80).unwrap();
        let mut head = format!("{what} HTTP/1.1\r\nHost: 192.168.7.2\r\n");
        if !token.is_empty() {
            head += &format!("Authorization: Bearer {token}\r\n");
        }
        if !kind.is_empty() {
            head += &format!("Content-Type: {kind}\r\nContent-Length: {}\r\n", body.len());
        }
        let request = format!("{head}\r\n{body}");
        assert_eq!(network.send_bytes(client, request.as_bytes()), request.len());
        let mut come = Vec::new();
        let is_over =
            network.run(machine, ANSWERED, |network| !network.receive_bytes(client, &mut come)).unwrap();
        let text = String::from_utf8_lossy(&come).into_owned();
        assert!(is_over, "{what}: {text}");
        let end = come.windows(4).position(|bytes| bytes == b"\r\n\r\n");
        let end = end.unwrap_or_else(|| panic!("{what}: {text}"));
        (text.split("\r\n\r\n").next().unwrap().to_owned(), come.split_off(end + 4))
    }

    /// The body of the response to a request, which has this status.
    fn gets(&mut self, status: u16, what: &str, kind: &str, body: &str) -> String {
        let (head, body) = self.ask(what, kind, body);
        let body = String::from_utf8_lossy(&body).into_owned();
        assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{what}: {head}: {body}");
        body
    }
}

fn a_page_is_served_and_a_user_changes_the_settings_by_it(board: Board) {
    let mut machine = started(board.with_users());
    // It is wider than the terminal, which shows parts of it.
    let shown = machine.type_line(USER).unwrap();
    assert!(!shown.contains("error"), "{shown}");
    set_up(&mut machine, &["network address 192.168.7.2/24", "port web http server 80 cleartext"]);
    machine.run(Duration::from_secs(2)).unwrap();
    let mut web = Web { machine, network: Network::new(STATION), token: String::new() };

    let (head, page) = web.ask("GET /", "", "");
    assert!(head.starts_with("HTTP/1.1 200 ") && head.contains("Content-Encoding: gzip"), "{head}");
    // One chunk, and the end.
    let text = String::from_utf8_lossy(&page);
    let length = text.split("\r\n").next().unwrap();
    let file = page.get(length.len() + 2..).and_then(|rest| rest.strip_suffix(b"\r\n0\r\n\r\n")).unwrap();
    assert!(file.starts_with(&[0x1f, 0x8b]) && length == format!("{:x}", file.len()), "{head}");

    let candidate = "POST /api/v1/settings/candidate";
    let line = "port P502 tcp server 502\nroute P502 1-64 * * local";
    web.gets(401, candidate, "text/plain", line);
    web.gets(401, "POST /api/v1/session", "application/json", &LOG_IN.replace("let", "led"));
    // A wrong password makes the next one wait.
    web.machine.run(Duration::from_secs(5)).unwrap();
    let session = web.gets(200, "POST /api/v1/session", "application/json", LOG_IN);
    let (_, token) = session.split_once("\"token\":\"").unwrap();
    web.token = token.split('"').next().unwrap().to_owned();

    let wrong = web.gets(422, candidate, "text/plain", "port P502 tcp server none");
    assert!(wrong.contains("\"word\":\"none\""), "{wrong}");
    let changed = web.gets(200, candidate, "text/plain", line);
    assert!(changed.contains("\"changes\":2"), "{changed}");
    let diff = web.gets(200, "GET /api/v1/settings/diff", "", "");
    assert!(diff.contains("+ port P502 tcp server 502"), "{diff}");
    assert!(!web.machine.type_line("show config").unwrap().contains("P502"));
    web.gets(204, "POST /api/v1/settings/commit", "application/json", "{}");
    let shown = web.machine.type_line("show config").unwrap();
    assert!(shown.contains("port P502 tcp server 502") && shown.contains("route P502"), "{shown}");
    let client = web.network.connect(&mut web.machine, BOARD, 502).unwrap();
    assert!(web.network.is_open(client), "the committed port listens");
    let status = web.gets(200, "GET /api/v1/status", "", "");
    assert!(status.contains("\"port\":\"P502\""), "{status}");
    assert_eq!(web.machine.resets, []);
}
