//! The server side: outside clients send requests by TCP, UDP or a serial line, and get responses.

pub(crate) mod listening;
pub(crate) mod serial;
pub(crate) mod tcp;
pub(crate) mod udp;
