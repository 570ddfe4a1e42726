//! The server with OpenSSH's client, and with one that sends packets as no other does.

mod openssh;
#[path = "../../../linux/tests/ssh/payload.rs"]
mod payload;
mod random;
#[path = "../../../linux/tests/ssh/raw.rs"]
mod raw;
mod server;
