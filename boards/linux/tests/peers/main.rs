//! The real program between Modbus software by others: `mbpoll`, pymodbus, tokio-modbus and modbus-serial ask by TCP,
//! modbus-serial also by RTU; OpenSSL, pymodbus and pysunspec2 ask by TLS; pymodbus, rmodbus and tokio-modbus respond by RTU on PTYs that `socat` joins, modbus-serial by TCP.
//! jsonschema-rs holds settings as JSON against their schema; Python's HTTPS client uses the web interface, promtool and prometheus-client
//! read its metrics; mosquitto gets its data points, for paho-mqtt and protobuf too, as a host of Sparkplug.
//!
//! A missing outside program fails a test, with the command that installs it. Python is the virtual environment's that
//! `cargo xtask install peers` makes, or the one that the variable `MOBGATE_PYTHON` names; modbus-serial is what it installs for Node.js.

mod authority;
mod cable;
#[path = "../common/mod.rs"]
mod common;
mod examples;
mod https;
mod lines;
mod mbpoll;
mod metrics;
mod modbus_serial;
mod mosquitto;
mod outside;
mod pipelining;
mod points;
mod pymodbus;
mod rmodbus_server;
mod rust_crates;
mod secure;
mod secure_device;
mod settings_schema;
mod sparkplug;
mod tokio_server;
