//! One connection to a broker.

use core::fmt::{self, Write as _};

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use super::discovery::{Announced, behind};
use super::mark::sample;
use super::session::{Open, SUBSCRIPTION, Session};
use super::source::Source;
use crate::gateway::Status;
use crate::gateway::audit::Topic;
use crate::hal::{OpenError, OpenErrorKind, TcpConnect};
use crate::mqtt::{self, Accepted, Connect, Inbox, Malformed, Message, Packet, Qos, Received, Will};
use crate::scanner::RowId;
use crate::settings::Format;

/// Longest time between packets, as told to the broker; it takes the gateway for gone after one and a half of it.
const KEEP_ALIVE_S: u16 = 30;
/// How long a broker may take for the response to a ping.
const PONG_MAX: Duration = Duration::from_secs(10);
/// Time limit of a packet.
const SEND_MAX: Duration = Duration::from_secs(30);
/// The points are checked this often even if nothing happens: values grow old.
const CHECK_PERIOD: Duration = Duration::from_secs(1);
/// From here on reasons are refusals (5: 2.4; 3.1.1: 3.9.3).
const REFUSALS: u8 = 0x80;

pub(super) const fn failed(hint: &'static str) -> OpenError {
    OpenError::new(OpenErrorKind::Failed, hint)
}

const CLOSED: OpenError = failed("the broker has closed the connection");
const BROKEN: OpenError = failed("the connection broke");
const NO_MQTT: OpenError = failed("the server does not speak this version of MQTT");
const SLOW: OpenError = OpenError::new(OpenErrorKind::TimedOut, "the broker reads nothing");
const SILENT: OpenError = OpenError::new(OpenErrorKind::TimedOut, "the broker does not respond to pings");
const NO_QOS: OpenError =
    OpenError::new(OpenErrorKind::Unsupported, "the broker takes no messages with an acknowledgement");

impl From<Malformed> for OpenError {
    fn from(_: Malformed) -> Self {
        NO_MQTT
    }
}

/// Why the broker refuses the connection (3.1.1: table 3.1; 5: 3.2.2.2).
fn refusal(code: u8) -> OpenError {
    let denied = |hint| OpenError::new(OpenErrorKind::Denied, hint);
    match code {
        1 | 0x84 => NO_MQTT,
        2 | 0x85 => denied("the broker does not accept the client's name"),
        // Brokers use them for each other: mosquitto has 5 and 0x87 for a wrong password.
        4 | 5 | 0x86 | 0x87 => denied("the broker does not accept user name or password"),
        3 | 0x88 | 0x89 => OpenError::new(OpenErrorKind::Refused, "the broker is not available"),
        _ => OpenError::new(OpenErrorKind::Refused, "the broker refuses the connection"),
    }
}

/// Sends a packet.
pub(super) async fn send(stream: &mut impl Write, packet: &[u8]) -> Result<(), OpenError> {
    let written = async {
        stream.write_all(packet).await?;
        stream.flush().await
    };
    with_timeout(SEND_MAX, written).await.map_err(|_| SLOW)?.map_err(|_| BROKEN)
}

/// When packets came and went.
struct KeepAlive {
    /// Longest time between packets.
    period: Duration,
    sent: Instant,
    /// When a ping was sent that has no response yet.
    asked: Option<Instant>,
}

impl KeepAlive {
    /// When it is time for a ping, or too late for the response.
    fn due(&self) -> Instant {
        self.asked.map_or(self.sent + self.period / 2, |asked| asked + PONG_MAX)
    }
}

