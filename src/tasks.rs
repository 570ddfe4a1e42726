//! The futures that a board runs as its tasks: the router, one for each port, one for each TCP connection.

mod connection;
mod port;
mod router;
