//! A client of SSH: the gateway decides about its log-in, and it gets one session at a time. Nothing else is served: no forwarding, no
//! agent, no subsystem, no environment.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use mobgate::gateway::{Credential, Gateway};
use mobgate::hal::System;
use russh::keys::PublicKey;
use russh::server::{Auth, ChannelOpenHandle, Handler, Msg, PublicKeyOffer, Session, VerifiedPublicKey};
use russh::{Channel, ChannelId, ChannelOpenFailure, Disconnect, MethodKind, MethodSet, Pty};

use super::entrant::Who;
use super::session::{Running, Start};
use crate::passwords;

/// What the thread tells about a connection.
#[derive(Clone, Copy)]
pub(super) enum Event {
    LoggedIn,
    Ended,
}

pub(super) type News = Arc<Signal<CriticalSectionRawMutex, Event>>;

/// The state of a connection.
pub(super) struct Client {
    gateway: &'static Gateway<'static>,
    /// The authenticated user.
    who: Who,
    news: News,
    is_in: Arc<AtomicBool>,
    /// A key was refused: clients offer all that they have, which counts once.
    key_refused: bool,
    channel: Option<Open>,
}

/// The channel, its terminal's size as a report to the console, and its session once there is one.
struct Open {
    id: ChannelId,
    terminal: Option<String>,
    session: Option<Running>,
}

/// How clients may log in.
pub(super) fn methods() -> MethodSet {
    MethodSet::from(&[MethodKind::PublicKey, MethodKind::Password][..])
}

/// Checks passwords, and nothing else.
struct Passwords;

impl System for Passwords {
    fn name(&self) -> &str {
        ""
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        passwords::is_right(hash, password).await
    }

    fn reboot(&self) {}
}

/// The key as the settings have it; empty for a type that they have not.
fn text(key: &PublicKey) -> String {
    let line = key.to_openssh().unwrap_or_default();
    let mut words = line.split(' ');
    let key = if words.next() == Some("ssh-ed25519") { words.next() } else { None };
    key.unwrap_or_default().to_owned()
}

/// The size of a terminal as xterm reports it; empty if the client does not know it (RFC 4254, 6.2).
fn size_report(columns: u32, rows: u32) -> String {
    if columns == 0 { String::new() } else { format!("\x1b[8;{rows};{columns}t") }
}

impl Client {
    pub(super) fn new(
        gateway: &'static Gateway<'static>,
        who: Who,
        news: News,
        is_in: Arc<AtomicBool>,
    ) -> Self {
        Self { gateway, who, news, is_in, key_refused: false, channel: None }
    }

    async fn log_in(&mut self, user: &str, by: Credential<'_>) -> Auth {
        let is_offer = matches!(by, Credential::Offered { .. });
        if !self.gateway.log_in(&Passwords, self.who.peer, user, by).await {
            // The same method may be tried again, with another key or password.
            return Auth::Reject { proceed_with_methods: Some(methods()), partial_success: false };
        }
        if !is_offer {
            user.clone_into(&mut self.who.user);
        }
        Auth::Accept
    }

    /// The channel with this number, which is the only one.
    fn channel(&mut self, id: ChannelId) -> Option<&mut Open> {
        self.channel.as_mut().filter(|channel| channel.id == id)
    }

    /// Starts the session with a shell, or with lines to run.
    fn start(
        &mut self,
        id: ChannelId,
        lines: Option<&[u8]>,
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        let who = self.who.clone();
        let Some(channel) = self.channel(id).filter(|channel| channel.session.is_none()) else {
            return session.channel_failure(id);
        };
        let terminal = channel.terminal.clone();
        let start = Start { who, terminal, lines: lines.map(<[u8]>::to_vec) };
        match start.begin(session.handle(), id) {
            Ok(running) => {
                channel.session = Some(running);
                session.channel_success(id)
            }
            Err(error) => {
                log::warn!("no console session by SSH: {error}");
                session.channel_failure(id)
            }
        }
    }
}

impl Handler for Client {
    type Error = russh::Error;

