//! The web interface of the board: what it does, whom it lets in, and what it withstands. The Linux program's tests have each call.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};

use mobgate_qemu::{Bus, Console, Image, Machine, Options, PATIENCE, wait_for};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use serde_json::{Value, json};

use crate::http::Request;
use crate::registers;
use crate::ssh::PASSWORD;

/// Connections that are open at a time. QEMU has a descriptor for each of them, as this process has.
const CONNECTIONS: usize = 1_000;
const DESCRIPTORS: u64 = 2 * CONNECTIONS as u64;
/// Connections that the board serves at a time.
const SERVED: usize = 8;
const STATUS: &str = "/api/v1/status";
const CANDIDATE: &str = "/api/v1/settings/candidate";
const COMMIT: &str = "/api/v1/settings/commit";
const VERSIONS: &str = "/api/v1/settings/versions";

struct Bench {
    // Ended before its folder goes.
    machine: Machine,
    bus: Bus,
    folder: tempfile::TempDir,
}

fn start(folder: &tempfile::TempDir, words: &str) -> Machine {
    let options = Options { image: Image::Web, words: words.to_owned(), ..Options::default() };
    Machine::start(folder.path(), options)
}

impl Bench {
    /// With the engineer `anna` and the viewer `vera`, whose passwords are `let me in`.
    fn new(words: &str) -> Self {
        let bench = Self::bare(words);
        let mut console = bench.machine.console();
        for line in [
            &format!("user anna role engineer password \"{PASSWORD}\""),
            &format!("user vera role viewer password \"{PASSWORD}\""),
            "port web http server 80 cleartext",
        ] {
            assert_eq!(console.run(line), "", "{line}");
        }
        assert_eq!(console.run("save").trim_end(), "saved");
        bench.machine.logs("listening on TCP port 80");
        bench
    }

    fn bare(words: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (machine, bus) = (start(&folder, words), Bus::new([1, 2, 3]));
        machine.wire(1, &bus);
        Self { machine, bus, folder }
    }

    /// Switches the board off and on again.
    fn restart(&mut self) {
        self.machine.kill();
        self.machine = start(&self.folder, "");
        self.machine.wire(1, &self.bus);
        self.is_up();
    }

    /// Waits for the interface.
    fn is_up(&self) {
        wait_for("the interface", || {
            let mut stream = connect(self);
            stream.write_all(b"GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n").ok()?;
            let mut received = String::new();
            stream.read_to_string(&mut received).ok()?;
            received.starts_with("HTTP/1.1 401").then_some(())
        });
    }

    fn request(&self, method: &str, path: &str) -> Request {
        Request::new(self.machine.web_port(), method, path)
    }

    fn log_in(&self, user: &str, password: &str) -> Request {
        let body = json!({"user": user, "password": password, "token": true}).to_string();
        self.request("POST", "/api/v1/session").json(&body)
    }

    fn token(&self, user: &str) -> String {
        self.log_in(user, "let me in").gets(200).json()["token"].as_str().unwrap().to_owned()
    }

    /// Puts a line in force, for some seconds or for good.
    fn commit(&self, token: &str, line: &str, terms: Value) {
        self.request("POST", CANDIDATE).bearer(token).lines(line).gets(200);
        self.request("POST", COMMIT).bearer(token).json(&terms.to_string()).gets(204);
    }

    fn settings(&self, token: &str) -> String {
        self.request("GET", "/api/v1/settings").bearer(token).gets(200).body
    }
}

#[test]
fn it_is_off_until_somebody_can_log_in_and_others_than_the_board_need_cleartext() {
    let bench = Bench::bare("");
    let mut console = bench.machine.console();
    let warned = console.run("port web http server 80");
    assert!(warned.contains("port web is off until somebody can log in"), "{warned}");
    bench.machine.logs("until somebody can log in");
    // QEMU accepts for the board, which refuses.
    let mut refused = TcpStream::connect((Ipv4Addr::LOCALHOST, bench.machine.web_port())).unwrap();
    refused.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(refused.read(&mut [0]).unwrap_or(0), 0);
    assert_eq!(console.run(&format!("user anna role engineer password \"{PASSWORD}\"")), "");
    bench.machine.logs("listening on TCP port 80");
    let refused = bench.request("GET", STATUS).gets(403);
    assert!(refused.message().contains("cleartext"), "{refused:?}");
    assert_eq!(console.run("edit port web cleartext"), "");
    bench.request("GET", STATUS).gets(401);
    bench.log_in("anna", "let me out").gets(401);
    bench.token("anna");
}

