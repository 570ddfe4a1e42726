//! Begins an export of the capture, with the names of the gateway's ports.

use embedded_io_async::Write;

use super::Gateway;
use crate::capture::Export;
use crate::settings::{Name, PortId};

impl<'g> Gateway<'g> {
    /// Begins a PCAPNG file: writes its start, with each port as an interface. `None` on a board without capture.
    ///
    /// # Errors
    /// Those of `out`.
    pub async fn export<W: Write>(&self, out: &mut W) -> Result<Option<Export<'g>>, W::Error> {
        let Some(capture) = self.capture() else { return Ok(None) };
        let name = |port| self.settings(|settings| Name::try_from(settings.name(PortId(port as u8))));
        let names = (0..self.ports().len()).map(|port| name(port).unwrap_or_default());
        Export::begin(capture, names, out).await.map(Some)
    }
}
