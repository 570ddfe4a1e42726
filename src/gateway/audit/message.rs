//! Lines of the audit trail as messages of RFC 5424: pure.

use core::fmt::{self, Display, Write};

use heapless::String;

use super::line::{AUDIT_BYTES_MAX, AuditLine};
use super::stamp::Stamp;
use crate::hal::SyslogLink;
use crate::settings::HOST_NAME_BYTES_MAX;

/// Facility of an audit trail: "log audit" (RFC 5424, table 1).
const FACILITY: u8 = 13;
/// Severities (RFC 5424, table 2).
const WARNING: u8 = 4;
const NOTICE: u8 = 5;
/// Longest HOSTNAME: those of boards are shorter.
const HOST_NAME_MAX: usize = if cfg!(feature = "paths") { 255 } else { HOST_NAME_BYTES_MAX };
/// Longest header besides: priority and version, date, APP-NAME, PROCID, MSGID and the structured data.
const HEADER_BYTES_MAX: usize = 7 + 28 + 8 + 11 + 15 + 34;

/// Longest message in bytes.
pub const MESSAGE_BYTES_MAX: usize = HEADER_BYTES_MAX + HOST_NAME_MAX + AUDIT_BYTES_MAX;

pub(crate) type Message = String<MESSAGE_BYTES_MAX>;

/// A line of the trail as a message. The number of the line is its `sequenceId` (RFC 5424, 7.3.1).
pub(crate) fn message(link: &impl SyslogLink, line: &AuditLine) -> Message {
    let severity = if line.topic.is_refusal() { WARNING } else { NOTICE };
    let data = format_args!("[meta sequenceId=\"{}\"]", line.number);
    let text = format_args!("{}: {}", line.actor(), line.what());
    with_header(link, line, severity, line.topic.name(), &data, &text)
}

/// The message that so many lines before `line` were lost.
pub(crate) fn loss(link: &impl SyslogLink, line: &AuditLine, lost: u32) -> Message {
    let text = format_args!("gateway: {lost} lines before this one were lost");
    with_header(link, line, WARNING, "lost", &"-", &text)
}

fn with_header(
    link: &impl SyslogLink,
    line: &AuditLine,
    severity: u8,
    id: &str,
    data: &dyn Display,
    text: &dyn Display,
) -> Message {
    let mut message = Message::new();
    // It fits.
    let _ = write_header(link, line, severity, &mut message)
        .and_then(|()| write!(message, " {id} {data} {text}"));
    message
}

fn write_header(
    link: &impl SyslogLink,
    line: &AuditLine,
    severity: u8,
    message: &mut Message,
) -> fmt::Result {
    write!(message, "<{}>1 ", 8 * FACILITY + severity)?;
    match line.stamp {
        Stamp::Date(date) => write!(message, "{date:.6}"),
        // RFC 5424, 6.2.3: a sender that does not know the time.
        Stamp::Up(at) => link.write_date(at, message).unwrap_or_else(|| message.write_char('-')),
    }?;
    message.write_char(' ')?;
    let before = message.len();
    link.write_host_name(message)?;
    message.truncate(message.len().min(before + HOST_NAME_MAX));
    if message.len() == before {
        message.write_char('-')?;
    }
    message.write_str(" mobgate ")?;
    match link.process() {
        Some(process) => write!(message, "{process}"),
        None => message.write_char('-'),
    }
}
