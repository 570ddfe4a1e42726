//! The web interface: what it does, whom it lets in, and what it withstands.

use std::fs;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::{Duration, Instant};

use serde_json::json;

#[path = "../common/mod.rs"]
mod common;
mod described;
mod http;

use common::{PATIENCE, Program, USER, ask, converse, free_port, wait_for};
use http::Request;

/// A program with a web interface.
struct Web {
    program: Program,
    port: u16,
}

/// The program with `settings`, users of all roles, whose passwords are `let me in`, and the interface.
fn with(settings: &str) -> Web {
    let port = free_port();
    let users = ["viewer", "operator"]
        .map(|role| USER.replace("user anna role engineer", &format!("user {role} role {role}")));
    let text = format!("{settings}{USER}{}mdns off\nport web http server 127.0.0.1:{port}\n", users.concat());
    let program = common::with_console(&text);
    let web = Web { program, port };
    wait_for("the interface", || TcpStream::connect((Ipv4Addr::LOCALHOST, port)).ok());
    web
}

const P502: &str = "port P502 tcp server 127.0.0.1:{port}\nroute P502 1-9 * * local\n";

impl Web {
    fn request(&self, method: &str, path: &str) -> Request {
        Request::new(self.port, method, path)
    }

    fn log_in(&self, user: &str, password: &str) -> Request {
        let body = json!({"user": user, "password": password, "token": true}).to_string();
        self.request("POST", "/api/v1/session").json(&body)
    }

    /// A bearer token of `user`.
    fn token(&self, user: &str) -> String {
        self.log_in(user, "let me in").gets(200).json()["token"].as_str().unwrap().to_owned()
    }
}

#[test]
fn a_user_logs_in_with_a_cookie_that_scripts_of_pages_cannot_read_and_logs_out() {
    let web = with(P502);
    let body = r#"{"user":"anna","password":"let me in"}"#;
    let response = web.request("POST", "/api/v1/session").json(body).gets(200);
    let cookie = response.header("Set-Cookie").unwrap();
    assert!(cookie.contains("; HttpOnly") && cookie.contains("; SameSite=Strict"), "{cookie}");
    assert!(response.json().get("token").is_none(), "{response:?}");
    let cookie = cookie.split(';').next().unwrap();
    let session = |method| web.request(method, "/api/v1/session").header("Cookie", &format!("a=b; {cookie}"));
    assert_eq!(session("GET").gets(200).json(), json!({"user": "anna", "role": "engineer"}));
    // A browser tells the origin of a request that changes something.
    assert!(session("DELETE").gets(403).message().contains("Origin"));
    session("DELETE").header("Origin", "http://evil.example").gets(403);
    session("DELETE").header("Origin", "null").gets(403);
    session("GET").header("Sec-Fetch-Site", "cross-site").gets(403);
    session("DELETE").header("Origin", &format!("http://127.0.0.1:{}", web.port)).gets(204);
    session("GET").gets(401);
    web.program.logs("audit: anna@127.0.0.1: logged in as engineer");
}

#[test]
fn the_page_is_there_for_everybody_and_runs_only_its_own_scripts() {
    let web = with(P502);
    let mut bytes = 0;
    for (path, kind) in [
        ("/", "text/html"),
        ("/page.css", "text/css"),
        ("/page.js", "text/javascript"),
        ("/icon.svg", "image/svg+xml"),
    ] {
        // A link on another site leads here, but a name of another host does not.
        let request = web.request("GET", path).header("Sec-Fetch-Site", "cross-site");
        let file = request.gets(200);
        assert!(file.header("Content-Type").unwrap().starts_with(kind));
        assert_eq!(file.header("Content-Encoding"), Some("gzip"));
        let policy = file.header("Content-Security-Policy").unwrap();
        assert!(
            policy.starts_with("default-src 'self';") && policy.contains("frame-ancestors 'none'"),
            "{policy}"
        );
        assert!(!policy.contains("unsafe"), "{policy}");
        assert_eq!(file.header("X-Content-Type-Options"), Some("nosniff"));
        bytes += file.bytes;
        // A browser that has it gets nothing.
        let tag = file.header("ETag").unwrap();
        assert_eq!(request.clone().header("If-None-Match", tag).gets(304).body, "");
        request.host("evil.example").gets(421);
        assert_eq!(web.request("POST", path).gets(405).header("Allow"), Some("GET"));
    }
    let verdict = if bytes <= 40_000 { "ok" } else { "short" };
    println!("figure page_bytes {bytes} bytes <=40000 {verdict}");
    assert!(bytes <= 40_000, "{bytes}");
}

