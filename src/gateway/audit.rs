//! The audit trail: who changed what, from where, when, and what was refused.
//!
//! A line is logged, so that it reaches the journal of a host, and kept in memory for `show audit` and for a syslog server. What others
//! can cause at will is counted when it repeats: a line tells the number once an interval. No line has a secret, nor a text that was
//! not understood, which may be a password typed at the wrong prompt.

mod line;
mod memory;
// Images without a trail send nothing.
#[cfg(feature = "audit")]
mod message;
mod ring;
mod stamp;
pub(super) mod state;
mod topic;
mod trail;

use core::fmt::{self, Write};
use core::net::IpAddr;

use embassy_futures::select::select;
use embassy_time::{Instant, Timer};
use heapless::String;

pub use self::line::{AUDIT_BYTES_MAX, AuditLine};
pub use self::memory::AuditMemory;
use self::memory::Rings;
#[cfg(feature = "audit")]
pub use self::message::MESSAGE_BYTES_MAX;
#[cfg(feature = "audit")]
pub(crate) use self::message::{loss, message};
pub use self::stamp::Stamp;
pub use self::state::Forwarding;
pub(crate) use self::topic::Way;
pub use self::topic::{Actor, Topic};
pub use self::trail::COUNTED_FOR;
use self::trail::{Tally, Trail};
use super::Gateway;
use crate::settings::{AUDIT, PortId, Time, canonical};

/// What a line ends in if it is too long.
const CUT: &str = "...";

/// The text of a line: without control characters, which could forge another line or command a terminal.
struct Text(String<AUDIT_BYTES_MAX>);

impl Text {
    fn of(actor: Actor<'_>, what: fmt::Arguments<'_>) -> Self {
        let mut text = Self(String::new());
        let written = write!(text, "{actor}").and_then(|()| {
            // The only tab.
            let _ = text.0.push('\t');
            text.write_fmt(what)
        });
        if written.is_err() {
            while text.0.push_str(CUT).is_err() && text.0.pop().is_some() {}
        }
        text
    }
}

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut visible = text.chars().map(|char| if char.is_control() { ' ' } else { char });
        visible.try_for_each(|char| self.0.push(char).map_err(|_| fmt::Error))
    }
}

impl<'g> Gateway<'g> {
    /// Adds an audit trail, which needs its own memory. Without it, nothing is recorded.
    #[must_use]
    pub const fn with_audit(mut self, memory: &'g AuditMemory) -> Self {
        self.audit_memory = Some(memory);
        self
    }

    /// The trail, if the board has memory for it.
    fn trail<R>(&self, f: impl FnOnce(&mut Trail, &Rings) -> R) -> Option<R> {
        let (audit, memory) = (self.audit.first()?, self.audit_memory?);
        Some(audit.trail.lock(|trail| memory.rings(|rings| f(&mut trail.borrow_mut(), rings))))
    }
}

