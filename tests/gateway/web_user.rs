//! Users of the web interface.

use mobgate_simulator::Network;
use mobgate_simulator::net::ClientStream;

use crate::prelude::*;

pub(crate) const JSON: &str = "Content-Type: application/json\r\n";

/// A user's computer.
#[derive(Clone)]
pub(crate) struct User {
    network: Network,
    /// What the user calls the gateway.
    pub(crate) host: &'static str,
    token: String,
}

impl User {
    /// Somebody who has not logged in.
    pub(crate) fn new(network: &Network, host: &'static str) -> Self {
        Self { network: network.clone(), host, token: String::new() }
    }

    /// The same computer without a user.
    pub(crate) fn nobody(&self) -> Self {
        Self::new(&self.network, self.host)
    }

    /// The same computer with `name` logged in.
    pub(crate) async fn log_in(&self, name: &str, password: &str) -> Self {
        let nobody = self.nobody();
        let body = format!(r#"{{"user":"{name}","password":"{password}","token":true}}"#);
        let (status, text) = nobody.call("POST /api/v1/session", JSON, body.as_bytes()).await;
        assert_eq!(status, 200, "{text}");
        let token = text.split_once("\"token\":\"").unwrap().1.split('"').next().unwrap().to_owned();
        Self { token, ..nobody }
    }

    /// Sends a head, for a body of so many bytes.
    pub(crate) async fn begin(&self, what: &str, headers: &str, length: usize) -> ClientStream {
        let mut stream = self.network.connect(machine(1), 80).unwrap();
        let host = self.host;
        let bearer = match self.token.as_str() {
            "" => String::new(),
            token => format!("Authorization: Bearer {token}\r\n"),
        };
        let head =
            format!("{what} HTTP/1.1\r\nHost: {host}\r\n{bearer}{headers}Content-Length: {length}\r\n\r\n");
        stream.write_all(head.as_bytes()).await.unwrap();
        stream
    }

    /// Sends a request; returns the status and the body of what comes back.
    pub(crate) async fn call(&self, what: &str, headers: &str, body: &[u8]) -> (u16, String) {
        let mut stream = self.begin(what, headers, body.len()).await;
        stream.write_all(body).await.unwrap();
        received(&mut stream).await
    }
}

/// What comes until the end.
pub(crate) async fn received(stream: &mut ClientStream) -> (u16, String) {
    let (mut all, mut piece) = (Vec::new(), [0; 1_024]);
    while let Ok(count @ 1..) = stream.read(&mut piece).await {
        all.extend_from_slice(&piece[..count]);
    }
    let text = String::from_utf8(all).unwrap();
    let status = text.split(' ').nth(1).and_then(|status| status.parse().ok());
    let body = text.split_once("\r\n\r\n").map(|(_, body)| body).unwrap_or_default();
    // One chunk behind its length, and the end.
    let chunk = body.split_once("\r\n").and_then(|(_, chunk)| chunk.strip_suffix("\r\n0\r\n\r\n"));
    (status.unwrap_or(0), chunk.unwrap_or_default().to_owned())
}
