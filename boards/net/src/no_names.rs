//! What stands for look-ups where settings have no names.

use core::net::Ipv4Addr;

use embassy_net::Stack;
use mobgate::hal::{OpenError, OpenErrorKind};

/// There is no address: there are no names either.
pub(crate) async fn look_up(_: Stack<'static>, _: &str) -> Result<Ipv4Addr, OpenError> {
    Err(OpenError::new(OpenErrorKind::Unsupported, ""))
}
