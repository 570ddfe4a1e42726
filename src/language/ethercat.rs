//! The keywords of an EtherCAT port.

use super::listed::{joined, keywords};
use super::port_keys::Keywords;
use crate::scanner::POINTS;
// As the word.
#[cfg(feature = "files")]
use crate::settings::FileRights;
use crate::settings::{Key, OnLoss};

keywords!(pub(crate) ON_LOSS: OnLoss { "hold": Hold, "clear": Clear, "stop": Stop });
#[cfg(feature = "files")]
keywords!(pub(crate) FILES: FileRights { "off": Off, "read": Read, "write": Write });

/// Those of its line, in printing order, with their list for errors; none where there is no EtherCAT.
pub(super) const ETHERCAT: Keywords = if POINTS { WITH_CONTROLLER } else { (&[], "") };
const WITH_CONTROLLER: Keywords = (
    &[
        ("interface", Key::Interface),
        ("line", Key::Line),
        ("on-loss", Key::OnLoss),
        ("id", Key::Id),
        ("modules", Key::Modules(true)),
        ("no-modules", Key::Modules(false)),
        ("emergencies", Key::Emergencies(true)),
        ("no-emergencies", Key::Emergencies(false)),
        ("prove-outputs", Key::ProveOutputs(true)),
        ("no-prove-outputs", Key::ProveOutputs(false)),
        #[cfg(feature = "files")]
        ("files", Key::Files),
        #[cfg(feature = "eoe")]
        ("ethernet", Key::Ethernet),
    ],
    joined!(&[
        "interface, line, on-loss, id, modules, emergencies",
        #[cfg(feature = "files")]
        ", files",
        #[cfg(feature = "eoe")]
        ", ethernet",
        " or prove-outputs",
    ]),
);
