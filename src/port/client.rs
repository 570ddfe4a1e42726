//! The client side: a port takes requests from its queue and asks outside servers, on a serial line or by TCP.
//!
//! The `dispatcher` has what serial lines and connections have in common: the [`queue`] (who is served next), which [`servers`]
//! are connected, which responses are in the [`cache`], which requests are [`pending`].

pub mod cache;
pub(crate) mod connection;
pub(crate) mod dispatcher;
pub mod pending;
pub mod queue;
pub(crate) mod serial;
pub mod servers;
pub(crate) mod tcp;
pub(crate) mod transaction;
