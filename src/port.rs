//! The ports: what each role does between its line or socket and the router.
//!
//! A port of [`server`] turns what an outside client sends into requests for the router and gives the responses back; one of
//! [`client`] takes requests from its queue and asks outside servers. [`line`](mod@line) is the serial line under both; frames between two
//! lines are passed on while they arrive by [`cut_through`]; [`local`] is the gateway's own unit. Ports know framing and timing,
//! nothing of rules.

pub mod client;
pub mod cut_through;
pub mod line;
pub mod local;
pub mod server;

// One of two: what an `async` function awaits stays in it, also behind a constant.
#[cfg_attr(not(feature = "points"), path = "port/no_scanner.rs")]
pub(crate) mod scanner;
pub(crate) mod stream;
pub(crate) mod timer;
