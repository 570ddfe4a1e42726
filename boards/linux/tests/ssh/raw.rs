//! A client of SSH for tests, which sends whatever it is told. It does not check who the server is.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::time::Duration;

use ring::aead::chacha20_poly1305_openssh::{OpeningKey, SealingKey, TAG_LEN};
use ring::agreement::{EphemeralPrivateKey, UnparsedPublicKey, X25519, agree_ephemeral};
use ring::digest::{SHA256, digest};
use ring::rand::SystemRandom;
use ring::signature::{Ed25519KeyPair, KeyPair};
use socket2::{Domain, Socket, Type};

const IDENTIFICATION: &str = "SSH-2.0-random";
/// Longest wait for the server, and for room to write: a server that is busy refusing takes no more.
const PATIENCE: Duration = Duration::from_secs(10);
const WRITE_PATIENCE: Duration = Duration::from_secs(1);
/// A longer packet is none of the server's.
const PACKET_BYTES_MAX: usize = 40_000;

/// What the client's key is made of, and its public part as settings have it.
const SEED: [u8; 32] = [9; 32];
// Not every test has users with keys.
#[allow(dead_code)]
pub(crate) const KEY: &str =
    "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIP0XJDhaoMdbZPt4zWAvodmR/ev3axPFjtcC6sg16fYY";

/// How far a connection has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Stage {
    /// Nothing was sent.
    Begin,
    /// Both have said what they are.
    Exchange,
    /// The algorithms are negotiated.
    Keys,
    /// Packets are encrypted.
    Service,
    /// The server waits for a user.
    LogIn,
    /// The viewer `vera` has logged in, and has a channel.
    Session,
}

/// A connection.
pub(crate) struct Client {
    stream: TcpStream,
    /// Packets so far, each way.
    sent: u32,
    received: u32,
    keys: Option<(SealingKey, OpeningKey)>,
    /// The session's number: the hash of the exchange.
    session: Vec<u8>,
    /// Logs in with a key instead of a password.
    has_key: bool,
    /// What the server calls the channel.
    pub(crate) channel: u32,
}

/// Appends `text` as a string (RFC 4251, 5).
pub(crate) fn put(payload: &mut Vec<u8>, text: &[u8]) {
    payload.extend((text.len() as u32).to_be_bytes());
    payload.extend(text);
}

fn strings(kind: u8, texts: &[&[u8]]) -> Vec<u8> {
    let mut payload = vec![kind];
    texts.iter().for_each(|text| put(&mut payload, text));
    payload
}

/// Appends a number without sign (RFC 4251, 5).
fn put_number(into: &mut Vec<u8>, bytes: &[u8]) {
    let start = bytes.iter().position(|byte| *byte != 0).unwrap_or(bytes.len());
    let zero = bytes.get(start).is_some_and(|byte| byte & 0x80 != 0);
    put(into, &[if zero { &[0][..] } else { &[] }, &bytes[start..]].concat());
}

fn password_request() -> Vec<u8> {
    let mut request = strings(50, &[b"vera", b"ssh-connection", b"password"]);
    request.push(0);
    put(&mut request, b"let me in");
    request
}

fn broken(what: &str) -> io::Error {
    io::Error::other(what.to_owned())
}

