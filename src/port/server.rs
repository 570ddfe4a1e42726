//! The server side: outside clients ask, by TCP, by UDP or on a serial line, and get their responses.

pub(crate) mod listening;
pub(crate) mod serial;
pub(crate) mod tcp;
pub(crate) mod udp;
