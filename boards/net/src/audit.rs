//! What a board with an audit trail runs for it.

use embassy_futures::join::join3;
use mobgate::gateway::Gateway;

use crate::pool::Sockets;
use crate::sntp;
use crate::syslog::SyslogSockets;

/// What a board with an audit trail runs beside its sockets: counted refusals get their lines, the trail goes to a syslog server, and an
/// NTP server tells the time. In one task with [`mdns::run`](crate::mdns::run): the stack wakes one task when the link changes. Never returns.
pub async fn follow_audit(gateway: &'static Gateway<'static>, sockets: &'static Sockets) {
    let mut syslog = SyslogSockets::new(gateway, sockets);
    let time = sntp::run(gateway, sockets.stack());
    join3(gateway.settle_audits(), gateway.forward_audit(&mut syslog), time).await;
}