impl Gateway<'_> {
    /// Takes over the lines of before a reset, and writes why this run began, and how the last one ended if it has said so. For boards
    /// that keep the trail's memory over a reset, before any other line.
    #[inline]
    pub fn audit_start(&self, cause: &str, last_words: Option<&str>) {
        if !AUDIT {
            return;
        }
        self.resume_audit();
        let version = env!("CARGO_PKG_VERSION");
        self.audit(Topic::Start, Actor::System, format_args!("start of mobgate {version}, {cause}"));
        if let Some(words) = last_words {
            self.audit(Topic::Start, Actor::System, format_args!("the last run ended: {words}"));
        }
    }

    fn resume_audit(&self) {
        let resumed = self.trail(|trail, rings| {
            trail.resume(rings);
            rings.sent.get()
        });
        if let Some(sent) = resumed {
            self.change_forwarding(|forwarding| forwarding.sent = sent);
        }
    }

    /// Gives the lines of this run their dates.
    pub(super) fn date_audit(&self) {
        self.trail(|trail, rings| {
            rings.restamp(trail.earlier() + 1, |stamp| match stamp {
                Stamp::Up(at) => self.stamp(at),
                date @ Stamp::Date(_) => date,
            });
        });
    }

    /// Writes a line: `what` was done by `actor`.
    #[inline]
    pub fn audit(&self, topic: Topic, actor: Actor<'_>, what: fmt::Arguments<'_>) {
        if AUDIT {
            self.settle_audit();
            self.write_audit(topic, actor, what);
        } else if actor == Actor::Ethercat {
            // Without a trail; what is not done at the console is logged.
            log_info!("EtherCAT: {what}");
        }
    }

    fn write_audit(&self, topic: Topic, actor: Actor<'_>, what: fmt::Arguments<'_>) {
        let text = Text::of(actor, what);
        let stamp = self.stamp(Instant::now());
        self.trail(|trail, rings| trail.push(rings, stamp, topic, &text.0));
        self.audit.iter().for_each(|audit| audit.line.signal(()));
        let (actor, what) = text.0.split_once('\t').unwrap_or_default();
        if topic.is_refusal() {
            log_warn!("audit: {actor}: {what}")
        } else {
            log_info!("audit: {actor}: {what}")
        }
    }

    /// Writes a line about a refused `peer`, or only counts it after several refusals; `port` is named after `what`.
    #[inline]
    pub fn audit_refusal(
        &self,
        topic: Topic,
        port: Option<PortId>,
        peer: Option<IpAddr>,
        what: fmt::Arguments<'_>,
    ) {
        let Some(audit) = self.audit.first() else { return };
        self.settle_audit();
        let is_told = self.trail(|trail, _| trail.refused(Instant::now(), topic, port, peer));
        audit.refusal.signal(());
        if is_told == Some(true) {
            let actor = peer.map_or(Actor::Gateway, |peer| Actor::Peer(canonical(peer)));
            self.at_port(port, &mut |at| self.write_audit(topic, actor, format_args!("{what}{at}")));
        }
    }

    /// Writes the counts of refusals whose interval has ended.
    #[doc(hidden)] // Public for tests/ only.
    pub fn settle_audit(&self) {
        while let Some(Some(tally)) = self.trail(|trail, _| trail.due(Instant::now())) {
            let Tally { topic, port, counted, last, .. } = tally;
            self.at_port(port, &mut |at| {
                let (plural, time) = (topic.plural(), Time(COUNTED_FOR));
                let actor = last.map_or(Actor::Gateway, |peer| Actor::Peer(canonical(peer)));
                self.write_audit(topic, actor, format_args!("{counted} more {plural}{at} within {time}"));
            });
        }
    }

    /// Calls `f` with where an event happened: a port, or nothing.
    fn at_port(&self, port: Option<PortId>, f: &mut dyn FnMut(&dyn fmt::Display)) {
        match port {
            Some(port) => self.settings(|settings| f(&format_args!(" at port {}", settings.name(port)))),
            None => f(&""),
        }
    }

    /// Records that `unit` of `port` has gone down or `is_up` again.
    pub(crate) fn audit_unit(&self, port: PortId, unit: u8, is_up: bool) {
        let what = if is_up { "responds again" } else { "is down" };
        self.audit_refusal(Topic::Unit, Some(port), None, format_args!("unit {unit} {what}"));
    }

    /// Line `nth` of the trail, oldest first.
    #[doc(hidden)] // Public for tests/ only.
    pub fn audit_line(&self, nth: usize) -> Option<AuditLine> {
        self.trail(|_, rings| rings.entries().nth(nth).map(|entry| rings.line(entry)))?
    }

    /// The number of the last line; 0 if there is none.
    #[cfg(feature = "mqtt")] // As what asks; also below.
    pub(crate) fn last_audit(&self) -> u32 {
        self.trail(|trail, _| trail.last()).unwrap_or(0)
    }

    /// The first line behind number `after` that is about `topic`.
    #[cfg(feature = "mqtt")]
    pub(crate) fn next_audit(&self, after: u32, topic: Topic) -> Option<AuditLine> {
        self.trail(|_, rings| {
            let next = rings.entries().find(|entry| entry.number > after && entry.topic == topic)?;
            Some(rings.line(next))
        })?
    }

    /// The number of the last line of earlier runs; 0 if there is none.
    #[cfg(feature = "audit")] // As the command that asks.
    pub(crate) fn earlier_audit(&self) -> u32 {
        self.trail(|trail, _| trail.earlier()).unwrap_or(0)
    }

    /// Writes the lines of counted refusals when they are due, forever. A board with a trail runs it once.
    pub async fn settle_audits(&self) {
        let Some(audit) = self.audit.first() else { return };
        loop {
            self.settle_audit();
            match self.trail(|trail, _| trail.next_due()).flatten() {
                None => audit.refusal.wait().await,
                Some(due) => _ = select(audit.refusal.wait(), Timer::at(due)).await,
            }
        }
    }
}

/// For one task, which forwards the trail to a syslog server. The rings are its queue.
impl Gateway<'_> {
    /// Waits for the next line to send, and returns it with the number of lines before it that were pushed out meanwhile.
    #[cfg(feature = "audit")] // As the task that sends; also below.
    pub(crate) async fn unsent_audit(&self) -> (AuditLine, u32) {
        let Some(audit) = self.audit.first() else { return core::future::pending().await };
        loop {
            let sent = self.forwarding().sent;
            let next = |rings: &Rings| Some(rings.line(rings.entries().find(|entry| entry.number > sent)?));
            if let Some(Some(line)) = self.trail(|_, rings| next(rings)) {
                let lost = line.number - sent - 1;
                return (line, lost);
            }
            audit.line.wait().await;
        }
    }

    /// Whether all lines were sent.
    pub fn is_audit_sent(&self) -> bool {
        self.trail(|trail, _| trail.last()).is_none_or(|last| last == self.forwarding().sent)
    }

    /// How forwarding does.
    pub fn forwarding(&self) -> Forwarding {
        let mut now = Forwarding::NONE;
        self.change_forwarding(|forwarding| now = *forwarding);
        now
    }

    /// Calls `change` with the state of forwarding.
    pub(crate) fn change_forwarding(&self, change: impl FnOnce(&mut Forwarding)) {
        if let Some(audit) = self.audit.first() {
            let sent = audit.forwarding.lock(|forwarding| {
                let mut forwarding = forwarding.borrow_mut();
                change(&mut forwarding);
                forwarding.sent
            });
            self.trail(|_, rings| rings.sent.set(sent));
        }
    }

    /// Waits until the settings name another syslog server, or none.
    #[cfg(feature = "audit")]
    pub(crate) async fn new_syslog(&self) {
        match self.audit.first() {
            Some(audit) => audit.server_changed.wait().await,
            None => core::future::pending().await,
        }
    }
}
