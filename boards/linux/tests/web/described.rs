//! docs/openapi.yaml against the program: each path, method, status and field that it describes, and none besides.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;

use serde_json::{Value, json};
use serial2::SerialPort;

use crate::common::{self, Program};
use crate::http::{Request, Response};
use crate::{Web, with};

/// What only boards with updates do; tests/gateway/web_update.rs has it.
const OF_BOARDS: [(&str, u16); 4] = [("POST", 200), ("POST", 400), ("POST", 422), ("DELETE", 204)];
const UPDATE: &str = "/api/v1/update";
/// An image that no board has memory for.
const TOO_LONG: usize = 4 * 1_024 * 1_024 + 1;

struct Description(Value);

/// A path, a method, and a status.
type Said = (String, String, u16);

impl Description {
    fn read() -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/openapi.yaml");
        Self(yaml_serde::from_str(&std::fs::read_to_string(file).unwrap()).unwrap())
    }

    /// What `value` refers to, or itself.
    fn resolved<'v>(&'v self, value: &'v Value) -> &'v Value {
        match value["$ref"].as_str() {
            Some(at) => self.0.pointer(at.trim_start_matches('#')).unwrap_or_else(|| panic!("{at}")),
            None => value,
        }
    }

    /// All that it describes.
    fn said(&self) -> BTreeSet<Said> {
        let mut said = BTreeSet::new();
        for (path, methods) in self.0["paths"].as_object().unwrap() {
            for (method, operation) in methods.as_object().unwrap() {
                let statuses = operation["responses"].as_object().unwrap().keys();
                said.extend(
                    statuses.map(|status| (path.clone(), method.to_uppercase(), status.parse().unwrap())),
                );
            }
        }
        said
    }

    fn operation(&self, path: &str, method: &str) -> &Value {
        &self.0["paths"][path][method.to_lowercase()]
    }

    /// The type of the operation's body, if it has one.
    fn body(&self, path: &str, method: &str) -> Option<String> {
        let body = self.operation(path, method).get("requestBody")?;
        self.resolved(body)["content"].as_object().unwrap().keys().next().cloned()
    }

    /// Holds a response against what is described for it.
    fn check(&self, path: &str, method: &str, response: &Response) {
        let described = &self.operation(path, method)["responses"][response.status.to_string()];
        let described = self.resolved(described);
        assert!(described["description"].is_string(), "{method} {path}: {response:?}");
        let Some(content) = described["content"].as_object() else {
            assert_eq!(response.body, "", "{method} {path}");
            return;
        };
        let kind = response.header("Content-Type").unwrap().split(';').next().unwrap();
        if kind == "application/json" {
            self.conforms(&response.json(), &content[kind]["schema"], &format!("{method} {path}"));
        } else {
            assert!(content.contains_key(kind), "{method} {path}: {kind}");
        }
    }

    /// Holds a value against its schema.
    fn conforms(&self, value: &Value, schema: &Value, place: &str) {
        let schema = self.resolved(schema);
        let kinds: Vec<&str> = match &schema["type"] {
            Value::Array(kinds) => kinds.iter().map(|kind| kind.as_str().unwrap()).collect(),
            kind => vec![kind.as_str().unwrap()],
        };
        let is_a = |kind: &&str| match *kind {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_u64() || value.is_i64(),
            "number" => value.is_number(),
            "null" => value.is_null(),
            other => panic!("{other}"),
        };
        assert!(kinds.iter().any(is_a), "{place}: {value} is no {kinds:?}");
        if let Some(known) = schema["enum"].as_array() {
            assert!(known.contains(value), "{place}: {value} is none of {known:?}");
        }
        for (nth, item) in value.as_array().into_iter().flatten().enumerate() {
            self.conforms(item, &schema["items"], &format!("{place}[{nth}]"));
        }
        let Some(object) = value.as_object() else { return };
        for field in schema["required"].as_array().into_iter().flatten() {
            assert!(object.contains_key(field.as_str().unwrap()), "{place}: {value} has no {field}");
        }
        for (field, value) in object {
            let others = schema.get("additionalProperties").filter(|others| **others != json!(false));
            // What is described elsewhere.
            if others == Some(&json!(true)) {
                continue;
            }
            let schema = schema["properties"].get(field).or(others);
            let schema = schema.unwrap_or_else(|| panic!("{place}: {field} is not described"));
            self.conforms(value, schema, &format!("{place}.{field}"));
        }
    }
}