#[test]
fn the_board_is_watched_and_set_and_what_was_committed_outlives_the_power() {
    let mut bench = Bench::new("");
    assert_eq!(bench.machine.client().read(2, 0, 1), registers(2, 0, 1));
    let token = bench.token("anna");
    let status = bench.request("GET", STATUS).bearer(&token).gets(200).json();
    let of_unit = |unit: &&Value| unit["unit"] == json!(2);
    let unit = status["units"].as_array().unwrap().iter().find(of_unit).expect("unit 2").clone();
    assert_eq!((&unit["port"], &unit["requests"]), (&json!("P1"), &json!(1)), "{status}");
    let place = json!({"port": "P1", "unit": 3, "table": "holding", "address": 5}).to_string();
    let read = bench.request("POST", "/api/v1/read").bearer(&token).json(&place).gets(200).json();
    assert_eq!(read["values"], json!([3 * 256 + 5]));
    let (_, events, _) = bench.request("GET", "/api/v1/events").bearer(&token).events(2);
    assert!(events[1]["units"].as_array().is_some_and(|units| !units.is_empty()), "{events:?}");
    let wrong = bench.request("POST", CANDIDATE).bearer(&token).lines("route P502 x * * P1").gets(422).json();
    assert_eq!(wrong["error"]["word"], json!("x"));
    bench.request("POST", CANDIDATE).bearer(&token).lines("route P502 248 * =3 P1").gets(200);
    let diff = bench.request("GET", "/api/v1/settings/diff").bearer(&token).gets(200).json();
    let line = diff["lines"][0].as_str().unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!((line.as_str(), &diff["restarts"]), ("+ route P502 248 * =3 P1", &json!([])));
    bench.request("POST", COMMIT).bearer(&token).json("{}").gets(204);
    let trail = bench.machine.console().run("show audit");
    assert!(trail.contains("anna@10.0.2.2") && trail.contains("commit"), "{trail}");
    bench.restart();
    bench.request("GET", STATUS).bearer(&token).gets(401);
    assert!(bench.settings(&bench.token("vera")).contains("248"));
    assert_eq!(bench.machine.client().read(248, 5, 1), registers(3, 5, 1));
    let token = bench.token("anna");
    let saved = bench.request("GET", VERSIONS).bearer(&token).gets(200).json();
    let who = |nth: usize| saved["versions"][nth]["who"].clone();
    assert_eq!([0, 1, 2].map(who), [json!("anna@10.0.2.2"), json!("local console"), Value::Null], "{saved}");
    bench.request("POST", VERSIONS).bearer(&token).json("{\"version\":2}").gets(409);
    bench.request("POST", VERSIONS).bearer(&token).json("{\"version\":1}").gets(204);
    bench.request("POST", COMMIT).bearer(&token).json("{}").gets(204);
    assert!(!bench.settings(&token).contains("248"), "the settings from before");
}

#[test]
fn a_commit_that_nobody_confirms_goes_back_in_time_and_with_a_reset_and_with_the_power() {
    let mut bench = Bench::new("restart");
    let line = "route P502 248 * =3 P1";
    let commit = |bench: &Bench, seconds: u32| {
        let token = bench.token("anna");
        bench.commit(&token, line, json!({"confirmed": seconds}));
        assert!(bench.settings(&token).contains("248"), "it is in force");
        token
    };
    let token = commit(&bench, 10);
    wait_for("the settings from before", || (!bench.settings(&token).contains("248")).then_some(()));
    bench.machine.logs("nobody has confirmed the commit");

    commit(&bench, 600);
    let mut console = bench.machine.console();
    console.type_keys("reboot\r");
    bench.machine.logs_times("network up", 2);
    bench.is_up();
    assert!(!bench.settings(&bench.token("anna")).contains("248"), "the reset took it back");
    drop(console);

    commit(&bench, 600);
    bench.restart();
    assert!(!bench.settings(&bench.token("anna")).contains("248"), "so did the power");

    let token = commit(&bench, 600);
    bench.request("POST", "/api/v1/settings/confirm").bearer(&token).gets(204);
    bench.restart();
    assert!(bench.settings(&bench.token("anna")).contains("248"), "it was confirmed");
}

#[test]
fn other_hosts_and_origins_and_tokens_that_are_not_valid_are_refused() {
    let bench = Bench::new("");
    let token = bench.token("anna");
    let status = || bench.request("GET", STATUS);
    for host in ["evil.example", "", "10.0.2.15.evil.example"] {
        status().bearer(&token).host(host).gets(421);
    }
    for origin in ["http://evil.example", "null"] {
        status().bearer(&token).header("Origin", origin).gets(403);
    }
    status().gets(401);
    status().bearer(&"0".repeat(32)).gets(401);
    let viewer = bench.token("vera");
    bench.request("POST", CANDIDATE).bearer(&viewer).lines("").gets(403);
    let mut console: Console = bench.machine.console();
    assert_eq!(console.run("delete user vera"), "");
    status().bearer(&viewer).gets(401);
    bench.request("DELETE", "/api/v1/session").bearer(&token).gets(204);
    status().bearer(&token).gets(401);
    for path in ["/", "/page.js"] {
        bench.request("GET", path).host("evil.example").gets(421);
        let page = bench.request("GET", path).gets(200);
        assert_eq!(page.header("Content-Encoding"), Some("gzip"));
    }
}

