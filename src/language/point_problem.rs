//! Errors in the lines of points, devices and slaves.

use thiserror::Error;

#[cfg(feature = "long-values")] // As scales.
use crate::scanner::ValueRange;
use crate::scanner::{DEVICES_MAX, VALUE_BYTES_MAX};
use crate::settings::POINTS_MAX;

/// Why a word is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub(crate) enum PointProblem {
    /// There is no scanner port.
    #[error("there is no scanner port: type port NAME scanner first")]
    NoScanner,
    /// The port has no settings.
    #[error("a scanner has nothing to set")]
    NothingToSet,
    /// There is another scanner port.
    #[error("another port is the scanner")]
    ScannerTaken,
    /// There is another EtherCAT port.
    #[error("another port is the EtherCAT port")]
    EthercatTaken,
    /// The port polls devices.
    #[error("this port polls the devices: delete them first")]
    ScannerInUse,
    /// There is no EtherCAT port.
    #[error("there is no EtherCAT port: type port NAME ethercat first")]
    NoEthercat,
    /// The port polls the slaves of the process image.
    #[error("this port polls the slaves: delete them first")]
    EthercatInUse,
    /// There are no slaves.
    #[error("there are no slaves")]
    NoSlaves,
    /// There is no device with this name.
    #[error("there is no device of this name")]
    NoSuchDevice,
    /// There is no point with this name.
    #[error("there is no point of this name")]
    NoSuchPoint,
    /// [`DEVICES_MAX`] devices exist.
    #[error("there are {DEVICES_MAX} devices already, the maximum")]
    DevicesFull,
    /// [`POINTS_MAX`] points exist.
    #[error("there are {POINTS_MAX} points already, the maximum")]
    PointsFull,
    /// The values of all points are more than [`VALUE_BYTES_MAX`] bytes.
    #[error("the values of all points would take more than {VALUE_BYTES_MAX} bytes")]
    ValuesFull,
    /// Points refer to the device.
    #[error("points refer to this device: delete them first")]
    DeviceInUse,
    /// Other points show the variable.
    #[error("another point shows this one: delete or change that first")]
    PointShown,
    /// Only a point with its own variable can be shown.
    #[error("has no variable of its own")]
    ShowsAnother,
    /// A point must follow the one it shows, so that the lines can be read in order.
    #[error("comes before the point that it would show: delete it first")]
    ShowsLater,
    /// Bits cannot be shown as numbers.
    #[error("has bits where the other has numbers")]
    BitsForNumbers,
    /// Numbers cannot be shown as bits.
    #[error("has numbers where the other has bits")]
    NumbersForBits,
    /// Not for tables of bits.
    #[error("is for registers only")]
    BitsHaveNoType,
    /// A value of several bits must use all of them.
    #[error("expected a multiple of {0}: a value has that many bits")]
    PartOfValue(u16),
    /// Bits of a register are one value.
    #[error("bits of a register have neither count nor type")]
    BitOfRegister,
    /// Number and type come from the point that is shown.
    #[error("cannot be combined with of: the other point has the values")]
    ValuesOfAnother,
    /// The table cannot be written.
    #[error("discrete inputs and input registers cannot be written")]
    NotWritable,
    /// Bits and text have no scale.
    #[cfg(feature = "long-values")] // As scales.
    #[error("is for numbers only")]
    NotANumber,
    /// A value out of the range of its raw number.
    #[cfg(feature = "long-values")] // As above.
    #[error("expected a value from {0}")]
    Beyond(ValueRange),
    /// Addresses beyond 65535.
    #[error("the cells go beyond address 65535")]
    AddressesEnd,
    /// Another point occupies these cells of the gateway's own unit.
    #[error("another local point has cells there")]
    AddressTaken,
}
