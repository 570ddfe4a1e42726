//! The ports: what each role does between its line or socket and the router.
//!
//! A [`server`] port turns the frames of an outside client into requests for the router and sends the responses back; a [`client`]
//! port takes requests from its queue and sends them to outside servers. [`line`](mod@line) is the serial line under both,
//! [`cut_through`] forwards frames between two lines while they are still arriving, and [`local`] is the gateway's own unit. Ports
//! know framing and timing, but no rules.

pub mod client;
pub mod cut_through;
pub mod line;
pub mod local;
pub mod server;

// A separate file, not a `cfg!` branch: what an `async` function awaits stays in its future even behind a false constant.
#[cfg_attr(not(feature = "points"), path = "port/no_scanner.rs")]
pub(crate) mod scanner;
pub(crate) mod stream;
pub(crate) mod timer;
