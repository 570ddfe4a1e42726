//! Stands in for the scanner's port without the feature `points`.

use crate::fieldbus::EthercatState;
use crate::gateway::{Gateway, PortState};
use crate::settings::PortId;

/// Never used: settings with such a port are refused.
pub(crate) fn run(
    _: &Gateway<'_>,
    port_state: &PortState,
    _: PortId,
    ethercat: Option<&EthercatState>,
) -> impl Future<Output = ()> {
    ethercat.into_iter().for_each(|ethercat| _ = port_state.set_status(ethercat.controller().into()));
    port_state.changed.wait()
}
