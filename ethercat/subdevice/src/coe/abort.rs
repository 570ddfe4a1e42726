//! Reasons to abort an SDO transfer.

/// The abort code of an SDO transfer (ETG.1000.6, table 41).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Abort {
    /// A segment has the wrong toggle bit.
    Toggle = 0x0503_0000,
    /// An unknown command, or one that needs an open transfer.
    UnknownCommand = 0x0504_0001,
    /// The object is too large for the buffer.
    OutOfMemory = 0x0504_0005,
    /// The access is not supported.
    UnsupportedAccess = 0x0601_0000,
    /// The entry is write-only.
    WriteOnly = 0x0601_0001,
    /// The entry is read-only.
    ReadOnly = 0x0601_0002,
    /// Sub-index 0 must be set to 0 first.
    CountNotZero = 0x0601_0003,
    /// The object does not support complete access.
    NoCompleteAccess = 0x0601_0004,
    /// No such object.
    NoObject = 0x0602_0000,
    /// It cannot be mapped into the PDO.
    NotMappable = 0x0604_0041,
    /// The PDOs exceed the process data size.
    PdoLength = 0x0604_0042,
    /// The parameters are incompatible.
    Incompatible = 0x0604_0043,
    /// The length differs from the announced one.
    LengthMismatch = 0x0607_0010,
    /// Longer than the entry.
    TooLong = 0x0607_0012,
    /// Shorter than the entry.
    TooShort = 0x0607_0013,
    /// No such sub-index.
    NoEntry = 0x0609_0011,
    /// Invalid value.
    Range = 0x0609_0030,
    /// Value too great.
    TooGreat = 0x0609_0031,
    /// Value too small.
    TooSmall = 0x0609_0032,
    /// Any other reason.
    General = 0x0800_0000,
    /// The value cannot be stored.
    NotStored = 0x0800_0020,
    /// Refused because of local control.
    LocalControl = 0x0800_0021,
    /// Not possible in this state.
    State = 0x0800_0022,
}
