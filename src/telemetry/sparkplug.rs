//! Sparkplug B 3.0: the gateway as an edge node. Its metrics are the values of all points; they are told at once in a birth certificate,
//! then as they change. The broker publishes the death certificate when the connection breaks.
//!
//! Messages are sent at most once, as the specification wants it, and are numbered: a host that has missed one asks for another birth.

use core::fmt;

use embassy_time::Instant;
use embedded_io_async::Write;
use heapless::vec::VecView;

use super::link::{failed, send};
use super::mark::{Sample, sample};
use super::session::Session;
use super::source::Source;
use crate::hal::OpenError;
use crate::mqtt::sparkplug::{BD_SEQ, DataType, Metric, REBIRTH, SEQ_BYTES_MAX, Value};
use crate::mqtt::{self, Accepted, LongPacket, Message, Packet, Qos, Writer};
use crate::scanner::RowId;
use crate::settings::PointSettings;

const TOO_LONG: OpenError = failed("Sparkplug: all points do not fit in one message");
const NO_TIME: OpenError = failed("Sparkplug: the time of day is not known");
const NAME_TAKEN: OpenError = failed("Sparkplug: no point may have the name bdSeq");

/// What is done with the value of a point that was written; `None`: it is still being written to the device.
type Told<'t> = &'t mut dyn FnMut(usize, Option<&Sample>);

/// The time of a message, as the gateway's clock and as milliseconds since 1970.
#[derive(Clone, Copy)]
struct Now {
    at: Instant,
    date: u64,
}

impl Source<'_, '_> {
    /// The topic of the node's messages of this type (4.1).
    pub(super) fn topic(&self, kind: &'static str) -> impl fmt::Display {
        fmt::from_fn(move |f| write!(f, "spBv1.0/{}/{kind}/{}", self.publisher.topic, self.publisher.name))
    }

    fn milliseconds(&self, at: Instant) -> Option<u64> {
        Some(self.date(at)?.0 / 1_000)
    }

    fn now(&self) -> Result<Now, OpenError> {
        let at = Instant::now();
        self.milliseconds(at).map(|date| Now { at, date }).ok_or(NO_TIME)
    }

