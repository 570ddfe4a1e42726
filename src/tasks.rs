//! The futures that a board runs as its tasks: the router, one per port, one per TCP connection.

mod connection;
mod port;
mod router;