#[test]
fn large_bodies_and_endless_heads_are_refused_and_slow_ones_are_cut() {
    let bench = Bench::new("");
    let token = bench.token("anna");
    let free = bench.machine.figures().sockets_free();
    let put = bench.request("PUT", CANDIDATE).bearer(&token);
    let refused = put.clone().body("text/plain", &[b'#'; 4_000]).gets(413);
    assert!(refused.message().contains("too large"), "{refused:?}");
    // Of far more the board does not read the rest: its response may be lost with that.
    let mut huge = put.header("Content-Type", "text/plain").header("Content-Length", "10000000").open();
    let _ = huge.write_all(&vec![b'#'; 10_000_000]);
    let mut received = Vec::new();
    let _ = huge.read_to_end(&mut received);
    assert!(received.starts_with(b"HTTP/1.1 413") || received.is_empty(), "{received:?}");
    let mut endless = connect(&bench);
    let _ = endless.write_all(&[b"GET / HTTP/1.1\r\nX: ".to_vec(), vec![b'x'; 100_000]].concat());
    let mut received = Vec::new();
    let _ = endless.read_to_end(&mut received);
    assert!(received.starts_with(b"HTTP/1.1 400") || received.is_empty(), "{received:?}");
    // As many as are served at a time: somebody else gets in when they are cut.
    let slow: Vec<_> = (0..SERVED)
        .map(|nth| {
            let mut stream = connect(&bench);
            if nth % 2 == 0 {
                stream.write_all(b"GET /api/v1/status HTTP/1.1\r\nHost: ").unwrap();
            }
            stream
        })
        .collect();
    wait_for("a free connection", || {
        let mut received = Vec::new();
        let _ = bench.request("GET", STATUS).bearer(&token).open().read_to_end(&mut received);
        received.starts_with(b"HTTP/1.1 200").then_some(())
    });
    for mut stream in slow {
        assert_eq!(stream.read(&mut [0]).unwrap_or(0), 0, "it is closed");
    }
    all_sockets_are_free(&bench, free);
}

#[test]
fn new_firmware_is_refused_with_the_reason_and_nothing_is_on_trial() {
    let bench = Bench::new("");
    let (anna, vera) = (bench.token("anna"), bench.token("vera"));
    let image = |token| {
        let request = bench.request("POST", "/api/v1/update").bearer(token);
        request.body("application/octet-stream", &[0; 300_000])
    };
    image(&vera).gets(403);
    // Whoever has sent all reads why.
    let refused = image(&anna).gets(409);
    assert!(refused.message().contains("QEMU starts the image that it is given"), "{refused:?}");
    bench.request("DELETE", "/api/v1/update").bearer(&anna).gets(409);
    bench.request("GET", "/api/v1/update").bearer(&anna).gets(200);
}

fn connect(bench: &Bench) -> TcpStream {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, bench.machine.web_port())).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

fn all_sockets_are_free(bench: &Bench, free: u32) {
    let mut figures = bench.machine.figures();
    wait_for("the sockets", || (figures.sockets_free() == free).then_some(()));
}

#[test]
fn many_connections_do_not_disturb_modbus_and_give_their_sockets_back() {
    // Before QEMU is started, which inherits it. By default a process may have 1024.
    let (_, most) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
    setrlimit(Resource::RLIMIT_NOFILE, most.min(DESCRIPTORS), most).unwrap();
    let bench = Bench::new("");
    let token = bench.token("anna");
    let mut client = bench.machine.client();
    assert_eq!(client.read(1, 0, 1), registers(1, 0, 1));
    let free = bench.machine.figures().sockets_free();
    let mut connections = Vec::new();
    for nth in 0..CONNECTIONS {
        let mut stream = connect(&bench);
        // Some wait, some ask without a token, some send noise.
        let _ = match nth % 3 {
            0 => Ok(()),
            1 => stream.write_all(b"GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n"),
            _ => stream.write_all(&[0xff; 512]),
        };
        connections.push(stream);
        let (unit, address) = ([1, 2, 3][nth % 3], (nth % 100) as u8);
        assert_eq!(client.read(unit, address.into(), 2), registers(unit, address, 2), "it answers meanwhile");
    }
    drop(connections);
    wait_for("a free connection", || {
        let mut stream = connect(&bench);
        let head =
            format!("GET {STATUS} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n");
        stream.write_all(head.as_bytes()).ok()?;
        let mut received = String::new();
        stream.read_to_string(&mut received).ok()?;
        received.starts_with("HTTP/1.1 200").then_some(())
    });
    all_sockets_are_free(&bench, free);
    println!("the stack has held {} bytes", bench.machine.figures().stack_bytes());
}
