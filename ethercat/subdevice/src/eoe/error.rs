//! The results of requests that are refused.

/// Why a request is refused: the response's result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum EthernetError {
    /// No more specific code applies.
    Unspecified = 0x0001,
    /// The kind of request.
    UnsupportedFrameType = 0x0002,
    /// The device has no IP settings, or not for a MainDevice.
    NoIpSupport = 0x0201,
    /// The device has no DHCP.
    NoDhcpSupport = 0x0202,
    /// The device has no filter for MAC addresses.
    NoFilterSupport = 0x0401,
}
