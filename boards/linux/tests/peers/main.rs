//! The real program between Modbus software by others: `mbpoll`, pymodbus and tokio-modbus ask by TCP; pymodbus, rmodbus
//! and tokio-modbus answer by RTU on PTYs that `socat` joins.
//!
//! A missing outside program fails a test, with the command that installs it. Python is the virtual environment's that
//! `tests/peers/setup` makes, or the one that the variable `MOBGATE_PYTHON` names.

#[path = "../common/mod.rs"]
mod common;
mod lines;
mod mbpoll;
mod outside;
mod pipelining;
mod points;
mod pymodbus;
mod rmodbus_server;
mod rust_crates;
mod tokio_server;
