//! mobgate, a multi-port Modbus router: any client reaches any device on any port, by rules typed at a console.
//!
//! # The path of one request
//!
//! 1. A server-side port ([`port`]) receives a request, from a TCP client or from a master on a serial line, where
//!    [`port::line::sniffer`] tells it from what others say: it strips the framing ([`modbus`]), takes a frame from the pool
//!    ([`frame`]), writes the PDU and an envelope into it (who asked, for which unit, until when), and sends it to the
//!    router's inbox.
//! 2. The routing task (`tasks/router.rs`) looks the first matching rule up ([`routing`]), translates the unit id, and sends the frame
//!    to the channel of the destination port.
//! 3. The client-side port takes it into its queue ([`port::client::queue`]: who is served next; [`gateway::unit_health`]: which units are
//!    alive), sends the request as soon as its line has been silent for long enough, and checks the response strictly.
//!    Identical reads that wait at that moment are one transaction; each requester gets its own copy of the response.
//! 4. The response, or an exception that says what went wrong, replaces the request in the frame, which takes the
//!    same road back: to the inbox, through the router, to whoever asked.
//!
//! Between two serial lines the frame takes this road while its characters still arrive ([`port::cut_through::timing`] says when it may): the
//! other line sends what is there, in its own framing. From RTU to RTU the CRC that came goes with it ([`modbus::delta`]); an
//! ASCII line gets its LRC when the CRC has proved good, and the other way round, so that what is damaged stays damaged. What
//! turns out not to fit is broken off. A board that can moves the characters in between by itself ([`hal::Relay`]), and the tasks
//! wake when the frame's end has come.
//!
//! The gateway also asks by itself: the scanner ([`scanner`]) turns data points into requests, which its port sends on the same
//! road, and keeps the responses, which outside clients may read as the tables of the gateway's own unit.
//!
//! So a transaction is one frame, from beginning to end, and every frame comes home: no request is lost, and a port knows
//! what is open by counting. Ports know framing and timing, nothing of routes; the router knows routes, nothing of
//! lines; time is a value wherever something is decided.
//!
//! # What a board does
//!
//! [`hal`] lists what a board must give. The board keeps slots, port places and connections in statics, builds a
//! [`gateway::Gateway`] over them, and runs its futures as tasks: one that routes, one for each port, one for each TCP
//! connection, one for each console ([`console`]). The settings ([`settings`], [`language`]) are lines of text, the same at the console, in
//! a file and in `show config`.
//!
//! # EtherCAT
//!
//! [`ethercat_subdevice`] is a SubDevice that knows nothing of the rest; [`fieldbus`] says what the gateway is as one: its objects,
//! its buffers and where the values of Modbus devices lie in them. The buffers are the memory of a [`scanner`] of their own,
//! whose requests go through the router by the rules for the `ethercat` port, as do those that a MainDevice makes by itself.
//! The devices are settings: what a MainDevice has had taken over is printed and saved with the others, by
//! [`gateway::Gateway::keep_settings`] also when it asks for that. A board with a controller keeps an
//! [`fieldbus::EthercatState`] in a static, gives it to [`gateway::Gateway::with_ethercat`], and runs
//! [`fieldbus::serve`], a [`SubDevice`](ethercat_subdevice::sub_device::SubDevice) with [`fieldbus::GatewayObjects`], over it. With
//! [`gateway::Gateway::with_ethercat_interfaces`] the settings name the network interface that leads to a controller in software.
//!
//! # Limits
//!
//! With the feature `small` some are lower, for boards with little memory. Without the feature `points` the gateway asks nothing by
//! itself: it holds no data points, and no memory for them. Without the feature `ipv6` settings take addresses
//! of IPv4 only, as boards with an Ethernet of their own do. Without `servers` a TCP client has one
//! server, at an address. Without `capture` it keeps no frames to be looked at. Without `paths` names of serial devices are
//! short, as boards need them.
//!
//! | limit | value | why |
//! | --- | --- | --- |
//! | [`settings::PORTS_MAX`] | 16, small: 8 | a cabinet's worth of lines and listeners |
//! | [`settings::DEVICE_BYTES_MAX`] | 255, without `paths`: 15 | a file's name: adapters under `/dev/serial/by-id` have more than 100 |
//! | [`settings::LINE_BYTES_MAX`] | 800, without `paths`: 640 | the longest line that settings print |
//! | [`settings::ROUTES_MAX`] | 64 | rules are tried in order, for each request |
//! | [`port::client::queue::WAITING_MAX`] | 64, small: 24 | orders that wait at a port; one more is answered 06h |
//! | [`port::client::cache::RESPONSES_MAX`] | 16, small: 8 | answers that a port keeps where a rule says `cache`, in [`port::client::cache::RESPONSE_BYTES_MAX`] bytes |
//! | [`gateway::unit_health::UNITS_MAX`] | 64, small: 16 | servers of a port, or loads of an RS-485 segment; the quietest healthy unit is forgotten first |
//! | [`gateway::unit_health::ALL_UNITS_MAX`] | 256, small: 64 | units of all ports together: few ports have as many as they may |
//! | [`stats::LOG_ENTRIES_MAX`] | 64 | transactions that `show log` remembers |
//! | [`port::client::pending::PENDING_MAX`] | 16 | requests open on one connection to a server, the specification's range |
//! | [`settings::PORT_SERVERS_MAX`], [`settings::SERVERS_MAX`] | 64 and 128, small: 8 and 16 | servers of one TCP client, and of all: the stations that one scanner asks on time |
//! | [`settings::SOCKETS_MAX`] | 16, small: 2 | connections that one port has at a time; each takes a future's memory |
//! | [`settings::SERVER_NAME_BYTES_MAX`] | 63, small: 31 | a server's name, one of which each line has |
//! | [`settings::UDP_REQUESTS_MAX`] | 32 | requests open at one UDP server; one more is answered 06h |
//! | [`scanner::DEVICES_MAX`] | 32 | devices that a scanner asks: the loads of an RS-485 segment |
//! | [`settings::SLAVES_MAX`] | 32 | devices behind the EtherCAT process image: all that a scanner asks |
//! | [`fieldbus::Room::MOST`], [`fieldbus::Room::LONG`] | 512; with `long-images` 1486 in and 1500 out | bytes of the process image each way: with three buffers of each, what a controller of 4 KiB holds, and one of 10 |
//! | [`scanner::ROWS_MAX`] | 136 | the four tables of each device, and some ranges that take two frames |
//! | [`scanner::VALUE_BYTES_MAX`] | 4096, without `long-images` 2048 | values of all rows: the longest image each way, and as much again as 1 KiB |
//! | [`settings::POINTS_MAX`] | 128, small: 64 | data points in the settings, of which there is one draft for all consoles |
//! | [`capture::FRAMES_MAX`], [`capture::BYTES_MAX`] | 64, 2048, small: half | frames that `show frames` remembers |
//! | frames, TCP connections | the board's | memory; a connection always has one frame of its own |
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
#[doc(hidden)] // Public for tests/ only.
pub mod port;
#[doc(hidden)] // Public for tests/ only.
pub mod routing;
pub mod scanner;
pub mod settings;
pub mod stats;
mod tasks;
