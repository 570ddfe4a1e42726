//! Stub of the resolver, for images without server names.

use core::net::Ipv4Addr;

use embassy_net::Stack;
use mobgate::hal::{OpenError, OpenErrorKind};

/// Always fails.
pub(crate) async fn look_up(_: Stack<'static>, _: &str) -> Result<Ipv4Addr, OpenError> {
    Err(OpenError::new(OpenErrorKind::Unsupported, ""))
}