impl Source<'_, '_> {
    /// Connects, until the broker has accepted.
    pub(super) async fn connect<'c, C: TcpConnect>(
        &self,
        connector: &'c C,
        inbox: &mut Inbox,
    ) -> Result<(C::Stream<'c>, Accepted), OpenError> {
        let publisher = self.publisher;
        let mut stream = connector.connect(&publisher.broker).await?;
        // Left out of images without TLS.
        #[cfg(feature = "tls")]
        if publisher.tls.on {
            use crate::hal::TcpStream as _;
            stream.secure(crate::settings::publisher_id(self.nth), Some(&publisher.broker)).await?;
        }
        let (prefix, name) = (&publisher.topic, &publisher.name);
        let is_sparkplug = self.is_sparkplug();
        self.bd_seq.set(self.bd_seq.get().wrapping_add(1));
        let topic = fmt::from_fn(|f| match is_sparkplug {
            true => write!(f, "{}", self.topic("NDEATH")),
            false => write!(f, "{prefix}/{name}/status"),
        });
        let gone = |out: &mut mqtt::Writer<'_>| match is_sparkplug {
            true => self.write_death(out),
            false => out.write_str("offline"),
        };
        let packet = mqtt::connect(&Connect {
            version: publisher.version,
            client: format_args!("{prefix}-{name}"),
            user: &publisher.user,
            password: &publisher.password,
            keep_alive: KEEP_ALIVE_S,
            is_clean: is_sparkplug,
            will: Will { topic: format_args!("{topic}"), write: &gone, retained: !is_sparkplug },
        });
        send(&mut stream, &packet.unwrap_or_default()).await?;
        loop {
            match inbox.next(publisher.version)? {
                Some(Received::Connected(Ok(accepted))) => return Ok((stream, accepted)),
                Some(Received::Connected(Err(code))) => return Err(refusal(code)),
                Some(_) => return Err(NO_MQTT),
                None => {}
            }
            match stream.read(inbox.room()).await {
                Ok(0) => return Err(CLOSED),
                Ok(count) => inbox.arrived(count),
                Err(_) => return Err(BROKEN),
            }
        }
    }

    /// Publishes on an open connection, until the settings change.
    pub(super) async fn serve(
        &self,
        stream: &mut (impl Read + Write),
        inbox: &mut Inbox,
        accepted: &Accepted,
        session: &mut Session,
    ) -> Result<(), OpenError> {
        if !accepted.takes_qos_1 {
            return Err(NO_QOS);
        }
        self.begin(stream, accepted, session).await?;
        let period = Duration::from_secs(accepted.keep_alive.unwrap_or(KEEP_ALIVE_S).max(1).into());
        let mut alive = KeepAlive { period, sent: Instant::now(), asked: None };
        loop {
            while let Some(received) = inbox.next(self.publisher.version)? {
                alive.asked = None;
                if let Some(id) = self.take(received, session)? {
                    send(stream, &mqtt::acknowledge(id)).await?;
                }
            }
            if Instant::now() >= alive.due() {
                if alive.asked.is_some() {
                    return Err(SILENT);
                }
                send(stream, &mqtt::PING).await?;
                (alive.asked, alive.sent) = (Some(Instant::now()), Instant::now());
            }
            self.mark_changed(session);
            self.settle(session);
            while self.send_next(stream, accepted, session).await? {
                alive.sent = Instant::now();
            }
            self.state.report(|report| report.queued = session.queued());
            let next = Instant::now() + CHECK_PERIOD;
            let due = session.due().map_or(next, |due| due.min(next)).min(alive.due());
            let (changed, values) = (self.state.changed.wait(), self.state.values.wait());
            // Other settings come before the values that they bring.
            match select4(changed, stream.read(inbox.room()), values, Timer::at(due)).await {
                Either4::First(()) => {
                    if self.is_sparkplug() {
                        // The broker tells it as well.
                        let _ = send(stream, &self.death().unwrap_or_default()).await;
                    }
                    return Ok(());
                }
                Either4::Second(Ok(0)) => return Err(CLOSED),
                Either4::Second(Ok(count)) => inbox.arrived(count),
                Either4::Second(Err(_)) => return Err(BROKEN),
                Either4::Third(()) | Either4::Fourth(()) => {}
            }
        }
    }

    /// Sends what is open again, and subscribes to commands.
    async fn begin(
        &self,
        stream: &mut impl Write,
        accepted: &Accepted,
        session: &mut Session,
    ) -> Result<(), OpenError> {
        let publisher = self.publisher;
        session.connected(accepted);
        log_info!("publisher {}: connected to {}", publisher.name, publisher.broker);
        self.state.report(|report| (report.status, report.since) = (Status::Open, Instant::now()));
        for open in &session.open {
            send(stream, &open.packet).await?;
        }
        let is_sparkplug = self.is_sparkplug();
        if publisher.commands || is_sparkplug {
            let filter = fmt::from_fn(|f| match is_sparkplug {
                true => write!(f, "{}", self.topic("NCMD")),
                false => write!(f, "{}/points/+/set", publisher.topic),
            });
            let filter = format_args!("{filter}");
            let subscribe = mqtt::subscribe(publisher.version, SUBSCRIPTION, filter, is_sparkplug);
            send(stream, &subscribe.unwrap_or_default()).await?;
        }
        Ok(())
    }

    /// Handles a packet. Returns the id of one that is to be acknowledged.
    fn take(&self, received: Received<'_>, session: &mut Session) -> Result<Option<u16>, OpenError> {
        match received {
            Received::Acknowledged { id, reason } if session.acknowledged(id) => {
                let is_refused = reason >= REFUSALS;
                if is_refused {
                    log_warn!("publisher {}: the broker refuses a message: {}", self.publisher.name, reason);
                }
                self.state.report(|report| {
                    report.sent = report.sent.wrapping_add(u32::from(!is_refused));
                    report.lost = report.lost.wrapping_add(u32::from(is_refused));
                });
            }
            Received::Message { id, payload, retained, .. } if self.is_sparkplug() => {
                self.node_command(session, payload, retained);
                return Ok(id);
            }
            Received::Message { id, topic, payload, retained, reply } => {
                self.message(session, topic, payload, retained, reply);
                return Ok(id);
            }
            Received::Subscribed { reason } if reason >= REFUSALS => {
                log_warn!("publisher {}: the broker passes on no commands: {}", self.publisher.name, reason);
            }
            Received::Disconnected { .. } => return Err(CLOSED),
            Received::Connected(_) => return Err(NO_MQTT),
            Received::Acknowledged { .. } | Received::Subscribed { .. } | Received::Pong => {}
        }
        Ok(None)
    }

    /// Sends the next message, if there is one and the broker may get it.
    async fn send_next(
        &self,
        stream: &mut impl Write,
        accepted: &Accepted,
        session: &mut Session,
    ) -> Result<bool, OpenError> {
        if self.is_sparkplug() {
            return self.send_metrics(stream, accepted, session).await;
        }
        let most = usize::from(accepted.receive_max).min(session.open.capacity());
        if session.open.len() >= most {
            return Ok(false);
        }
        let id = session.next_id();
        let make = Make { source: self, id, retains: accepted.retains };
        let Some(made) = make.next(session) else { return Ok(false) };
        let made = made.filter(|packet| packet.len() <= accepted.packet_max as usize);
        let Some(packet) = made else {
            log_warn!("publisher {}: a message is too long", self.publisher.name);
            self.state.report(|report| report.lost = report.lost.wrapping_add(1));
            return Ok(true);
        };
        // Kept first: if sending fails it is sent again.
        let _ = session.open.push(Open { id, packet });
        if let Some(open) = session.open.last() {
            send(stream, &open.packet).await?;
        }
        Ok(true)
    }
}

