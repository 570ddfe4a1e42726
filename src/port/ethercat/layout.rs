//! Where the values of the Modbus devices lie in the buffers: device after device, kind after kind, without gaps.

use super::objects::{IMAGE_BYTES, MODBUS_DEVICES_MAX};

/// Addresses of a kind: 0 to 65535.
const ADDRESSES: u32 = 65_536;

/// What a Modbus device has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Coils: inputs, read back, and outputs.
    Coils,
    /// Discrete inputs.
    Switches,
    /// Input registers.
    InRegisters,
    /// Holding registers: inputs, read back, and outputs.
    OutRegisters,
}

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
    /// Its values, by [`Kind`].
    pub kinds: [KindSettings; 4],
    /// How often it is read.
    pub polling_ms: u32,
}

/// Where one device's values lie: the entries of 2011h to 2014h, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DeviceLayout(pub [u16; 10]);

/// Why a configuration does not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutError {
    /// The values of all devices are longer than a buffer.
    ImageFull,
    /// A kind's addresses would go past 65535.
    PastLastAddress,
}

impl KindSettings {
    /// Bits are packed eight to a byte, registers take two.
    fn bytes(self, kind: Kind) -> u32 {
        match kind {
            Kind::Coils | Kind::Switches => u32::from(self.count).div_ceil(8),
            Kind::InRegisters | Kind::OutRegisters => 2 * u32::from(self.count),
        }
    }
}

/// The layout of `devices`.
pub(super) fn layout(devices: &[DeviceSettings]) -> Result<[DeviceLayout; MODBUS_DEVICES_MAX], LayoutError> {
    let mut layouts = [DeviceLayout::default(); MODBUS_DEVICES_MAX];
    let (mut input, mut output) = (0, 0);
    for (device, layout) in devices.iter().zip(&mut layouts) {
        let past_last = |kind: &KindSettings| u32::from(kind.address) + u32::from(kind.count) > ADDRESSES;
        if device.kinds.iter().any(past_last) {
            return Err(LayoutError::PastLastAddress);
        }
        let bytes = |kind: Kind| device.kinds.get(kind as usize).map_or(0, |settings| settings.bytes(kind));
        let mut places = [0; 10];
        let mut entries = places.iter_mut();
        let inputs = [Kind::Coils, Kind::Switches, Kind::InRegisters, Kind::OutRegisters].map(bytes);
        let outputs = [Kind::Coils, Kind::OutRegisters].map(bytes);
        input = place(&mut entries, input, &inputs)?;
        output = place(&mut entries, output, &outputs)?;
        *layout = DeviceLayout(places);
    }
    Ok(layouts)
}

/// Writes start, the place of each kind, and the last byte used; gives the byte behind it.
fn place<'e>(
    entries: &mut impl Iterator<Item = &'e mut u16>,
    start: u32,
    kinds: &[u32],
) -> Result<u32, LayoutError> {
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
            return Err(LayoutError::ImageFull);
        }
    }
    put(end.saturating_sub(1).max(start));
    Ok(end)
}

#[cfg(test)]
mod tests {
    use super::{DeviceSettings, KindSettings, LayoutError, layout};

    fn device(counts: [u16; 4]) -> DeviceSettings {
        let kinds = counts.map(|count| KindSettings { count, address: 0 });
        DeviceSettings { id: 1, kinds, polling_ms: 1_000 }
    }

    #[test]
    fn four_devices_lie_one_behind_the_other() {
        let devices = [[18, 3, 6, 4], [10, 16, 2, 8], [8, 5, 5, 6], [23, 7, 1, 2]].map(device);
        let layouts = layout(&devices).unwrap().map(|layout| layout.0);
        assert_eq!(layouts[0], [0, 0, 3, 4, 16, 23, 0, 0, 3, 10]);
        assert_eq!(layouts[1], [24, 24, 26, 28, 32, 47, 11, 11, 13, 28]);
        assert_eq!(layouts[2], [48, 48, 49, 50, 60, 71, 29, 29, 30, 41]);
        assert_eq!(layouts[3], [72, 72, 75, 76, 78, 81, 42, 42, 45, 48]);
    }

    #[test]
    fn a_full_image_fits_and_one_byte_more_does_not() {
        assert!(layout(&[device([0, 0, 60, 0])]).is_ok());
        assert_eq!(layout(&[device([0, 1, 60, 0])]), Err(LayoutError::ImageFull));
        assert_eq!(layout(&[device([0, 0, 65_535, 65_535])]), Err(LayoutError::ImageFull));
    }

    #[test]
    fn addresses_end_at_65535() {
        let mut last = device([0, 8, 0, 0]);
        last.kinds[1].address = 65_528;
        assert!(layout(&[last]).is_ok());
        last.kinds[1].address = 65_529;
        assert_eq!(layout(&[last]), Err(LayoutError::PastLastAddress));
    }
}
