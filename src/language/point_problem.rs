//! What can be wrong with the lines of points, of their devices and of slaves.

use thiserror::Error;

use crate::scanner::{DEVICES_MAX, VALUE_BYTES_MAX};
use crate::settings::POINTS_MAX;

/// Why a word about them is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PointProblem {
    /// There is no port that asks devices.
    #[error("no port asks devices: type port NAME scanner first")]
    NoScanner,
    /// A port without settings of its own.
    #[error("a scanner has nothing to set")]
    NothingToSet,
    /// Another port asks devices.
    #[error("another port is the scanner")]
    ScannerTaken,
    /// Another port asks for the MainDevice.
    #[error("another port is that of EtherCAT")]
    EthercatTaken,
    /// The port asks devices.
    #[error("this port asks the devices: delete those first")]
    ScannerInUse,
    /// There is no port that asks for the MainDevice.
    #[error("no port asks for EtherCAT: type port NAME ethercat first")]
    NoEthercat,
    /// The port asks the slaves of the process image.
    #[error("this port asks the slaves: delete those first")]
    EthercatInUse,
    /// There is no slave at all.
    #[error("there are no slaves")]
    NoSlaves,
    /// No device has this name.
    #[error("there is no device of this name")]
    NoSuchDevice,
    /// No point has this name.
    #[error("there is no point of this name")]
    NoSuchPoint,
    /// [`DEVICES_MAX`] devices exist.
    #[error("there are {DEVICES_MAX} devices already, the most there can be")]
    DevicesFull,
    /// [`POINTS_MAX`] points exist.
    #[error("there are {POINTS_MAX} points already, the most there can be")]
    PointsFull,
    /// The values of all points are more than [`VALUE_BYTES_MAX`] bytes.
    #[error("the values of all points would take more than {VALUE_BYTES_MAX} bytes")]
    ValuesFull,
    /// Points are read from the device.
    #[error("points are in this device: delete those first")]
    DeviceInUse,
    /// Other points show the variable.
    #[error("another point shows this one: delete or change that first")]
    PointShown,
    /// Only a variable of its own can be shown.
    #[error("has no variable of its own")]
    ShowsAnother,
    /// A point stands behind the one that it shows, so that lines can be read in their order.
    #[error("stands before the point that it would show: delete it first")]
    ShowsLater,
    /// A number is no bit.
    #[error("has bits where the other has numbers")]
    BitsForNumbers,
    /// A bit is no number.
    #[error("has numbers where the other has bits")]
    NumbersForBits,
    /// A bit is a bit.
    #[error("is for registers only")]
    BitsHaveNoType,
    /// A value that takes many bits has none of them left over.
    #[error("expected a multiple of {0}: a value is so many bits")]
    PartOfValue(u16),
    /// A bit of a register is one value, 0 or 1.
    #[error("a bit of a register has neither count nor type")]
    BitOfRegister,
    /// What a point shows has its own number and type.
    #[error("cannot stand with of: the other point has the values")]
    ValuesOfAnother,
    /// The table cannot be written.
    #[error("discrete inputs and input registers cannot be written")]
    NotWritable,
    /// Cells behind address 65535.
    #[error("the cells go beyond address 65535")]
    AddressesEnd,
    /// Another point has these cells of the gateway's own unit.
    #[error("another local point has cells there")]
    AddressTaken,
}
