//! The Linux board: serial lines, TCP sockets, the settings file and the terminal as the core's `hal` wants them, and
//! an executor for embassy tasks.
//!
//! A byte that arrives takes this way: epoll, [`reactor`], [`executor`], the port's task, which reads it from its [`tty::Tty`] or
//! [`tcp::TcpStream`].

mod bind;
pub mod capture;
pub mod cli;
pub mod console;
pub mod demo;
pub mod describe;
mod descriptor;
pub mod ethercat;
pub mod executor;
pub mod file;
mod hint;
pub mod lines;
pub mod logging;
pub mod mdns;
pub mod merge;
pub mod reactor;
mod screen;
pub mod settings;
pub mod signals;
mod sink;
pub mod start;
pub mod stdio;
pub mod store;
pub mod tcp;
pub mod tty;
pub mod udp;
mod worker;
