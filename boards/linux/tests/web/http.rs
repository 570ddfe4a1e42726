//! A client for HTTP that sends whatever a test wants.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};

use serde_json::Value;
use socket2::{Domain, Socket, Type};

use crate::common::PATIENCE;

/// A request, which is sent by a connection of its own.
#[derive(Clone)]
pub(crate) struct Request {
    /// The client's address.
    from: Ipv4Addr,
    port: u16,
    method: String,
    path: String,
    host: String,
    headers: Vec<(String, String)>,
    body: Option<Vec<u8>>,
}

/// What came back.
#[derive(Debug)]
pub(crate) struct Response {
    pub(crate) status: u16,
    head: String,
    pub(crate) body: String,
    /// Of the body.
    pub(crate) bytes: usize,
    /// That it came in; 0 if its length was announced.
    pub(crate) chunks: usize,
}

impl Request {
    pub(crate) fn new(port: u16, method: &str, path: &str) -> Self {
        let (method, path, host) = (method.to_owned(), path.to_owned(), format!("127.0.0.1:{port}"));
        let from = Ipv4Addr::LOCALHOST;
        Self { from, port, method, path, host, headers: Vec::new(), body: None }
    }

    /// Sent from another address of the machine.
    pub(crate) fn from(mut self, address: Ipv4Addr) -> Self {
        self.from = address;
        self
    }

    pub(crate) fn host(mut self, host: &str) -> Self {
        self.host = host.to_owned();
        self
    }

    pub(crate) fn header(mut self, name: &str, value: &str) -> Self {
        self.headers.push((name.to_owned(), value.to_owned()));
        self
    }

    pub(crate) fn bearer(self, token: &str) -> Self {
        self.header("Authorization", &format!("Bearer {token}"))
    }

    pub(crate) fn body(self, kind: &str, body: &[u8]) -> Self {
        let mut request = self.header("Content-Type", kind);
        request.body = Some(body.to_owned());
        request
    }

    pub(crate) fn json(self, body: &str) -> Self {
        self.body("application/json", body.as_bytes())
    }

    pub(crate) fn lines(self, body: &str) -> Self {
        self.body("text/plain", body.as_bytes())
    }

    fn connect(&self) -> TcpStream {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.bind(&SocketAddr::from((self.from, 0)).into()).unwrap();
        socket.connect(&SocketAddr::from((Ipv4Addr::LOCALHOST, self.port)).into()).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket.into()
    }

    /// Sends it, and reads until the gateway closes the connection.
    pub(crate) fn send(&self) -> Response {
        let mut stream = self.connect();
        let mut head = format!("{} {} HTTP/1.1\r\nHost: {}\r\n", self.method, self.path, self.host);
        self.headers.iter().for_each(|(name, value)| head.push_str(&format!("{name}: {value}\r\n")));
        let body = self.body.clone().unwrap_or_default();
        if self.body.is_some() {
            head.push_str(&format!("Content-Length: {}\r\n", body.len()));
        }
        stream.write_all(format!("{head}\r\n").as_bytes()).unwrap();
        // A body that is too large is not read to its end.
        let _ = stream.write_all(&body);
        let mut received = Vec::new();
        let _ = stream.read_to_end(&mut received);
        Response::parse(&received)
    }

    /// Sends it, without a body.
    pub(crate) fn open(&self) -> TcpStream {
        let mut stream = self.connect();
        let mut head = format!("{} {} HTTP/1.1\r\nHost: {}\r\n", self.method, self.path, self.host);
        self.headers.iter().for_each(|(name, value)| head.push_str(&format!("{name}: {value}\r\n")));
        stream.write_all(format!("{head}\r\n").as_bytes()).unwrap();
        stream
    }

    /// Sends it, and reads the head and the data of so many events; gives the connection, which is still open, too.
    pub(crate) fn events(&self, count: usize) -> (String, Vec<Value>, TcpStream) {
        let mut stream = self.open();
        let mut received = String::new();
        while received.matches("\n\n").count() < count {
            let mut piece = [0; 4_096];
            let read = stream.read(&mut piece).unwrap();
            assert!(read > 0, "it ended after {received:?}");
            received.push_str(&String::from_utf8_lossy(&piece[..read]));
        }
        let (head, body) = received.split_once("\r\n\r\n").unwrap();
        // The last chunk may not be complete: an end is added.
        let whole = &body[..body.rfind("\n\n").unwrap() + 2];
        let text = chunks(format!("{whole}\r\n0\r\n").as_bytes()).concat();
        let text = String::from_utf8(text).unwrap();
        let events = text.split_terminator("\n\n").map(|event| event.strip_prefix("data: ").unwrap());
        (head.to_owned(), events.map(|event| serde_json::from_str(event).unwrap()).collect(), stream)
    }

    /// The same, of which the status is expected.
    pub(crate) fn gets(&self, status: u16) -> Response {
        let response = self.send();
        assert_eq!(response.status, status, "{} {}: {response:?}", self.method, self.path);
        response
    }
}

impl Response {
    fn parse(received: &[u8]) -> Self {
        let text = String::from_utf8_lossy(received).into_owned();
        let (head, body) = split(received, b"\r\n\r\n").unwrap_or_else(|| panic!("no response: {text:?}"));
        let head = String::from_utf8(head.to_vec()).unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        let mut response = Self { status, head, body: String::new(), bytes: 0, chunks: 0 };
        let body = match response.header("Transfer-Encoding") {
            Some("chunked") => {
                let chunks = chunks(body);
                response.chunks = chunks.len();
                chunks.concat()
            }
            _ => body.to_vec(),
        };
        response.bytes = body.len();
        response.body = String::from_utf8_lossy(&body).into_owned();
        response
    }

    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        let headers = self.head.lines().skip(1).filter_map(|line| line.split_once(": "));
        headers.filter(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, value)| value).next()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// The message of an error.
    pub(crate) fn message(&self) -> String {
        self.json()["error"]["message"].as_str().unwrap().to_owned()
    }
}

/// What is before and behind `separator`.
fn split<'b>(bytes: &'b [u8], separator: &[u8]) -> Option<(&'b [u8], &'b [u8])> {
    let at = bytes.windows(separator.len()).position(|window| window == separator)?;
    Some((&bytes[..at], &bytes[at + separator.len()..]))
}

fn chunks(mut rest: &[u8]) -> Vec<&[u8]> {
    let mut body = Vec::new();
    loop {
        let (length, behind) = split(rest, b"\r\n").expect("a chunk");
        let length = usize::from_str_radix(str::from_utf8(length).unwrap(), 16).unwrap();
        if length == 0 {
            return body;
        }
        body.push(&behind[..length]);
        rest = behind[length..].strip_prefix(b"\r\n").unwrap();
    }
}
