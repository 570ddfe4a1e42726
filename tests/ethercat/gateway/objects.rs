//! The gateway's objects without a chip: values are read and written as SDO does it.

use ethercat_subdevice::application::Address;
use mobgate::fieldbus::REASON_BYTES;

use crate::prelude::*;

pub(crate) const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port ecat ethercat
    route ecat 1-247 * * bus";

/// Objects of a gateway that has an `ethercat` port.
pub(crate) fn objects() -> (&'static EthercatState, GatewayObjects<'static>) {
    let place = place_with(SETTINGS);
    (place, GatewayObjects::new(place))
}

fn at(index: u16, sub: u8) -> Address {
    Address { index, sub }
}

pub(crate) fn read(objects: &mut GatewayObjects<'_>, index: u16, sub: u8) -> u32 {
    let mut value = [0; 4];
    let is_polling_time = sub == 10 && matches!(index, 0x2001..=0x2004 | 0x2100..=0x211f);
    let bytes = if is_polling_time || (index, sub) == (0x2020, 1) { 4 } else { 2 };
    objects.read(at(index, sub), &mut value[..bytes]).unwrap();
    u32::from_le_bytes(value)
}

/// As an SDO does it, once the table has checked the range.
pub(crate) fn write(objects: &mut GatewayObjects<'_>, index: u16, sub: u8, value: u32) -> Result<(), Abort> {
    write_bytes(objects, index, sub, &value.to_le_bytes())
}

/// The same for a value of any length.
pub(crate) fn write_bytes(
    objects: &mut GatewayObjects<'_>,
    index: u16,
    sub: u8,
    value: &[u8],
) -> Result<(), Abort> {
    objects.check(at(index, sub), value)?;
    objects.write(at(index, sub), value);
    Ok(())
}

/// A value whose length is part of it.
pub(crate) fn read_bytes(objects: &mut GatewayObjects<'_>, index: u16, sub: u8) -> Vec<u8> {
    let mut value = [0; 254];
    let length = objects.read(at(index, sub), &mut value).unwrap();
    value[..length].to_vec()
}

pub(crate) fn reason(objects: &mut GatewayObjects<'_>) -> String {
    let mut text = [0; REASON_BYTES as usize];
    objects.read(at(0x2006, 0), &mut text).unwrap();
    str::from_utf8(&text).unwrap().trim_end_matches('\0').to_owned()
}

/// The layout of a slave, which the first four have at two places.
pub(crate) fn layout(objects: &mut GatewayObjects<'_>, slave: u16) -> [u16; 10] {
    let mut at = |index| std::array::from_fn(|entry| read(objects, index, entry as u8 + 1) as u16);
    let layout = at(0x2140 + slave);
    assert!(slave >= 4 || at(0x2011 + slave) == layout);
    layout
}

/// Writes 210xh: the id, then count and first address of each kind.
pub(crate) fn configure(objects: &mut GatewayObjects<'_>, slave: u16, settings: &[u16]) {
    configure_at(objects, 0x2100 + slave, settings);
}

/// The same at this index.
pub(crate) fn configure_at(objects: &mut GatewayObjects<'_>, index: u16, settings: &[u16]) {
    for (value, sub) in settings.iter().zip(1..) {
        write(objects, index, sub, (*value).into()).unwrap();
    }
}