impl Client {
    /// Connects to `port` from 127.0.0.`peer`.
    pub(crate) fn connect(port: u16, peer: u8) -> io::Result<Self> {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None)?;
        socket.bind(&SocketAddr::from((Ipv4Addr::new(127, 0, 0, peer), 0)).into())?;
        socket.connect(&SocketAddr::from((Ipv4Addr::LOCALHOST, port)).into())?;
        let stream = TcpStream::from(socket);
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(WRITE_PATIENCE))?;
        let session = Vec::new();
        Ok(Self { stream, sent: 0, received: 0, keys: None, session, has_key: false, channel: 0 })
    }

    /// Lets it log in with [`KEY`].
    // Not every test does.
    #[allow(dead_code)]
    pub(crate) fn with_key(mut self) -> Self {
        self.has_key = true;
        self
    }

    /// Brings a new connection to `stage`.
    pub(crate) fn reach(mut self, stage: Stage) -> io::Result<Self> {
        if stage == Stage::Begin {
            return Ok(self);
        }
        self.send_bytes(format!("{IDENTIFICATION}\r\n").as_bytes())?;
        let (mut server, mut byte) = (Vec::new(), [0]);
        while byte != *b"\n" {
            self.stream.read_exact(&mut byte)?;
            server.push(byte[0]);
        }
        let server = String::from_utf8_lossy(&server).trim_end().to_owned();
        if stage == Stage::Exchange {
            return Ok(self);
        }
        let [cipher, check] = ["chacha20-poly1305@openssh.com", "hmac-sha2-256-etm@openssh.com"];
        let exchange = "curve25519-sha256,kex-strict-c-v00@openssh.com";
        let lists = [exchange, "ssh-ed25519", cipher, cipher, check, check, "none", "none", "", ""];
        let mut own = vec![20];
        own.extend([7; 16]);
        lists.iter().for_each(|list| put(&mut own, list.as_bytes()));
        own.extend([0; 5]);
        self.send(&own)?;
        let theirs = self.receive()?;
        if stage == Stage::Keys {
            return Ok(self);
        }
        self.exchange(&server, &own, &theirs)?;
        if stage == Stage::Service {
            return Ok(self);
        }
        self.send(&strings(5, &[b"ssh-userauth"]))?;
        self.receive_kind(6)?;
        if stage == Stage::LogIn {
            return Ok(self);
        }
        let request = if self.has_key { self.key_request() } else { password_request() };
        self.send(&request)?;
        self.receive_kind(52)?;
        let mut open = strings(90, &[b"session"]);
        open.extend([0, 0, 0, 0, 0, 0x10, 0, 0, 0, 0, 0x80, 0]);
        self.send(&open)?;
        let opened = self.receive_kind(91)?;
        let channel = opened.get(5..9).and_then(|number| number.try_into().ok());
        self.channel = channel.map(u32::from_be_bytes).ok_or_else(|| broken("too short"))?;
        Ok(self)
    }

    /// Asks to log in with [`KEY`] (RFC 4252, 7).
    fn key_request(&self) -> Vec<u8> {
        let pair = Ed25519KeyPair::from_seed_unchecked(&SEED).unwrap();
        let typed = |bytes: &[u8]| strings(0, &[b"ssh-ed25519", bytes])[1..].to_vec();
        let mut request = strings(50, &[b"vera", b"ssh-connection", b"publickey"]);
        request.push(1);
        put(&mut request, b"ssh-ed25519");
        put(&mut request, &typed(pair.public_key().as_ref()));
        let mut signed = Vec::new();
        put(&mut signed, &self.session);
        signed.extend(&request);
        put(&mut request, &typed(pair.sign(&signed).as_ref()));
        request
    }

    /// Agrees on keys (RFC 8731).
    fn exchange(&mut self, server: &str, own: &[u8], theirs: &[u8]) -> io::Result<()> {
        let random = SystemRandom::new();
        let fault = |_| broken("no key");
        let private = EphemeralPrivateKey::generate(&X25519, &random).map_err(fault)?;
        let public = private.compute_public_key().map_err(fault)?;
        self.send(&strings(30, &[public.as_ref()]))?;
        let reply = self.receive_kind(31)?;
        let mut rest = &reply[1..];
        let mut next = || {
            let (length, behind) = rest.split_first_chunk::<4>().ok_or_else(|| broken("too short"))?;
            let (text, behind) = behind
                .split_at_checked(u32::from_be_bytes(*length) as usize)
                .ok_or_else(|| broken("too short"))?;
            rest = behind;
            Ok::<_, io::Error>(text)
        };
        let (host_key, ephemeral) = (next()?, next()?);
        let their_public = UnparsedPublicKey::new(&X25519, ephemeral);
        let mut secret = Vec::new();
        agree_ephemeral(private, &their_public, |shared| put_number(&mut secret, shared)).map_err(fault)?;
        let mut hashed = Vec::new();
        for text in
            [IDENTIFICATION.as_bytes(), server.as_bytes(), own, theirs, host_key, public.as_ref(), ephemeral]
        {
            put(&mut hashed, text);
        }
        hashed.extend(&secret);
        let hash = digest(&SHA256, &hashed);
        // RFC 4253, 7.2: the hash is the session's number, too.
        let key = |letter: u8| -> [u8; 64] {
            let first = digest(&SHA256, &[&secret, hash.as_ref(), &[letter], hash.as_ref()].concat());
            let second = digest(&SHA256, &[&secret, hash.as_ref(), first.as_ref()].concat());
            [first.as_ref(), second.as_ref()].concat().try_into().unwrap_or([0; 64])
        };
        self.session = hash.as_ref().to_vec();
        self.send(&[21])?;
        self.receive_kind(21)?;
        self.keys = Some((SealingKey::new(&key(b'C')), OpeningKey::new(&key(b'D'))));
        // Strict key exchange counts anew.
        (self.sent, self.received) = (0, 0);
        Ok(())
    }

    /// Runs `line` in the session; returns what it printed.
    pub(crate) fn run(&mut self, line: &str) -> io::Result<String> {
        let mut request = vec![98];
        request.extend(self.channel.to_be_bytes());
        put(&mut request, b"exec");
        request.push(1);
        put(&mut request, line.as_bytes());
        self.send(&request)?;
        let mut said = String::new();
        loop {
            let payload = self.receive()?;
            match payload[0] {
                94 => said.push_str(&String::from_utf8_lossy(payload.get(9..).unwrap_or_default())),
                97 => return Ok(said),
                _ => {}
            }
        }
    }

    pub(crate) fn send_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }

    /// Sends a packet (RFC 4253, 6).
    pub(crate) fn send(&mut self, payload: &[u8]) -> io::Result<()> {
        // With this cipher the length is no part of what is padded.
        let aligned = payload.len() + 1 + if self.keys.is_some() { 0 } else { 4 };
        let padding = 4 + (8 - (aligned + 4) % 8) % 8;
        let mut packet = ((payload.len() + 1 + padding) as u32).to_be_bytes().to_vec();
        packet.push(padding as u8);
        packet.extend(payload);
        packet.resize(packet.len() + padding, 0);
        if let Some((key, _)) = &self.keys {
            let mut tag = [0; TAG_LEN];
            key.seal_in_place(self.sent, &mut packet, &mut tag);
            packet.extend(tag);
        }
        self.sent = self.sent.wrapping_add(1);
        self.send_bytes(&packet)
    }

    /// The next packet of this kind.
    fn receive_kind(&mut self, kind: u8) -> io::Result<Vec<u8>> {
        loop {
            let payload = self.receive()?;
            match payload[0] {
                found if found == kind => return Ok(payload),
                // A disconnection, a failure to log in, or one to open a channel.
                1 | 51 | 92 => return Err(broken("refused")),
                _ => {}
            }
        }
    }

    /// The payload of the next packet.
    fn receive(&mut self) -> io::Result<Vec<u8>> {
        let mut head = [0; 4];
        self.stream.read_exact(&mut head)?;
        let length = match &self.keys {
            Some((_, key)) => key.decrypt_packet_length(self.received, head),
            None => head,
        };
        let length = u32::from_be_bytes(length) as usize;
        if length > PACKET_BYTES_MAX {
            return Err(broken("too long"));
        }
        let mut packet = head.to_vec();
        packet.resize(4 + length, 0);
        self.stream.read_exact(&mut packet[4..])?;
        let text = match &self.keys {
            Some((_, key)) => {
                let mut tag = [0; TAG_LEN];
                self.stream.read_exact(&mut tag)?;
                key.open_in_place(self.received, &mut packet, &tag).map_err(|_| broken("a wrong tag"))?
            }
            None => &packet[4..],
        };
        self.received = self.received.wrapping_add(1);
        let padding = usize::from(*text.first().ok_or_else(|| broken("empty"))?);
        let payload = text.get(1..text.len().saturating_sub(padding)).filter(|payload| !payload.is_empty());
        payload.map(<[u8]>::to_vec).ok_or_else(|| broken("empty"))
    }
}