#[test]
fn without_a_token_with_a_wrong_one_and_with_that_of_a_user_who_has_changed_nobody_gets_in() {
    let web = with(P502);
    let status = || web.request("GET", "/api/v1/status");
    assert_eq!(status().gets(401).header("WWW-Authenticate"), Some("Bearer"));
    status().bearer(&"0".repeat(32)).gets(401);
    status().bearer("x").gets(401);
    let (viewer, operator) = (web.token("viewer"), web.token("operator"));
    status().bearer(&viewer).gets(200);
    // The role is the user's by now.
    let commit = || web.request("POST", "/api/v1/settings/commit").bearer(&operator).json("{}");
    assert!(commit().gets(403).message().contains("needs the role engineer; yours is operator"));
    let mut console = web.program.session();
    let lines = "user operator role engineer\ndelete user viewer\nshow users\n";
    converse(&mut console, lines, "operator        engineer");
    status().bearer(&viewer).gets(401);
    commit().gets(409);
    converse(&mut console, "password operator\nbattery staple\nshow version\n", "mobgate 0.");
    commit().gets(401);
}

#[test]
fn failures_to_log_in_pause_their_address_for_a_while_and_nobody_else() {
    let web = with(P502);
    let token = web.token("viewer");
    for _ in 0..5 {
        assert_eq!(web.log_in("anna", "let me out").gets(401).message(), "no such user, or another password");
    }
    let refused = web.log_in("anna", "let me in").gets(429);
    assert!(refused.message().contains("too many failures"), "{refused:?}");
    assert_eq!(refused.header("Retry-After"), Some("1"));
    // Another user waits, too: the failures are the address's.
    web.log_in("operator", "let me in").gets(429);
    // The same user at another address, and whoever has logged in at this one, are served meanwhile.
    let elsewhere = web.log_in("anna", "let me in").from(Ipv4Addr::new(127, 0, 0, 2)).gets(200);
    let elsewhere = elsewhere.json()["token"].as_str().unwrap().to_owned();
    for token in [&token, &elsewhere] {
        web.request("GET", "/api/v1/status").bearer(token).gets(200);
    }
    // Attempts meanwhile do not prolong the pause, and after it the right password is taken.
    wait_for("the end of the pause", || {
        let response = web.log_in("anna", "let me in").send();
        assert!([200, 429].contains(&response.status), "{response:?}");
        (response.status == 200).then_some(())
    });
    web.program.logs("audit: 127.0.0.1: a wrong password for anna");
}

#[test]
fn roles_are_those_of_the_commands() {
    let web = with(P502);
    let reads = r#"{"port":"P502","unit":1,"table":"holding","address":0}"#;
    for (role, read, change) in [("viewer", 403, 403), ("operator", 409, 403), ("anna", 409, 200)] {
        let token = web.token(role);
        let request = |method, path| web.request(method, path).bearer(&token);
        request("GET", "/api/v1/settings").gets(200);
        request("POST", "/api/v1/read").json(reads).gets(read);
        request("POST", "/api/v1/settings/candidate").lines("").gets(change);
        let image = request("POST", "/api/v1/update").body("application/octet-stream", &[0; 300_000]);
        // On Linux nobody does, and whoever has sent all reads why.
        let refused = image.gets(if role == "anna" { 409 } else { 403 });
        assert_eq!(refused.message().contains("apt install"), role == "anna", "{refused:?}");
    }
    web.program.logs("audit: 127.0.0.1: candidate is denied to the role operator");
}

