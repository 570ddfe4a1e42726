//! Layout of the Modbus devices' values in the buffers: by device, then by table, without gaps.

use super::config_error::ConfigError;
use super::room::Room;
use crate::scanner::Kind;
use crate::settings::{Cells, SlaveSettings};

/// Addresses of a table: 0 to 65535.
const ADDRESSES: u32 = 65_536;

/// Layout of one device's values: the entries of 2011h to 2014h, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DeviceLayout(pub [u16; 10]);

impl DeviceLayout {
    /// Start of the values read from `kind` in the input buffer.
    pub const fn input(&self, kind: Kind) -> u16 {
        let [_, coils, switches, in_registers, out_registers, ..] = self.0;
        match kind {
            Kind::Coil => coils,
            Kind::Discrete => switches,
            Kind::Input => in_registers,
            Kind::Holding => out_registers,
        }
    }

    /// Start of the values written to `kind` in the output buffer; `None` for read-only tables.
    pub const fn output(&self, kind: Kind) -> Option<u16> {
        let [.., coils, out_registers, _] = self.0;
        match kind {
            Kind::Coil => Some(coils),
            Kind::Holding => Some(out_registers),
            Kind::Discrete | Kind::Input => None,
        }
    }
}

/// Start of the next device's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Start {
    /// Number of devices before it.
    pub(super) nth: u8,
    input: u32,
    output: u32,
}

impl Start {
    /// The layout of `slave`, the next device, within the `room` for images.
    pub(super) fn lay_out(&mut self, slave: &SlaveSettings, room: Room) -> Result<DeviceLayout, ConfigError> {
        let nth = self.nth;
        for (kind, Cells { count, address }) in slave.tables() {
            if u32::from(address) + u32::from(count) > ADDRESSES {
                return Err(ConfigError::PastLastAddress { slave: nth, kind });
            }
            if !count.is_multiple_of(slave.value_type(kind).registers()) {
                return Err(ConfigError::HalfValue { slave: nth, kind });
            }
        }
        let mut places = [0; 10];
        let mut entries = places.iter_mut();
        let bytes = |(kind, cells): (Kind, Cells)| u32::from(kind.bytes(cells.count));
        let outputs = slave.tables().filter(|(kind, _)| kind.is_writable());
        self.input = place(&mut entries, self.input, slave.tables().map(bytes), room.inputs)
            .ok_or(ConfigError::InputsFull { slave: nth, room: room.inputs })?;
        self.output = place(&mut entries, self.output, outputs.map(bytes), room.outputs)
            .ok_or(ConfigError::OutputsFull { slave: nth, room: room.outputs })?;
        self.nth = nth.saturating_add(1);
        Ok(DeviceLayout(places))
    }
}

/// The layouts of `slaves` in order, within the `room` for images.
pub(super) fn layouts(
    slaves: &[SlaveSettings],
    room: Room,
) -> impl Iterator<Item = Result<DeviceLayout, ConfigError>> {
    let mut next = Start::default();
    slaves.iter().map(move |slave| next.lay_out(slave, room))
}

/// Writes the start, the start of each table, and the last byte used; returns the end, unless it exceeds the `room`.
fn place<'e>(
    entries: &mut impl Iterator<Item = &'e mut u16>,
    start: u32,
    kinds: impl Iterator<Item = u32>,
    room: u16,
) -> Option<u32> {
    let mut put = |value: u32| {
        if let Some(entry) = entries.next() {
            *entry = value as u16;
        }
    };
    put(start);
    let mut end = start;
    for bytes in kinds {
        put(end);
        end += bytes;
        if end > u32::from(room) {
            return None;
        }
    }
    put(end.saturating_sub(1).max(start));
    Some(end)
}
