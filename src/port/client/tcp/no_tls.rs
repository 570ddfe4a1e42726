//! Stands in for TLS without the feature `tls`.

use super::ConnectionTask;
use crate::hal::{OpenError, TcpConnect};
use crate::settings::ServerAddress;

impl<C: TcpConnect> ConnectionTask<'_, '_, C> {
    /// Opens a connection to the server at `address`.
    pub(super) fn open(
        &self,
        address: &ServerAddress,
    ) -> impl Future<Output = Result<C::Stream<'_>, OpenError>> {
        self.connector.connect(address)
    }
}
