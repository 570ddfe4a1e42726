//! What stands for the scanner's port in a gateway that asks nothing by itself: without the feature `points`.

use crate::fieldbus::EthercatPlace;
use crate::gateway::{Gateway, PortPlace};
use crate::settings::PortId;

/// There is nothing to ask for. Settings with such a port are refused before.
pub(crate) fn run(
    _: &Gateway<'_>,
    place: &PortPlace,
    _: PortId,
    ethercat: Option<&EthercatPlace>,
) -> impl Future<Output = ()> {
    ethercat.into_iter().for_each(|ethercat| _ = place.set_status(ethercat.controller().into()));
    place.changed.wait()
}