    fn publish_into(
        &self,
        packet: &mut VecView<u8>,
        kind: &'static str,
        write: impl FnOnce(&mut Writer<'_>),
    ) -> Result<(), OpenError> {
        let (version, topic) = (self.publisher.version, self.topic(kind));
        let topic = format_args!("{topic}");
        let message = Message { version, qos: Qos::Once, retained: false, topic, correlation: &[] };
        let fits = mqtt::publish_into(packet, &message, |out| {
            write(out);
            Ok(())
        });
        if fits { Ok(()) } else { Err(TOO_LONG) }
    }

    /// The death certificate of a node that leaves by itself (5.5): the same as the broker's.
    pub(super) fn death(&self) -> Result<Packet, OpenError> {
        let mut packet = Packet::new();
        self.publish_into(&mut packet, "NDEATH", |out| self.write_bd_seq(None, out))?;
        Ok(packet)
    }

    /// The payload of the death certificate (6.4.25). It has no time: the broker sends it later.
    pub(super) fn write_death(&self, out: &mut Writer<'_>) -> fmt::Result {
        self.write_bd_seq(None, out);
        Ok(())
    }

    fn write_bd_seq(&self, timestamp: Option<u64>, out: &mut Writer<'_>) {
        let (kind, value) = (Some(DataType::Int64), Some(Value::Long(self.bd_seq.get().into())));
        out.metric(&Metric { name: &BD_SEQ, timestamp, kind, quality: None, value });
    }

    /// Whether a birth certificate can be made. A host must not hear of a node that never comes.
    pub(super) fn fits(&self) -> Result<(), OpenError> {
        if self.gateway.settings(|settings| settings.find_point(BD_SEQ).is_some()) {
            return Err(NAME_TAKEN);
        }
        self.birth(&mut LongPacket::new(), &mut |_, _| {})
    }

    /// Makes a birth certificate (6.4.19): its number is 0.
    fn birth(&self, packet: &mut LongPacket, told: Told<'_>) -> Result<(), OpenError> {
        let now = self.now()?;
        self.publish_into(packet, "NBIRTH", |out| {
            out.timestamp(now.date);
            self.write_bd_seq(Some(now.date), out);
            let (kind, value) = (Some(DataType::Boolean), Some(Value::Boolean(false)));
            out.metric(&Metric { name: &REBIRTH, timestamp: Some(now.date), kind, quality: None, value });
            self.gateway.settings(|settings| {
                for (nth, point) in settings.points.iter().enumerate() {
                    told(nth, self.write_row(point, nth, now, true, out).as_ref());
                }
            });
            out.seq(0);
        })
    }

    /// Writes the values of point `nth` and returns what is known of them; in a birth certificate also what is still being written.
    fn write_row(
        &self,
        point: &PointSettings,
        nth: usize,
        now: Now,
        is_birth: bool,
        out: &mut Writer<'_>,
    ) -> Option<Sample> {
        let id = RowId(nth as u8);
        // Value, quality and time are those of one time.
        self.gateway.scanner()?.with(|scanner| {
            let sample = sample(scanner, id, now.at);
            if sample.is_some() || is_birth {
                let read = sample.and_then(|sample| self.milliseconds(sample.read?));
                let time = read.unwrap_or(now.date);
                super::metrics::write(point, scanner.input(id), sample.as_ref(), time, is_birth, out);
            }
            sample
        })
    }

    /// Makes a message of the points that are marked, as many as it has room for (6.4.21); `false`: there are none.
    fn data(&self, session: &mut Session, packet: &mut LongPacket) -> Result<bool, OpenError> {
        let Session { marks, turn, seq, .. } = session;
        if !marks.iter().any(|mark| mark.waits) {
            return Ok(false);
        }
        let (now, count) = (self.now()?, marks.len());
        let (mut is_empty, mut is_full) = (true, false);
        self.publish_into(packet, "NDATA", |out| {
            out.timestamp(now.date);
            self.gateway.settings(|settings| {
                for step in 0..count {
                    let nth = (*turn + step) % count;
                    let Some(mark) = marks.get_mut(nth).filter(|mark| mark.waits) else { continue };
                    let Some(point) = settings.points.get(nth) else { continue };
                    let mut sample = None;
                    let write = |out: &mut Writer<'_>| sample = self.write_row(point, nth, now, false, out);
                    if !out.attempt(SEQ_BYTES_MAX, write) {
                        (is_full, *turn) = (true, nth);
                        break;
                    }
                    if let Some(sample) = sample {
                        mark.sent(&sample, now.at);
                        is_empty = false;
                    }
                }
            });
            out.seq(*seq);
        })?;
        match is_empty {
            true if is_full => Err(TOO_LONG),
            true => Ok(false),
            false => {
                *seq = seq.wrapping_add(1);
                Ok(true)
            }
        }
    }

    /// Sends a birth certificate if one is due, or else what has changed.
    pub(super) async fn send_metrics(
        &self,
        stream: &mut impl Write,
        accepted: &Accepted,
        session: &mut Session,
    ) -> Result<bool, OpenError> {
        self.log_answers(session);
        let mut packet = LongPacket::new();
        if !session.is_born {
            let (now, marks) = (Instant::now(), &mut session.marks);
            self.birth(&mut packet, &mut |nth, sample| match (marks.get_mut(nth), sample) {
                (Some(mark), Some(sample)) => mark.sent(sample, now),
                (Some(mark), None) => mark.waits = true,
                (None, _) => {}
            })?;
            (session.is_born, session.seq) = (true, 1);
        } else if !self.data(session, &mut packet)? {
            return Ok(false);
        }
        if packet.len() > accepted.packet_max as usize {
            return Err(TOO_LONG);
        }
        send(stream, &packet).await?;
        self.state.report(|report| report.sent = report.sent.wrapping_add(1));
        Ok(true)
    }
}
