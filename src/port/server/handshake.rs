//! TLS with a client that has connected: the board shakes hands, and tells the role in the client's certificate.

use core::net::IpAddr;
use core::pin::pin;

use embassy_time::Duration;

use super::listening;
use crate::gateway::Gateway;
use crate::hal::{OpenError, TcpStream};
use crate::port::timer::within;
use crate::settings::{ClientRole, PortId};

/// A client that has not completed the handshake by then is disconnected. It occupies none of the port's connections, but the task that
/// accepts new ones.
const HANDSHAKE_MAX: Duration = Duration::from_secs(5);

/// Why there is no handshake.
pub(crate) enum Unsecured {
    /// TLS cannot be agreed on, or a certificate is not accepted; the audit trail says why.
    Refused,
    /// The client was too slow.
    Stalled,
}

/// Begins TLS with the client at `peer` of the server `id`.
pub(crate) async fn handshake(
    gateway: &Gateway<'_>,
    id: PortId,
    stream: &mut impl TcpStream,
    peer: IpAddr,
) -> Result<ClientRole, Unsecured> {
    match within(HANDSHAKE_MAX, pin!(stream.secure(id, None))).await {
        Some(Ok(role)) => Ok(role),
        Some(Err(OpenError { hint, .. })) => {
            listening::refuses_certificate(gateway, id, peer, hint);
            Err(Unsecured::Refused)
        }
        None => Err(Unsecured::Stalled),
    }
}
