//! The server side: outside clients send requests by TCP, UDP or a serial line, and get responses.

// Servers of images without TLS need none.
#[cfg(any(feature = "tls", feature = "web"))]
pub(crate) mod handshake;
pub(crate) mod listening;
pub(crate) mod serial;
pub(crate) mod tcp;
pub(crate) mod udp;
