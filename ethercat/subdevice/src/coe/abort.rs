//! Why an SDO transfer was aborted.

/// The abort code of an SDO transfer (ETG.1000.6, table 41).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Abort {
    /// A segment has the wrong toggle bit.
    Toggle = 0x0503_0000,
    /// A command that does not exist, or that nothing is open for.
    UnknownCommand = 0x0504_0001,
    /// The object is too large to be kept.
    OutOfMemory = 0x0504_0005,
    /// The access is not supported.
    UnsupportedAccess = 0x0601_0000,
    /// The entry can be written only.
    WriteOnly = 0x0601_0001,
    /// The entry can be read only.
    ReadOnly = 0x0601_0002,
    /// Sub-index 0 must be set to 0 first.
    CountNotZero = 0x0601_0003,
    /// The object cannot be accessed completely.
    NoCompleteAccess = 0x0601_0004,
    /// There is no such object.
    NoObject = 0x0602_0000,
    /// It cannot be mapped into the PDO.
    NotMappable = 0x0604_0041,
    /// The PDOs are longer than the process data may be.
    PdoLength = 0x0604_0042,
    /// The parameters do not fit each other.
    Incompatible = 0x0604_0043,
    /// The length is not what was announced.
    LengthMismatch = 0x0607_0010,
    /// More bytes than the entry has.
    TooLong = 0x0607_0012,
    /// Fewer bytes than the entry has.
    TooShort = 0x0607_0013,
    /// There is no such sub-index.
    NoEntry = 0x0609_0011,
    /// A value that is not allowed.
    Range = 0x0609_0030,
    /// A value that is too great.
    TooGreat = 0x0609_0031,
    /// A value that is too small.
    TooSmall = 0x0609_0032,
    /// For none of the other reasons.
    General = 0x0800_0000,
    /// It cannot be stored.
    NotStored = 0x0800_0020,
    /// Because of local control.
    LocalControl = 0x0800_0021,
    /// Not in this state.
    State = 0x0800_0022,
}
