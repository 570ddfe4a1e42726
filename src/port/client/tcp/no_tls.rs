//! Stands in for TLS without the feature `tls`.

use core::future::{Ready, ready};

use crate::hal::{OpenError, TcpStream};
use crate::port::client::dispatcher::Dispatcher;
use crate::settings::{ServerAddress, TcpClientSettings};

/// No settings have such a port.
pub(super) fn secure<S: TcpStream>(
    _: &Dispatcher<'_>,
    _: &TcpClientSettings,
    _: &mut S,
    _: &ServerAddress,
) -> Ready<Result<(), OpenError>> {
    ready(Ok(()))
}
