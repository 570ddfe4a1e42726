//! The Linux board: serial lines, TCP sockets, settings file and terminal for the core's `hal`, and an executor for embassy tasks.
//!
//! The path of a received byte: epoll, [`reactor`], [`executor`], the port's task, which reads it from its [`tty::Tty`] or
//! [`tcp::TcpStream`].

mod bind;
pub mod calendar;
pub mod capture;
pub mod cli;
pub mod console;
// The shipped program links no simulator.
#[cfg_attr(not(feature = "demo"), path = "no_demo.rs")]
pub mod demo;
pub mod describe;
mod descriptor;
pub mod ethercat;
pub mod executor;
mod exposure;
pub mod file;
mod hint;
pub mod logging;
pub mod mdns;
pub mod merge;
pub mod passwords;
pub mod reactor;
mod screen;
pub mod service;
pub mod settings;
pub mod signals;
mod sink;
pub mod ssh;
pub mod start;
pub mod stdio;
pub mod store;
pub mod syslog;
mod tap;
pub mod tcp;
pub mod tls;
pub mod tty;
pub mod udp;
mod versions;
mod worker;
