//! The client side: a port takes requests from its queue and sends them to outside servers, over a serial line or TCP.
//!
//! The `dispatcher` holds what serial lines and TCP connections have in common: the [`queue`] (which request is served next), the
//! [`servers`] and which of them are connected, the [`cache`] of responses, and the [`pending`] requests.

pub mod cache;
pub(crate) mod connection;
// Other images have no ports whose devices connect.
#[cfg(feature = "dial-in")]
pub(crate) mod dial_in;
pub(crate) mod dispatcher;
pub mod pending;
pub mod queue;
pub(crate) mod serial;
pub mod servers;
pub(crate) mod tcp;
pub(crate) mod transaction;
