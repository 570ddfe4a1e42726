//! mobgate, a multi-port Modbus router: any client reaches any device on any port, by rules typed at a console.
//!
//! # The path of one request
//!
//! 1. A server-side port ([`port`]) receives a request, from a TCP client or from a master on a serial line, where
//!    [`port::line::sniffer`] distinguishes it from other traffic: it strips the framing ([`modbus`]), takes a frame from the
//!    pool ([`frame`]), writes the PDU and an envelope into it (requester, unit, deadline), and sends it to the router's inbox.
//! 2. The routing task (`tasks/router.rs`) looks up the first matching rule ([`routing`]), translates the unit id, and sends the
//!    frame to the channel of the destination port.
//! 3. The client-side port queues it ([`port::client::queue`]: which request is next; [`gateway::unit_health`]: which units
//!    respond), sends it as soon as the line has been silent for long enough, and checks the response strictly. Identical reads
//!    waiting at that time share one transaction; each requester gets a copy of the response.
//! 4. The response, or an exception that reports the failure, replaces the request in the frame, which returns the same way: to
//!    the inbox, through the router, to the requester.
//!
//! Between two serial lines the frame is cut through: it takes this path while its characters are still arriving
//! ([`port::cut_through::timing`] computes when it may), and the other line sends what has arrived, in its own framing. From RTU to
//! RTU the received CRC is kept ([`modbus::delta`]); an ASCII line gets its LRC once the CRC has been checked, and vice versa, so
//! that a corrupt frame stays corrupt. A frame that turns out not to fit is broken off. A board may relay the characters in an
//! interrupt ([`hal::Relay`]), so that the tasks only wake at the end of the frame.
//!
//! The gateway also polls devices itself: the scanner ([`scanner`]) turns data points into requests, which its port sends through
//! the router, and stores the values, which outside clients may read as tables of the gateway's own unit.
//!
//! So a transaction uses one frame from beginning to end, and every frame returns: no request is lost, and a port tracks its open
//! requests by counting. Ports know framing and timing, but no routes; the router knows routes, but no lines; decisions take the
//! time as a value.
//!
//! # The board's part
//!
//! [`hal`] defines the board's interface. The board keeps frame slots, port states and connections in statics, builds a
//! [`gateway::Gateway`] over them, and runs its futures as tasks: one that routes, one for each port, one for each TCP connection,
//! one for each console ([`console`]), and with the feature `web` some for the connections of the web interface. The settings
//! ([`settings`], [`language`]) are lines of text, the same at the console, in a file and in `show config`.
//!
//! # EtherCAT
//!
//! [`ethercat_subdevice`] is a SubDevice stack independent of the rest; [`fieldbus`] defines the gateway's SubDevice: its objects,
//! its buffers, and the layout of Modbus values in them. The buffers are the memory of a separate [`scanner`], whose requests go
//! through the router by the rules for the `ethercat` port, like the MainDevice's own requests. The devices are settings: a
//! MainDevice's configuration is printed and saved with the others, also on its request ([`gateway::Gateway::keep_settings`]). A
//! board with a controller keeps a [`fieldbus::EthercatState`] in a static, passes it to [`gateway::Gateway::with_ethercat`], and
//! runs [`fieldbus::serve`], a [`SubDevice`](ethercat_subdevice::sub_device::SubDevice) with [`fieldbus::GatewayObjects`], over it.
//! A MainDevice's files pass through a [`fieldbus::FileBuffer`], to the owner of the flash or to [`console::serve_files`].
//! With [`gateway::Gateway::with_ethercat_interfaces`] the settings name the network interface of an emulated controller.
//!
//! # Limits
//!
//! With the feature `small` some are lower, for boards with little memory. Without the feature `points` there are no data points,
//! and no memory for them. Without `ipv6` settings accept IPv4 addresses only, as on boards with their own Ethernet. Without
//! `servers` a TCP client has one server, given by its address. Without `capture` no frames are stored. Without `paths` names of
//! serial devices are short, as on boards. Without `web` there is no web interface; without
//! `long-requests` its requests, and some of its responses, are shorter. Without `ssh` there are no SSH servers and no
//! public keys of users. Without `mqtt` nothing is published. Without `dial-in` no device connects to the gateway.
//!
//! | limit | value | why |
//! | --- | --- | --- |
//! | [`settings::PORTS_MAX`] | 16, small: 8 | the lines and listeners of a cabinet |
//! | `settings::DEVICE_BYTES_MAX` | 255, without `paths`: 15 | a file name: those under `/dev/serial/by-id` exceed 100 bytes |
//! | [`settings::LINE_BYTES_MAX`] | 800, without `paths`: 640 | the longest line that settings print |
//! | [`settings::ROUTES_MAX`] | 64 | rules are tried in order, for each request |
//! | [`port::client::queue::WAITING_MAX`] | 64, small: 24 | requests waiting at a port; one more gets 06h |
//! | [`port::client::cache::RESPONSES_MAX`] | 16, small: 8 | responses that a port caches where a rule says `cache`, in [`port::client::cache::RESPONSE_BYTES_MAX`] bytes |
//! | [`gateway::unit_health::UNITS_MAX`] | 64, small: 16 | servers of a port, or loads of an RS-485 segment; the least active healthy unit is forgotten first |
//! | [`gateway::unit_health::ALL_UNITS_MAX`] | 256, small: 48 | units of all ports together: few ports use their maximum |
//! | [`stats::LOG_ENTRIES_MAX`] | 64 | transactions in `show log` |
//! | [`port::client::pending::PENDING_MAX`] | 16 | requests in flight on one connection to a server, the specification's maximum |
//! | `settings::PORT_SERVERS_MAX`, `settings::SERVERS_MAX` | 64 and 128, small: 8 and 16 | servers of one TCP client, and of all: what one scanner can poll in time |
//! | [`settings::SOCKETS_MAX`] | 16, small: 2 | simultaneous connections of one port; each takes a future's memory |
//! | `settings::DIAL_IN_WAITING_MAX` | 4 | devices of a port that have connected and wait for their first bytes; a newcomer displaces the oldest |
//! | `settings::FIRST_BYTES_MAX` | 32 | bytes by which such a device is told apart: serial numbers are shorter |
//! | `settings::SERVER_NAME_BYTES_MAX` | 63, small: 31 | a server's name, stored with each server line |
//! | `settings::UDP_REQUESTS_MAX` | 32 | requests open at one UDP server; one more gets 06h |
//! | [`scanner::DEVICES_MAX`] | 32 | devices that a scanner polls: the loads of an RS-485 segment |
//! | `settings::SLAVES_MAX` | 32 | devices behind the EtherCAT process image: all that a scanner polls |
//! | [`fieldbus::Room::MOST`], [`fieldbus::Room::LONG`] | 512; with `long-images` 1486 in and 1500 out | bytes of the process image each way: with three buffers of each, what a controller of 4 KiB holds, and one of 10 |
//! | [`scanner::ROWS_MAX`] | 136 | the four tables of each device, and some ranges that take two frames |
//! | [`scanner::VALUE_BYTES_MAX`] | 4096, without `long-images` 2048 | values of all rows: the longest image each way, and as much again as 1 KiB |
//! | `settings::POINTS_MAX` | 128, small: 64 | data points in the settings and in the draft shared by all consoles |
//! | `settings::PUBLISHERS_MAX` | 2, without `mqtt` none | each takes 50 KiB for what is not acknowledged yet and the state of each point |
//! | [`capture::FRAMES_MAX`] | 64, of 2048 bytes together; small: half | frames in `show frames` |
//! | frames, TCP connections | the board's | memory; a connection always has one frame reserved |
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::unwrap_used, clippy::indexing_slicing)]

#[macro_use]
mod fmt;

pub mod capture;
pub mod console;
pub mod fieldbus;
pub mod frame;
pub mod gateway;
pub mod hal;
pub mod language;
pub mod modbus;
mod mqtt;
#[doc(hidden)] // Public for tests/ only.
pub mod port;
#[doc(hidden)] // Public for tests/ only.
pub mod routing;
pub mod scanner;
pub mod settings;
pub mod stats;
mod tasks;
// As the feature.
#[cfg(feature = "mqtt")]
mod telemetry;
// Most images have none.
#[cfg(feature = "web")]
pub mod web;
