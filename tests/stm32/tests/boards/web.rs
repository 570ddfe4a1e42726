//! The images with the web interface: the page, a log-in, and an update by HTTP.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, CONSOLE, Machine, Network, Uart};

use crate::firmware::START_MAX;
use crate::network::{BOARD, STATION};
use crate::update_file::{of_version, signed};
use crate::{on_each_board, set_up, started};

on_each_board!(
    but f429zi:
    a_browser_gets_the_page_whole,
    an_update_by_http_runs_on_trial_and_one_that_is_tampered_with_is_refused,
);

/// Longest time for a password's hash, which the emulator does not hurry.
const HASHED: Duration = Duration::from_secs(5);
/// Longest time for a response, with the flash that an update takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A board with a user and the web interface.
fn serving(board: Board) -> (Machine, Network) {
    let mut machine = started(board.with_web());
    set_up(&mut machine, &["network address 192.168.7.2/24", "user anna role engineer"]);
    machine.send(Uart::Console, b"password anna\rlet me in\rlet me in\r", CONSOLE);
    machine.wait_for_prompt(HASHED).unwrap();
    set_up(&mut machine, &["port web http server 80 cleartext"]);
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    machine.run(Duration::from_secs(2)).unwrap();
    (machine, Network::new(STATION))
}

/// Sends a request in a connection of its own; returns the head of the response, and its body.
fn ask(machine: &mut Machine, network: &mut Network, request: &[u8]) -> (String, Vec<u8>) {
    let client = network.connect(machine, BOARD, 80).unwrap();
    let (mut sent, mut received) = (0, Vec::new());
    let closed = network.run(machine, PATIENCE, |network| {
        sent += network.send_bytes(client, &request[sent..]);
        network.receive_bytes(client).map(|bytes| received.extend(bytes)).is_none()
    });
    assert!(closed.unwrap(), "not closed after {sent} of {} bytes", request.len());
    let end = received.windows(4).position(|window| window == b"\r\n\r\n").expect("a head");
    (String::from_utf8(received[..end].to_vec()).unwrap(), received.split_off(end + 4))
}

fn get(machine: &mut Machine, network: &mut Network, path: &str) -> (String, Vec<u8>) {
    ask(machine, network, format!("GET {path} HTTP/1.1\r\nHost: 192.168.7.2\r\n\r\n").as_bytes())
}

/// A request with a body.
fn post(path: &str, head: &str, kind: &str, body: &[u8]) -> Vec<u8> {
    let length = body.len();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: 192.168.7.2\r\n{head}Content-Type: {kind}\r\nContent-Length: {length}\r\n\r\n"
    );
    [head.as_bytes(), body].concat()
}

fn a_browser_gets_the_page_whole(board: Board) {
    let (mut machine, mut network) = serving(board);
    for path in ["/", "/page.js", "/page.css"] {
        let (head, body) = get(&mut machine, &mut network, path);
        assert!(head.starts_with("HTTP/1.1 200"), "{path}: {head}");
        assert!(head.contains("Content-Encoding: gzip"), "{path}: {head}");
        let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")?.parse().ok());
        assert_eq!(length, Some(body.len()), "{path}");
        assert!(body.starts_with(&[0x1f, 0x8b]), "{path}: not gzip (RFC 1952, 2.3.1)");
    }
    let (head, _) = get(&mut machine, &mut network, "/api/v1/status");
    assert!(head.starts_with("HTTP/1.1 401"), "{head}");
}

fn an_update_by_http_runs_on_trial_and_one_that_is_tampered_with_is_refused(board: Board) {
    let (mut machine, mut network) = serving(board);
    let body = br#"{"user":"anna","password":"let me in","token":true}"#;
    let (_, answer) =
        ask(&mut machine, &mut network, &post("/api/v1/session", "", "application/json", body));
    let answer = String::from_utf8(answer).unwrap();
    let token = answer.split_once("\"token\":\"").and_then(|(_, rest)| rest.split_once('"'));
    let bearer = format!("Authorization: Bearer {}\r\n", token.unwrap_or_else(|| panic!("{answer}")).0);
    let mut update = |machine: &mut Machine, file: &[u8]| {
        let request = post("/api/v1/update", &bearer, "application/octet-stream", file);
        let (head, answer) = ask(machine, &mut network, &request);
        (head[9..12].to_owned(), String::from_utf8(answer).unwrap())
    };
    let old = machine.program();
    let new = of_version(&old, 1, 1);
    let mut file = signed(&new);
    let last = file.len() - 1;
    file[last] ^= 1;
    let (status, answer) = update(&mut machine, &file);
    assert_eq!(status, "422", "{answer}");
    assert!(answer.contains("the image's signature is wrong"), "{answer}");
    assert!(machine.program() == old && machine.resets.is_empty());
    file[last] ^= 1;
    let (status, answer) = update(&mut machine, &file);
    assert_eq!((&*status, &*answer), ("200", r#"{"version":"0.1.1"}"#));
    machine.wait_for_prompt(START_MAX).unwrap();
    assert!(machine.program() == new);
    let shown = machine.type_line("show update").unwrap();
    assert!(shown.contains("0.1.1: on trial"), "{shown}");
}