#[test]
fn a_whole_text_that_is_put_back_keeps_the_passwords_of_publishers() {
    const PUBLISHED: &str = "publish plant mqtt broker 127.0.0.1:1 user gateway";
    let web = with(&format!("{P502}{PUBLISHED} password \"let me in\"\n"));
    let token = web.token("anna");
    let request = |method, path: &str| web.request(method, &format!("/api/v1/settings{path}")).bearer(&token);
    let shown = request("GET", "").gets(200).body;
    assert!(shown.contains(PUBLISHED) && !shown.contains("let me in"), "{shown}");
    let saved = |text: &str| {
        request("PUT", "/candidate").lines(text).gets(200);
        request("POST", "/commit").json("{}").gets(204);
        fs::read_to_string(web.program.config()).unwrap()
    };
    let kept = saved(&format!("{shown}route P502 10 * * local\n"));
    assert!(kept.contains("P502 10") && kept.contains("let me in"), "{kept}");
    // By pieces, of which the first one lacks whoever has a password.
    let has_password = |line: &&str| line.starts_with("user ") || line.starts_with("publish ");
    let (later, first): (Vec<&str>, Vec<&str>) = shown.lines().partition(has_password);
    request("PUT", "/candidate").lines(&first.join("\n")).gets(200);
    request("POST", "/candidate").lines(&later.join("\n")).gets(200);
    request("POST", "/commit").json("{}").gets(204);
    let kept = fs::read_to_string(web.program.config()).unwrap();
    assert_eq!((kept.matches("$argon2id$").count(), kept.contains("let me in")), (3, true), "{kept}");
    // The password was that of another user.
    let another = saved(&shown.replace("user gateway", "user somebody"));
    assert!(another.contains("user somebody") && !another.contains("let me in"), "{another}");
}

#[test]
fn rows_share_chunks_and_none_is_cut() {
    let rules: String =
        (10..60).map(|unit| format!("route P502 {unit} * * local addresses 0-{unit}\n")).collect();
    let web = with(&format!("{P502}{rules}"));
    let token = web.token("anna");
    for path in ["/api/v1/settings", "/api/v1/status", "/metrics"] {
        let response = web.request("GET", path).bearer(&token).gets(200);
        // A chunk has 1024 bytes, and the next row of at most 256 may not fit.
        let most = response.bytes / 768 + 1;
        assert!(response.chunks <= most, "{path}: {} bytes in {} chunks", response.bytes, response.chunks);
    }
    let settings = web.request("GET", "/api/v1/settings").bearer(&token).gets(200).body;
    assert_eq!(settings.matches("local addresses").count(), 50, "{settings}");
}

