//! Types of values, and access rights.

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DataType {
    /// One bit. A byte on its own; a bit in a PDO or in a complete access.
    Bool,
    /// 8 bits.
    U8,
    /// 16 bits.
    U16,
    /// 32 bits.
    U32,
    /// 64 bits.
    U64,
    /// 16 bits, signed.
    I16,
    /// 32 bits, signed.
    I32,
    /// 64 bits, signed.
    I64,
    /// 32-bit floating point (IEEE 754).
    F32,
    /// 64-bit floating point (IEEE 754).
    F64,
    /// A visible string of that many bytes.
    Text(u16),
    /// That many bytes.
    Octets(u16),
    /// Up to that many bytes.
    OctetsUpTo(u16),
}

impl DataType {
    /// Its number in the dictionary (ETG.1000.6, table 63).
    pub const fn code(self) -> u16 {
        match self {
            Self::Bool => 0x0001,
            Self::I16 => 0x0003,
            Self::I32 => 0x0004,
            Self::F32 => 0x0008,
            Self::F64 => 0x0011,
            Self::I64 => 0x0015,
            Self::U8 => 0x0005,
            Self::U16 => 0x0006,
            Self::U32 => 0x0007,
            Self::U64 => 0x001b,
            Self::Text(_) => 0x0009,
            Self::Octets(_) | Self::OctetsUpTo(_) => 0x000a,
        }
    }

    /// Its size; the maximum if it varies.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bool | Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
            Self::Text(bytes) | Self::Octets(bytes) | Self::OctetsUpTo(bytes) => bytes as usize,
        }
    }

    /// Its size in bits; the remaining bits of its bytes are 0.
    pub const fn bits(self) -> u16 {
        match self {
            Self::Bool => 1,
            _ => 8 * self.bytes() as u16,
        }
    }

    /// Whether it is a number, and has a range.
    pub const fn is_number(self) -> bool {
        !matches!(self, Self::Text(_) | Self::Octets(_) | Self::OctetsUpTo(_))
    }

    /// Whether a value may be shorter than its size.
    pub const fn may_be_shorter(self) -> bool {
        matches!(self, Self::Text(_) | Self::OctetsUpTo(_))
    }

    pub(super) const fn greatest(self) -> u64 {
        match self {
            Self::Bool => 1,
            Self::U8 => u8::MAX as u64,
            Self::U16 | Self::I16 => u16::MAX as u64,
            Self::U32 | Self::I32 | Self::F32 => u32::MAX as u64,
            _ => u64::MAX,
        }
    }
}

/// Access rights as SDO information codes them: three bits for reading and three for writing, in PreOp, SafeOp and Op.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Access(pub u16);

impl Access {
    /// Readable in every state.
    pub const READ: Self = Self(0x0007);
    /// Writable in every state.
    pub const WRITE: Self = Self(0x0038);
    /// Writable in PreOp.
    pub const WRITE_PRE_OP: Self = Self(0x0008);
    /// May be mapped into an RxPDO.
    pub const RX_PDO: Self = Self(0x0040);
    /// May be mapped into a TxPDO.
    pub const TX_PDO: Self = Self(0x0080);
    /// A setting.
    pub const SETTING: Self = Self(0x0200);

    /// These rights and `other`.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether any right of `other` is set.
    pub const fn any(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}
