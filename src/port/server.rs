//! The server side: outside clients send requests by TCP, UDP or a serial line, and get responses.

// Other images have no ports whose devices connect.
#[cfg(feature = "dial-in")]
pub(crate) mod dial_in;
// Servers of images without TLS need none.
#[cfg(any(feature = "tls", feature = "web"))]
pub(crate) mod handshake;
pub(crate) mod listening;
pub(crate) mod serial;
pub(crate) mod tcp;
pub(crate) mod udp;