/// Calls, and notes what was seen.
struct Caller {
    described: Description,
    web: Web,
    token: String,
    seen: BTreeSet<Said>,
}

impl Caller {
    fn note(&mut self, path: &str, method: &str, response: Response) -> Response {
        self.described.check(path, method, &response);
        self.seen.insert((path.to_owned(), method.to_owned(), response.status));
        response
    }

    /// With the token, and a body of the operation's type.
    fn request(&self, path: &str, method: &str, body: &str) -> Request {
        let request = self.web.request(method, path).bearer(&self.token);
        match self.described.body(path, method) {
            Some(kind) => request.body(&kind, body.as_bytes()),
            None => request,
        }
    }

    fn call(&mut self, path: &str, method: &str, body: &str, status: u16) -> Response {
        let path = &format!("/api/v1/{path}");
        let response = self.request(path, method, body).gets(status);
        self.note(path, method, response)
    }

    /// Frames come as they are on the wire, also while all events are taken.
    fn frames(&mut self) {
        let path = "/api/v1/frames";
        let mut client = self.web.program.connect();
        let [mut one, _other] = [(); 2].map(|()| {
            let mut stream = self.request(path, "GET", "").open();
            let head = read_until(&mut stream, b"\r\n\r\n", || {});
            assert!(head.starts_with(b"HTTP/1.1 200") && contains(&head, b"application/x-pcapng"));
            stream
        });
        read_until(&mut one, b"mbtcp", || {
            common::ask(&mut client, 1, &[3, 0, 0, 0, 1]);
        });
        let third = self.call("frames", "GET", "", 409).body;
        assert!(third.contains("two others get frames"), "{third}");
        self.seen.insert((path.to_owned(), "GET".to_owned(), 200));
    }

    /// The events are as the status is; a fifth connection for them is refused.
    fn events(&mut self) {
        let path = "/api/v1/events";
        let held: Vec<_> = (0..4).map(|_| self.request(path, "GET", "").events(1)).collect();
        for (head, events, _) in &held {
            assert!(
                head.starts_with("HTTP/1.1 200") && head.contains("Content-Type: text/event-stream"),
                "{head}"
            );
            self.described.conforms(&events[0], &json!({"$ref": "#/components/schemas/Status"}), path);
        }
        self.seen.insert((path.to_owned(), "GET".to_owned(), 200));
        let fifth = self.call("events", "GET", "", 409).body;
        assert!(fifth.contains("four pages have live values"), "{fifth}");
        self.frames();
        drop(held);
    }

    /// Provokes the refusals that are alike for all operations.
    fn refusals(&mut self, path: &str, method: &str) {
        let Web { port, .. } = self.web;
        let plain = Request::new(port, method, path);
        let (body, log_in) =
            (self.described.body(path, method), path.ends_with("session") && method == "POST");
        let mut all = vec![
            (self.request(path, method, "").host("evil.example"), 421),
            (self.request(path, method, "").header("Origin", "http://evil.example"), 403),
        ];
        match &body {
            Some(_) if path == UPDATE => {
                all.push((self.request(path, method, "").header("Transfer-Encoding", "chunked"), 411));
                all.push((self.request(path, method, &"x".repeat(TOO_LONG)), 413));
                all.push((plain.clone().bearer(&self.token).body("text/html", b"x"), 415));
            }
            Some(kind) => {
                all.push((plain.clone().bearer(&self.token).body(kind, b"{\xff"), 400));
                all.push((self.request(path, method, "").header("Transfer-Encoding", "chunked"), 411));
                all.push((self.request(path, method, &"x".repeat(100_000)), 413));
                all.push((plain.clone().bearer(&self.token).body("text/html", b"x"), 415));
            }
            None => all.push((plain.clone().bearer(&self.token).lines("x"), 400)),
        }
        if !log_in {
            all.push((plain.clone(), 401));
        }
        for (request, status) in all {
            let response = request.gets(status);
            self.note(path, method, response);
        }
        if let Some(kind) = body.filter(|kind| kind == "application/json") {
            let response = plain.bearer(&self.token).body(&kind, b"{\"surprise\":1}").gets(400);
            self.note(path, method, response);
        }
    }
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|found| found == part)
}

