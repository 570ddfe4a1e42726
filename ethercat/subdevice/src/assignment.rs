//! The PDOs that a SyncManager carries.

use core::ops::Range;

use crate::device::Device;
use crate::object::{PDOS_ASSIGNED_MAX, PDOS_SELECTED_MAX};
use crate::sync_manager::Channel;

/// The PDOs of one SyncManager, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Assignment {
    channel: Channel,
    pub(crate) pdos: Pdos,
    /// Limit of their total bytes.
    pub(crate) room: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pdos {
    /// The first `count` of a list.
    Listed { count: u8, pdos: [u16; PDOS_SELECTED_MAX] },
    /// The application's: `first + n` for each bit n that is set, with a total of `bytes`.
    Modules { first: u16, present: u64, bytes: u16 },
}

impl Pdos {
    pub(crate) fn listed(indices: impl Iterator<Item = u16>) -> Self {
        let (mut pdos, mut count) = ([0; PDOS_SELECTED_MAX], 0);
        for (pdo, index) in pdos.iter_mut().zip(indices) {
            (*pdo, count) = (index, count + 1);
        }
        Self::Listed { count, pdos }
    }

    /// The places in the list, or bits, that may have one.
    fn places(&self) -> Range<u16> {
        match self {
            Self::Listed { count, .. } => 0..u16::from(*count),
            Self::Modules { present, .. } => 0..(u64::BITS - present.leading_zeros()) as u16,
        }
    }

    /// The PDO at one of the [`places`](Self::places). By reference: this runs several times a cycle.
    fn at(&self, place: u16) -> Option<u16> {
        match self {
            Self::Listed { pdos, .. } => pdos.get(usize::from(place)).copied(),
            Self::Modules { first, present, .. } => {
                (present.unbounded_shr(place.into()) & 1 == 1).then(|| first.wrapping_add(place))
            }
        }
    }
}

impl Assignment {
    /// The assignment of module PDOs, in index order: `first + n` for each bit n of `present`, limited to the first
    /// [`PDOS_ASSIGNED_MAX`], with a total of `bytes`.
    pub fn of_modules(channel: Channel, first: u16, present: u64, bytes: u16) -> Self {
        let present = present & ((1 << PDOS_ASSIGNED_MAX) - 1);
        Self { channel, pdos: Pdos::Modules { first, present, bytes }, room: u16::MAX }
    }

    pub(crate) fn of_device(device: &Device, channel: Channel) -> Self {
        let pdos = Pdos::listed(device.default_pdos(channel).iter().copied());
        Self { channel, pdos, room: device.bytes_max(channel) }
    }

    /// The SyncManager that carries them.
    pub fn channel(&self) -> Channel {
        self.channel
    }

    /// The indices of the assigned PDOs.
    pub fn indices(&self) -> impl Iterator<Item = u16> + use<> {
        let pdos = self.pdos;
        pdos.places().filter_map(move |place| pdos.at(place))
    }

    /// The value at a sub-index.
    pub fn value(&self, sub: u8) -> u16 {
        match (sub.checked_sub(1), &self.pdos) {
            (None, _) => self.indices().count() as u16,
            // Also an entry above the count, while the list is being written.
            (Some(at), Pdos::Listed { pdos, .. }) => pdos.get(usize::from(at)).copied().unwrap_or_default(),
            (Some(at), _) => self.indices().nth(at.into()).unwrap_or_default(),
        }
    }
}
