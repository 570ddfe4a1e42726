//! What a client gets.

/// A frame as it came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Transaction id.
    pub transaction: u16,
    /// Protocol id, 0 in Modbus.
    pub protocol: u16,
    /// Unit id.
    pub unit: u8,
    /// The PDU; may be empty in a wrong frame.
    pub pdu: Vec<u8>,
}
