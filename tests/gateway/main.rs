//! What the gateway promises, by part: its pure parts by value, the whole in virtual time.

// Linked for the clock and the locks of a host.
use mobgate_clock as _;

mod answer_times;
mod audit;
mod cache;
mod candidates;
mod capture;
mod closing_server;
mod console_lines;
mod cut_answers;
mod cut_off;
mod cut_through;
mod cut_timing;
mod cut_torture;
mod decisions;
mod documents;
mod explain;
mod floods;
mod frames;
mod line;
mod matrix;
mod outcomes;
mod outstanding;
mod outstanding_model;
mod pending_requests;
mod points;
mod prelude;
mod proofs;
mod queue;
mod queue_model;
mod random_frames;
mod rules;
mod scan;
mod serial_server;
mod servers;
mod servers_torture;
mod sharing;
mod sniffer;
mod stream_server;
mod tcp_client;
mod tcp_torture;
mod torture;
mod tune;
mod units;
mod update;
mod visitors;
