//! embassy-net's sockets as the gateway uses them, in virtual time.

mod backlog;
mod cable;
mod mdns;
mod sockets;
mod through_ethercat;
