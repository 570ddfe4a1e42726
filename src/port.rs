//! The ports: what each role does between its line or socket and the router.
//!
//! A server-side port turns what an outside client sends into frames for the router and gives the answers back; a
//! client-side port takes orders from its channel and asks outside servers. Ports know framing and timing, nothing of
//! routes. `queue`, `servers`, `cache`, `units`, `answer_times`, `answer_tail`, `flights` and `shared_bus` are the pure parts: who is served
//! next, which server is connected, which answers are kept, which units are alive, how long they take, which requests are open on a connection, and what a frame is that was heard on a bus with other
//! devices.

pub mod answer_tail;
pub mod cache;
pub mod cut;
pub mod ethercat;
pub mod flights;
pub mod local;
pub mod queue;
pub mod relay;
pub mod servers;
pub mod shared_bus;

pub(crate) mod arriving;
pub(crate) mod bus;
pub(crate) mod copy;
pub(crate) mod desk;
pub(crate) mod framing;
pub(crate) mod line;
pub(crate) mod link;
pub(crate) mod listening;
pub(crate) mod moment;
pub(crate) mod reply;
// One of two: what an `async` function awaits stays in it, also behind a constant.
#[cfg_attr(not(feature = "points"), path = "port/no_scanner.rs")]
pub(crate) mod scanner;
pub(crate) mod serial_client;
pub(crate) mod serial_server;
pub(crate) mod stream;
pub(crate) mod tcp_client;
pub(crate) mod tcp_server;
pub(crate) mod udp_server;
