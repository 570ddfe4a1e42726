//! Where the values of the Modbus devices lie in the buffers: device after device, kind after kind, without gaps.

use super::configuration::ConfigError;
use super::objects::{IMAGE_BYTES, MODBUS_DEVICES_MAX};
use crate::scanner::Kind;

/// Addresses of a kind: 0 to 65535.
const ADDRESSES: u32 = 65_536;

/// How many values of a kind, from which address on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KindSettings {
    /// How many.
    pub count: u16,
    /// The first one's address on the wire.
    pub address: u16,
}

/// One Modbus device, as it is configured (2001h to 2004h).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceSettings {
    /// Its unit id.
    pub id: u16,
    /// Its values, in the order of [`Kind::ALL`].
    pub kinds: [KindSettings; 4],
    /// How often it is read.
    pub polling_ms: u32,
    /// Whether it is asked for a sign of life before it is read (2007h).
    pub check: bool,
}

impl DeviceSettings {
    /// The kinds with what is configured of them.
    pub fn kinds(&self) -> impl Iterator<Item = (Kind, KindSettings)> {
        Kind::ALL.into_iter().zip(self.kinds)
    }
}

/// Where one device's values lie: the entries of 2011h to 2014h, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DeviceLayout(pub [u16; 10]);

impl DeviceLayout {
    /// Where what is read of `kind` begins in the input buffer.
    pub const fn input(&self, kind: Kind) -> u16 {
        let [_, coils, switches, in_registers, out_registers, ..] = self.0;
        match kind {
            Kind::Coil => coils,
            Kind::Discrete => switches,
            Kind::Input => in_registers,
            Kind::Holding => out_registers,
        }
    }

    /// Where what is written of `kind` begins in the output buffer; none for what cannot be written.
    pub const fn output(&self, kind: Kind) -> Option<u16> {
        let [.., coils, out_registers, _] = self.0;
        match kind {
            Kind::Coil => Some(coils),
            Kind::Holding => Some(out_registers),
            Kind::Discrete | Kind::Input => None,
        }
    }
}

/// The layout of `devices`.
pub(super) fn layout(devices: &[DeviceSettings]) -> Result<[DeviceLayout; MODBUS_DEVICES_MAX], ConfigError> {
    let mut layouts = [DeviceLayout::default(); MODBUS_DEVICES_MAX];
    let (mut input, mut output) = (0, 0);
    for ((nth, device), layout) in devices.iter().enumerate().zip(&mut layouts) {
        let nth = nth as u8;
        for (kind, settings) in device.kinds() {
            if u32::from(settings.address) + u32::from(settings.count) > ADDRESSES {
                return Err(ConfigError::PastLastAddress { device: nth, kind });
            }
        }
        let mut places = [0; 10];
        let mut entries = places.iter_mut();
        let bytes = |(kind, settings): (Kind, KindSettings)| u32::from(kind.bytes(settings.count));
        let outputs = device.kinds().filter(|(kind, _)| kind.is_writable());
        input = place(&mut entries, input, device.kinds().map(bytes))
            .ok_or(ConfigError::InputsFull { device: nth })?;
        output = place(&mut entries, output, outputs.map(bytes))
            .ok_or(ConfigError::OutputsFull { device: nth })?;
        *layout = DeviceLayout(places);
    }
    Ok(layouts)
}

/// Writes start, the place of each kind, and the last byte used; gives the byte behind it, unless the buffer ends before.
fn place<'e>(
    entries: &mut impl Iterator<Item = &'e mut u16>,
    start: u32,
    kinds: impl Iterator<Item = u32>,
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
        if end > IMAGE_BYTES as u32 {
            return None;
        }
    }
    put(end.saturating_sub(1).max(start));
    Some(end)
}