/// Reads until `part` has come; before each piece there is something to do.
fn read_until(stream: &mut TcpStream, part: &[u8], mut before: impl FnMut()) -> Vec<u8> {
    let mut received = Vec::new();
    while !contains(&received, part) {
        before();
        let mut piece = [0; 4_096];
        let count = stream.read(&mut piece).unwrap();
        assert!(count > 0, "it ended: {}", String::from_utf8_lossy(&received));
        received.extend_from_slice(&piece[..count]);
    }
    received
}

/// A scan goes on while it is read, others wait meanwhile, and it can be stopped.
fn long_work(caller: &mut Caller) {
    let tune = caller.call("tune", "POST", r#"{"port":"bare"}"#, 200).body;
    assert!(tune.contains("no unit has answered at this port yet"), "{tune}");
    let scan = |caller: &mut Caller, units, status| {
        let body = format!(r#"{{"port":"bare","bauds":[9600],"units":"{units}"}}"#);
        caller.call("scan", "POST", &body, status).body
    };
    assert!(scan(caller, "1-2", 200).contains("0 units found"));
    let body = r#"{"port":"bare","units":"1-247"}"#;
    let length = body.len().to_string();
    let request = caller.request("/api/v1/scan", "POST", "").header("Content-Length", &length);
    let mut stream = request.open();
    stream.write_all(body.as_bytes()).unwrap();
    read_until(&mut stream, b"9600 8E1", || {});
    scan(caller, "1-2", 409);
    caller.call("tune", "POST", r#"{"port":"bare"}"#, 409);
    for path in ["scan", "tune"] {
        caller.call(path, "POST", r#"{"port":"nobody"}"#, 422);
    }
    caller.call("stop", "POST", "", 204);
    let mut rest = Vec::new();
    stream.read_to_end(&mut rest).unwrap();
    assert!(contains(&rest, b"0 units found"), "{}", String::from_utf8_lossy(&rest));
}

/// Settings by JSON are the lines, and become the candidate.
fn settings_as_json(caller: &mut Caller) {
    let schema = caller.call("settings/schema", "GET", "", 200).json();
    assert!(schema["properties"]["port"]["items"]["anyOf"].is_array(), "{schema}");
    let lines = caller.call("settings", "GET", "", 200).body;
    let whole = caller.call("settings/json", "GET", "", 200);
    let port = json!({"name": "bare", "kind": "serial", "framing": "rtu", "side": "client", "baud": 9600, "format": "8N1"});
    let known = whole.json()["port"]
        .as_array()
        .unwrap()
        .iter()
        .find(|known| known["name"] == "bare")
        .cloned()
        .unwrap();
    for (name, value) in port.as_object().unwrap() {
        assert_eq!(known[name], *value, "{name}");
    }
    let path = "settings/candidate/json";
    caller.call(path, "GET", "", 409);
    caller.call(path, "PUT", &whole.body, 200);
    assert_eq!(caller.call("settings/candidate", "GET", "", 200).body, lines);
    // It never matches, as the one above takes its requests.
    let rule =
        json!({"route": [{"source": "P502", "units": "3", "from": "*", "tag": "*", "destination": "own"}]});
    caller.call(path, "POST", &rule.to_string(), 200);
    let diff = caller.call("settings/diff", "GET", "", 200).json();
    let message = diff["rules"][0]["message"].as_str().unwrap();
    assert!(diff["rules"][0]["rule"] == json!(3) && message.contains("never"), "{diff}");
    let candidate = caller.call(path, "GET", "", 200).json();
    assert_eq!(candidate["route"][2], rule["route"][0]);
    for method in ["PUT", "POST"] {
        caller.call(path, method, r#"{"port":[{"name":"x","kind":"tcp server","listen":"none"}]}"#, 422);
        caller.call(path, method, r#"{"surprise":[]}"#, 400);
    }
    caller.call("settings/commit", "POST", r#"{"confirmed":60}"#, 204);
    caller.call(path, "POST", "{}", 409);
    caller.call(path, "PUT", "{}", 409);
    caller.call("settings/rollback", "POST", "", 204);
}

/// The calls that run commands of the console.
fn commands(caller: &mut Caller) {
    for path in ["network", "lines", "update", "ethercat"] {
        caller.call(path, "GET", "", 200);
    }
    let refused = caller.call("update", "POST", "image", 409).body;
    assert!(refused.contains("the package manager brings new versions"), "{refused}");
    caller.call("update", "DELETE", "", 409);
    for path in ["log", "audit", "users", "units"] {
        let rows = caller.call(path, "GET", "", 200).json();
        assert!(!rows[path].as_array().unwrap().is_empty(), "{path} of {rows}");
    }
    for kind in ["text/plain", "application/openmetrics-text"] {
        let metrics = caller.request("/metrics", "GET", "").header("Accept", kind).gets(200);
        assert!(metrics.body.contains("mobgate_port_events_total{port=\"P502\",event=\"requests\"}"));
        caller.note("/metrics", "GET", metrics);
    }
    let explain = r#"{"port":"P502","unit":5,"function":3,"address":9,"count":2,"from":"127.0.0.1"}"#;
    let explained = caller.call("explain", "POST", explain, 200).json();
    let expected = json!({"outcome": "local", "rule": 1, "text": "rule 1: to the gateway's own unit"});
    assert_eq!(explained, expected);
    caller.call("explain", "POST", &explain.replace("P502", "nobody"), 422);
    caller.call("point", "POST", r#"{"point":"lamps","values":[1,0,1]}"#, 204);
    caller.call("point", "POST", r#"{"point":"nobody","values":[1]}"#, 422);
    caller.call("point", "POST", r#"{"point":"lamps","text":"1"}"#, 204);
    caller.call("point", "POST", r#"{"point":"lamps","values":[1],"text":"1"}"#, 422);
    caller.call("point", "POST", r#"{"point":"lamps"}"#, 422);
    // There is nothing to write at an input register.
    caller.call("point", "POST", r#"{"point":"level","values":[1]}"#, 409);
    long_work(caller);
    let saved = caller.call("settings/versions", "GET", "", 200).json();
    assert!(saved["versions"][0]["who"].as_str().unwrap().contains("anna"), "{saved}");
    caller.call("settings/versions", "POST", r#"{"version":99}"#, 409);
    caller.call("settings/versions", "POST", r#"{"version":0}"#, 204);
    caller.call("settings/candidate", "DELETE", "", 204);
    caller.call("password", "POST", r#"{"user":"viewer","password":"battery staple"}"#, 204);
    caller.call("password", "POST", r#"{"user":"viewer","password":"short"}"#, 422);
}

const SETTINGS: &str = "port P502 tcp server 127.0.0.1:{port}
port own tcp client 127.0.0.1:{port}
port bare serial {device} rtu client 9600 8N1
port many tcp client
server many unit 1-5 at 127.0.0.1:{port}
port poll scanner
device meter unit 1
point level meter input 0 count 2 as f32 read high label \"Level\"
point lamps local coil 0 count 12
route P502 1-9 * * local
route poll 1 * * own
";

/// A candidate is drafted, committed, taken back, and refused where there is none or another one waits.
fn candidates(caller: &mut Caller) {
    let candidate = "settings/candidate";
    for (path, method) in [(candidate, "GET"), (candidate, "DELETE"), ("settings/diff", "GET")] {
        caller.call(path, method, "", 409);
    }
    settings_as_json(caller);
    caller.call("settings/commit", "POST", "{}", 409);
    caller.call("settings/confirm", "POST", "", 409);
    caller.call("settings/rollback", "POST", "", 409);
    caller.call(candidate, "POST", "foo", 422);
    caller.call(candidate, "PUT", "foo", 422);
    caller.call(candidate, "POST", "route P502 1-3 * * own", 200);
    let whole = caller.call(candidate, "GET", "", 200).body;
    caller.call("settings/diff", "GET", "", 200);
    caller.call("settings/commit", "POST", r#"{"confirmed":1}"#, 422);
    caller.call("settings/commit", "POST", r#"{"check":true}"#, 204);
    caller.call(candidate, "DELETE", "", 204);
    caller.call(candidate, "PUT", &whole, 200);
    caller.call("settings/commit", "POST", r#"{"confirmed":60}"#, 204);
    caller.call(candidate, "POST", "", 409);
    caller.call(candidate, "PUT", "", 409);
    let status = caller.call("status", "GET", "", 200).json();
    assert_eq!(status["candidate"], json!("waiting"));
    // It would save what is not confirmed.
    caller.call("password", "POST", r#"{"user":"viewer","password":"battery staple"}"#, 409);
    caller.call("settings/rollback", "POST", "", 204);
    caller.call(candidate, "PUT", &whole, 200);
    caller.call("settings/commit", "POST", r#"{"confirmed":60}"#, 204);
    caller.call("settings/confirm", "POST", "", 204);
}

/// Units are asked through a client-side port.
fn requests(caller: &mut Caller) {
    for (path, body) in [
        ("read", table_of_own("coil", ",\"count\":12")),
        ("write", table_of_own("coil", ",\"values\":[1,0,1]")),
        ("ping", r#"{"port":"own","unit":1}"#.to_owned()),
    ] {
        caller.call(path, "POST", &body, 200);
        caller.call(path, "POST", &body.replace("own", "nobody"), 422);
        // A server is not asked.
        caller.call(path, "POST", &body.replace("own", "P502"), 409);
    }
}

/// A request for a table of the unit behind the port `own`.
fn table_of_own(table: &str, more: &str) -> String {
    format!(r#"{{"port":"own","unit":1,"table":"{table}","address":0{more}}}"#)
}

/// Five wrong passwords lock the user out, with the right one, too.
fn log_ins(caller: &mut Caller) {
    caller.call("session", "POST", r#"{"user":"anna","password":"let me in"}"#, 200);
    for _ in 0..5 {
        caller.call("session", "POST", r#"{"user":"anna","password":"let me out"}"#, 401);
    }
    caller.call("session", "POST", r#"{"user":"anna","password":"let me in"}"#, 429);
    caller.call("session", "DELETE", "", 204);
}

#[test]
fn the_program_is_as_its_description_says() {
    let described = Description::read();
    let (_far, near) = SerialPort::pair().unwrap();
    let device = rustix::termios::ttyname(&near, Vec::new()).unwrap().into_string().unwrap();
    let web = with(&SETTINGS.replace("{device}", &device));
    let token = web.token("anna");
    let said = described.said();
    let mut caller = Caller { described, web, token, seen: BTreeSet::new() };
    // Somebody is connected.
    let mut client = caller.web.program.connect();
    common::ask(&mut client, 1, &[3, 0, 0, 0, 1]);

    caller.call("session", "GET", "", 200);
    caller.call("settings", "GET", "", 200);
    candidates(&mut caller);
    requests(&mut caller);
    commands(&mut caller);
    caller.call("read", "POST", &table_of_own("holding", ",\"count\":2,\"type\":\"f32\""), 200);
    let status = caller.call("status", "GET", "", 200).json();
    for table in ["ports", "servers", "units", "clients", "rules", "devices", "points"] {
        assert!(!status[table].as_array().unwrap().is_empty(), "{table} of {status}");
    }
    caller.events();
    for (path, method, _) in &said {
        caller.refusals(path, method);
    }
    log_ins(&mut caller);
    let of_boards = OF_BOARDS.map(|(method, status)| (UPDATE.to_owned(), method.to_owned(), status));
    caller.seen.extend(of_boards);
    let missed: Vec<_> = said.difference(&caller.seen).collect();
    assert!(missed.is_empty(), "described, and not seen: {missed:?}");
    methods(&caller);
}

/// The program has no method that is not described.
fn methods(caller: &Caller) {
    for (path, operations) in caller.described.0["paths"].as_object().unwrap() {
        let response = caller.web.request("BREW", path).gets(405);
        let allowed: BTreeSet<String> =
            response.header("Allow").unwrap().split(", ").map(str::to_lowercase).collect();
        let known: BTreeSet<String> = operations.as_object().unwrap().keys().cloned().collect();
        assert_eq!(allowed, known, "{path}");
    }
    let _: &Program = &caller.web.program;
}