/// Makes messages, the most urgent first.
struct Make<'m, 's, 'g> {
    source: &'m Source<'s, 'g>,
    id: u16,
    retains: bool,
}

impl Make<'_, '_, '_> {
    fn message<'t>(&self, topic: mqtt::Text<'t>, retained: bool, correlation: &'t [u8]) -> Message<'t> {
        let version = self.source.publisher.version;
        Message {
            version,
            qos: Qos::Acknowledged(self.id),
            retained: retained && self.retains,
            topic,
            correlation,
        }
    }

    /// The next message; the inner `None`: it is too long.
    fn next(&self, session: &mut Session) -> Option<Option<Packet>> {
        let publisher = self.source.publisher;
        if !session.is_born {
            session.is_born = true;
            let topic = format_args!("{}/{}/status", publisher.topic, publisher.name);
            return Some(mqtt::publish(&self.message(topic, true, &[]), |out| out.write_str("online")));
        }
        self.answer(session)
            .or_else(|| self.announcement(session))
            .or_else(|| self.alarm(session))
            .or_else(|| self.value(session))
    }

    fn answer(&self, session: &mut Session) -> Option<Option<Packet>> {
        let answer = session.answers.pop_front()?;
        let (prefix, reply) = (&self.source.publisher.topic, &answer.reply);
        // Only version 5 has response topics.
        let message =
            |topic| mqtt::publish(&self.message(topic, false, &reply.correlation), |out| answer.write(out));
        Some(match reply.topic.as_str() {
            "" => message(format_args!("{prefix}/points/{}/result", answer.point)),
            topic => message(format_args!("{topic}")),
        })
    }

    fn announcement(&self, session: &mut Session) -> Option<Option<Packet>> {
        if self.source.publisher.format != Format::HomeAssistant {
            return None;
        }
        self.source.gateway.settings(|settings| {
            loop {
                let at = session.announced;
                session.announced = behind(settings, at)?;
                if let Some(announced) = Announced::new(self.source.publisher, settings, at) {
                    let topic = announced.topic();
                    let make =
                        |topic| mqtt::publish(&self.message(topic, true, &[]), |out| announced.write(out));
                    return Some(make(format_args!("{topic}")));
                }
            }
        })
    }

    fn alarm(&self, session: &mut Session) -> Option<Option<Packet>> {
        let gateway = self.source.gateway;
        // Most often there is no line at all.
        let last = gateway.last_audit();
        if last == session.alarm {
            return None;
        }
        let Some(line) = gateway.next_audit(session.alarm, Topic::Unit) else {
            session.alarm = last;
            return None;
        };
        session.alarm = line.number;
        let topic = format_args!("{}/alarms", self.source.publisher.topic);
        Some(mqtt::publish(&self.message(topic, false, &[]), |out| self.source.write_alarm(&line, out)))
    }

    /// The next marked point, each in its turn.
    fn value(&self, session: &mut Session) -> Option<Option<Packet>> {
        let (gateway, now) = (self.source.gateway, Instant::now());
        let scanner = gateway.scanner()?;
        let count = session.marks.len();
        for step in 0..count {
            let nth = (session.turn + step) % count;
            let Some(mark) = session.marks.get_mut(nth).filter(|mark| mark.waits) else { continue };
            let id = RowId(nth as u8);
            let made = gateway.settings(|settings| {
                let point = settings.points.get(nth)?;
                let topic = format_args!("{}/points/{}", self.source.publisher.topic, point.name);
                let message = self.message(topic, true, &[]);
                // Value, quality and time are those of one time.
                scanner.with(|scanner| {
                    let sample = sample(scanner, id, now)?;
                    mark.sent(&sample, now);
                    let cells = scanner.input(id);
                    Some(mqtt::publish(&message, |out| self.source.write_value(point, cells, &sample, out)))
                })
            });
            if made.is_some() {
                session.turn = nth + 1;
                return made;
            }
        }
        None
    }
}