    async fn auth_password(&mut self, user: &str, password: &str) -> Result<Auth, russh::Error> {
        Ok(self.log_in(user, Credential::Password(password)).await)
    }

    async fn auth_publickey_offered(
        &mut self,
        user: &str,
        offer: PublicKeyOffer<'_>,
    ) -> Result<Auth, russh::Error> {
        let (key, counts) = (text(offer.public_key), !self.key_refused);
        let auth = self.log_in(user, Credential::Offered { key: &key, counts }).await;
        self.key_refused |= auth != Auth::Accept;
        Ok(auth)
    }

    async fn auth_publickey(&mut self, user: &str, key: VerifiedPublicKey<'_>) -> Result<Auth, russh::Error> {
        Ok(self.log_in(user, Credential::Key(&text(key.public_key))).await)
    }

    async fn auth_succeeded(&mut self, _: &mut Session) -> Result<(), russh::Error> {
        self.is_in.store(true, Relaxed);
        self.news.signal(Event::LoggedIn);
        Ok(())
    }

    async fn channel_open_session(
        &mut self,
        channel: Channel<Msg>,
        reply: ChannelOpenHandle,
        _: &mut Session,
    ) -> Result<(), russh::Error> {
        if self.channel.is_some() {
            reply.reject(ChannelOpenFailure::ResourceShortage).await;
        } else {
            self.channel = Some(Open { id: channel.id(), terminal: None, session: None });
            reply.accept().await;
        }
        Ok(())
    }

    async fn channel_close(&mut self, id: ChannelId, _: &mut Session) -> Result<(), russh::Error> {
        if self.channel(id).is_some() {
            self.channel = None;
        }
        Ok(())
    }

    async fn channel_eof(&mut self, id: ChannelId, _: &mut Session) -> Result<(), russh::Error> {
        if let Some(running) = self.channel(id).and_then(|channel| channel.session.as_mut()) {
            running.end();
        }
        Ok(())
    }

    async fn data(&mut self, id: ChannelId, data: &[u8], session: &mut Session) -> Result<(), russh::Error> {
        let running = self.channel(id).and_then(|channel| channel.session.as_mut());
        if running.is_some_and(|running| !running.type_in(data)) {
            session.disconnect(Disconnect::ByApplication, "more input than the console takes", "")?;
        }
        Ok(())
    }

    async fn pty_request(
        &mut self,
        id: ChannelId,
        _term: &str,
        columns: u32,
        rows: u32,
        _width: u32,
        _height: u32,
        _modes: &[(Pty, u32)],
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        match self.channel(id).filter(|channel| channel.session.is_none()) {
            Some(channel) => {
                channel.terminal = Some(size_report(columns, rows));
                session.channel_success(id)
            }
            None => session.channel_failure(id),
        }
    }

    async fn window_change_request(
        &mut self,
        id: ChannelId,
        columns: u32,
        rows: u32,
        _width: u32,
        _height: u32,
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        let terminal = self.channel(id).filter(|channel| channel.terminal.is_some());
        if let Some(running) = terminal.and_then(|channel| channel.session.as_mut()) {
            running.type_in(size_report(columns, rows).as_bytes());
        }
        session.channel_success(id)
    }

    async fn shell_request(&mut self, id: ChannelId, session: &mut Session) -> Result<(), russh::Error> {
        self.start(id, None, session)
    }

    async fn exec_request(
        &mut self,
        id: ChannelId,
        lines: &[u8],
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        self.start(id, Some(lines), session)
    }

    async fn subsystem_request(
        &mut self,
        id: ChannelId,
        _name: &str,
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        session.channel_failure(id)
    }

    async fn env_request(
        &mut self,
        id: ChannelId,
        _name: &str,
        _value: &str,
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        session.channel_failure(id)
    }

    async fn x11_request(
        &mut self,
        id: ChannelId,
        _single: bool,
        _protocol: &str,
        _cookie: &str,
        _screen: u32,
        session: &mut Session,
    ) -> Result<(), russh::Error> {
        session.channel_failure(id)
    }
}
