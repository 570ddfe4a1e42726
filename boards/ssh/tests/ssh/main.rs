//! The server with OpenSSH's client, and with one that sends packets as no other does.

mod openssh;
#[path = "../../../linux/tests/ssh/openssh_client.rs"]
mod openssh_client;
#[path = "../../../linux/tests/ssh/payload.rs"]
mod payload;
mod random;
#[path = "../../../linux/tests/ssh/raw.rs"]
mod raw;
mod server;