#[test]
fn lines_become_a_candidate_and_a_commit_puts_it_in_force_and_saves_it() {
    let web = with(P502);
    let token = web.token("anna");
    let request = |method, path: &str| web.request(method, &format!("/api/v1/settings{path}")).bearer(&token);
    let wrong =
        request("POST", "/candidate").lines("route P502 10 * * local\nroute P502 x * * local").gets(422);
    let error = &wrong.json()["error"];
    assert_eq!((&error["line"], &error["column"], &error["word"]), (&json!(2), &json!(12), &json!("x")));
    request("GET", "/candidate").gets(409);
    request("POST", "/candidate").lines("route P502 10 * * local\n# a comment\n").gets(200);
    let diff = request("GET", "/diff").gets(200).json();
    assert_eq!(diff, json!({"lines": ["+ route P502 10      * * local"], "restarts": [], "rules": []}));
    request("POST", "/commit").json(r#"{"confirmed":600}"#).gets(204);
    assert!(!fs::read_to_string(web.program.config()).unwrap().contains("P502 10"), "not saved yet");
    request("POST", "/rollback").gets(204);
    assert!(!request("GET", "").gets(200).body.contains("P502 10"));

    // A whole text, as it was shown: passwords stay.
    let shown = request("GET", "").gets(200).body;
    assert!(!shown.contains("argon2id"), "{shown}");
    request("PUT", "/candidate").lines(&format!("{shown}route P502 10 * * local\n")).gets(200);
    request("POST", "/commit").json("{}").gets(204);
    let saved = fs::read_to_string(web.program.config()).unwrap();
    assert!(saved.contains("P502 10") && saved.contains("argon2id"), "{saved}");
    web.token("operator");
    web.program.logs("audit: anna@127.0.0.1: + route P502 10");
    let versions = converse(&mut web.program.session(), "versions\nshow version\n", "mobgate 0.");
    assert!(versions.contains("anna@127.0.0.1"), "{versions}");
}

#[test]
fn a_commit_that_cuts_off_who_makes_it_must_be_confirmed() {
    let web = with(P502);
    let token = web.token("anna");
    let request = |method, path: &str| web.request(method, &format!("/api/v1/settings{path}")).bearer(&token);
    let port = request("GET", "").gets(200).body;
    let port = port
        .lines()
        .find(|line| line.contains(" http server "))
        .expect("the port of the interface")
        .to_owned();
    for (line, why) in [
        ("user anna role operator".to_owned(), "your role is a lower one"),
        (format!("{port} allow 10.0.0.0/8"), "your address may not use the port any more"),
    ] {
        request("POST", "/candidate").lines(&line).gets(200);
        let refused = request("POST", "/commit").json("{}").gets(409);
        assert!(refused.message().contains(why), "{line}: {refused:?}");
        request("DELETE", "/candidate").gets(204);
    }
    request("POST", "/candidate").lines("user anna role operator").gets(200);
    request("POST", "/commit").json(r#"{"confirmed":600}"#).gets(204);
    request("POST", "/rollback").gets(403);
}

#[test]
fn units_are_asked_and_what_is_wrong_is_told_with_its_place() {
    let own = "port own tcp client 127.0.0.1:{port}\nport poll scanner\npoint set local holding 0 count 4\n";
    let web = with(&format!("{P502}{own}"));
    let token = web.token("anna");
    let post =
        |path: &str, body: &str| web.request("POST", &format!("/api/v1/{path}")).bearer(&token).json(body);
    let place = r#""port":"own","unit":1,"table":"holding","address":0"#;
    let written =
        post("write", &format!("{{{place},\"type\":\"f32\",\"values\":[1.5,-2]}}")).gets(200).json();
    assert!(written["took_us"].is_u64() && written.get("exception").is_none(), "{written}");
    let read = post("read", &format!("{{{place},\"type\":\"f32\",\"count\":2}}")).gets(200).json();
    assert_eq!((&read["values"], &read["address"]), (&json!([1.5, -2]), &json!(0)));
    let read = post("read", &format!("{{{place},\"count\":200}}")).gets(422);
    assert!(read.message().contains("what a frame can hold"), "{read:?}");
    let read = post("read", r#"{"port":"own","unit":1,"table":"input","address":65535}"#).gets(200).json();
    assert_eq!(read["exception"]["code"], json!(2), "{read}");
    let wrong = post("ping", r#"{"port":"nobody","unit":1}"#).gets(422).json();
    assert_eq!(wrong["error"]["word"], json!("nobody"));
    assert_eq!(wrong["error"]["text"], json!("ping 1 via nobody"));
    // A word is one word.
    post("ping", r#"{"port":"own as u16","unit":1}"#).gets(422);
    web.program.logs("audit: anna@127.0.0.1: write 1 holding 0 as f32 1.5 -2 via own");
}

#[test]
fn the_port_is_off_until_a_user_exists_and_says_so() {
    let port = free_port();
    let settings = format!("port P502 tcp server {{port}}\nport web http server 127.0.0.1:{port}\n");
    let program = common::with_console(&settings);
    let mut console = program.session();
    program.logs("cannot be opened: permission denied (until somebody can log in");
    converse(&mut console, "show ports\n", "until somebody can log in: user NAME role engineer");
    assert!(TcpStream::connect((Ipv4Addr::LOCALHOST, port)).is_err());
    converse(
        &mut console,
        "user anna role engineer\npassword anna\nbattery staple\nshow version\n",
        "mobgate 0.",
    );
    wait_for("the interface", || TcpStream::connect((Ipv4Addr::LOCALHOST, port)).ok());
    let warned = converse(&mut console, "delete user anna\nedit port web cleartext\n", "warning");
    assert!(warned.contains("is off until somebody can log in"), "{warned}");
}

#[test]
fn live_values_come_until_the_session_ends() {
    let point =
        "port poll scanner\npoint set local holding 0 count 2\nport own tcp client 127.0.0.1:{port}\n";
    let web = with(&format!("{P502}{point}"));
    let token = web.token("anna");
    let (_, events, mut stream) = web.request("GET", "/api/v1/events").bearer(&token).events(1);
    assert_eq!(events[0]["points"][0]["values"], json!([0, 0]));
    let write = r#"{"port":"own","unit":1,"table":"holding","address":0,"values":[7,8]}"#;
    web.request("POST", "/api/v1/write").bearer(&token).json(write).gets(200);
    let (_, events, _) = web.request("GET", "/api/v1/events").bearer(&token).events(2);
    assert_eq!(events[1]["points"][0]["values"], json!([7, 8]));
    web.request("DELETE", "/api/v1/session").bearer(&token).gets(204);
    let mut rest = Vec::new();
    stream.read_to_end(&mut rest).unwrap();
    assert!(rest.ends_with(b"0\r\n\r\n"), "it ends as it should");
}

#[test]
fn text_and_numbers_of_many_digits_are_strings_and_are_written_as_they_are_typed() {
    let points = "port poll scanner
point name local holding 0 as text 4
point total local holding 10 count 2 as u64
point heat local holding 20 as i16 scale 0.1 offset -40
";
    let web = with(&format!("{P502}{points}"));
    let token = web.token("anna");
    let post = |body: &str| web.request("POST", "/api/v1/point").bearer(&token).json(body).gets(204);
    post(r#"{"point":"name","text":"Pump 7\\x1b"}"#);
    post(r#"{"point":"total","values":[7]}"#);
    post(r#"{"point":"total","at":1,"text":"18446744073709551615"}"#);
    post(r#"{"point":"heat","values":[21.5]}"#);
    let (_, events, _) = web.request("GET", "/api/v1/events").bearer(&token).events(1);
    let values = |nth: usize| events[0]["points"][nth]["values"].clone();
    assert_eq!(values(0), json!(["Pump 7\\x1b"]));
    assert_eq!(values(1), json!([7, "18446744073709551615"]));
    assert_eq!(values(2), json!([21.5]));
}

#[test]
fn other_hosts_and_origins_are_refused() {
    let web = with(P502);
    let token = web.token("anna");
    let status = || web.request("GET", "/api/v1/status").bearer(&token);
    for host in ["evil.example", "", "127.0.0.1.evil.example", "localhost.evil.example:80"] {
        status().host(host).gets(421);
    }
    status().header("Host", "127.0.0.1").gets(421);
    for host in ["localhost", "192.168.7.7:8080", "[::1]"] {
        status().host(host).gets(200);
    }
    for origin in ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1"] {
        status().header("Origin", origin).gets(403);
    }
}

/// An address of this machine that is not a loopback one, if it has one.
fn outer_address() -> Option<Ipv4Addr> {
    let all = nix::ifaddrs::getifaddrs().unwrap();
    let mut all = all.filter_map(|one| Some(one.address?.as_sockaddr_in()?.ip()));
    all.find(|address| !address.is_loopback())
}

#[test]
fn without_encryption_other_machines_get_in_only_where_the_port_says_cleartext() {
    let Some(address) = outer_address() else {
        eprintln!("skipped: this machine has no other address");
        return;
    };
    let web = with(P502);
    let mut console = web.program.session();
    converse(&mut console, &format!("edit port web listen {}\nshow config\n", web.port), "route P502");
    // A connection that waits while the listener moves is reset.
    let from_there = || {
        wait_for("the interface", || {
            let mut stream = TcpStream::connect((address, web.port)).ok()?;
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            let head = format!("GET /api/v1/status HTTP/1.1\r\nHost: {address}:{}\r\n\r\n", web.port);
            stream.write_all(head.as_bytes()).ok()?;
            let mut received = String::new();
            stream.read_to_string(&mut received).ok()?;
            (!received.is_empty()).then_some(received)
        })
    };
    let refused = from_there();
    assert!(refused.starts_with("HTTP/1.1 403") && refused.contains("cleartext"), "{refused}");
    converse(&mut console, "edit port web cleartext\nshow ports\n", "cleartext");
    assert!(from_there().starts_with("HTTP/1.1 401"));
    converse(&mut console, "edit port web allow 127.0.0.0/8\nshow config\n", "allow 127.0.0.0/8");
    let mut refused = wait_for("the interface", || TcpStream::connect((address, web.port)).ok());
    assert_eq!(refused.read(&mut [0]).unwrap_or(0), 0, "not even answered");
}

#[test]
fn metrics_need_a_log_in_until_the_port_says_otherwise_and_the_dashboard_uses_those_that_there_are() {
    let web = with(P502);
    let metrics = || web.request("GET", "/metrics");
    metrics().gets(401);
    metrics().bearer(&web.token("viewer")).gets(200);
    metrics().bearer("x").gets(401);
    converse(&mut web.program.session(), "edit port web metrics\nshow config\n", " metrics");
    let text = wait_for("the metrics", || Some(metrics().send()).filter(|now| now.status == 200)).body;
    assert!(text.contains("mobgate_port_up{port=\"P502\"} 1\n"), "{text}");
    // Nothing else needs no log-in now, and no other page reads them.
    web.request("GET", "/api/v1/status").gets(401);
    metrics().host("evil.example").gets(421);
    metrics().header("Origin", "http://evil.example").gets(403);
    let dashboard = include_str!("../../../../docs/grafana.json");
    let is_name = |char: char| char.is_ascii_lowercase() || char.is_ascii_digit() || char == '_';
    let used =
        dashboard.match_indices("mobgate_").map(|(at, _)| dashboard[at..].split(|char| !is_name(char)));
    let used: std::collections::BTreeSet<_> = used.filter_map(|mut words| words.next()).collect();
    assert!(used.len() > 5, "{used:?}");
    for name in used {
        assert!(text.contains(&format!("# TYPE {name} ")), "{name} is no metric");
    }
    // Its events are those of the counters.
    let known = |event: &str| text.contains(&format!("event=\"{event}\""));
    let events =
        "requests responses queue-full refused no-path expired unit-down unwelcome crowded line-lost";
    for event in events.split(' ') {
        assert!(dashboard.contains(event) && known(event), "{event}");
    }
}

#[test]
fn large_bodies_and_endless_heads_are_refused_and_slow_ones_are_cut() {
    let web = with(P502);
    let token = web.token("anna");
    let body = vec![b'#'; 10_000_000];
    let put = web.request("PUT", "/api/v1/settings/candidate").bearer(&token);
    assert!(put.body("text/plain", &body).gets(413).message().contains("too large"));
    // Of heads, what does not fit is not read.
    let mut endless = TcpStream::connect((Ipv4Addr::LOCALHOST, web.port)).unwrap();
    endless.set_read_timeout(Some(PATIENCE)).unwrap();
    let _ = endless.write_all(&[b"GET / HTTP/1.1\r\nX: ".to_vec(), vec![b'x'; 100_000]].concat());
    let mut received = Vec::new();
    let _ = endless.read_to_end(&mut received);
    assert!(received.starts_with(b"HTTP/1.1 400") || received.is_empty(), "{received:?}");
    // Slow heads, and none at all, as many as there are connections: then somebody gets in.
    let slow: Vec<_> = (0..8)
        .map(|nth| {
            let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, web.port)).unwrap();
            if nth % 2 == 0 {
                stream.write_all(b"GET /api/v1/status HTTP/1.1\r\nHost: ").unwrap();
            }
            stream
        })
        .collect();
    let begin = Instant::now();
    web.request("GET", "/api/v1/status").bearer(&token).gets(200);
    for mut stream in slow {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        assert_eq!(stream.read(&mut [0]).unwrap_or(0), 0, "it is closed");
    }
    assert!(begin.elapsed() < PATIENCE);
}

#[test]
fn a_thousand_connections_do_not_disturb_modbus() {
    let web = with(P502);
    let token = web.token("anna");
    let mut client = web.program.connect();
    let mut connections = Vec::new();
    let address = (Ipv4Addr::LOCALHOST, web.port).into();
    for nth in 0..1_000 {
        // Some wait for the listener in vain.
        let opened = TcpStream::connect_timeout(&address, Duration::from_millis(10));
        assert_eq!(ask(&mut client, 1, &[17])[0], 17, "it answers meanwhile");
        let Ok(mut stream) = opened else { continue };
        // Some wait, some ask without a token, some send noise.
        let _ = match nth % 3 {
            0 => Ok(()),
            1 => stream.write_all(b"GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n"),
            _ => stream.write_all(&[0xff; 512]),
        };
        connections.push(stream);
    }
    // A bounded number of them is served at a time.
    assert!(web.program.descriptors() < 150, "{}", web.program.descriptors());
    drop(connections);
    wait_for("a free connection", || {
        let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, web.port)).ok()?;
        let head = format!(
            "GET /api/v1/status HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut received = String::new();
        stream.read_to_string(&mut received).ok()?;
        received.starts_with("HTTP/1.1 200").then_some(())
    });
}
