//! EtherCAT, from the frame on the wire to the driver of the controller chip, against the simulated chip.

// Linked for the clock and the locks of a host.
use mobgate_clock as _;

mod bench;
mod boot;
mod chip_resets;
mod clocks;
mod controllers;
mod documents;
mod esc_masters;
mod esi;
mod ethernet;
mod files;
mod foreign;
mod gateway;
mod information;
mod lan9252_access;
mod lan9252_bench;
mod lan9252_events;
mod lan9252_faults;
mod large_images;
mod lost_responses;
mod mad_writes;
mod mailbox;
mod masters;
mod outside;
mod own_objects;
mod prelude;
mod process_data;
mod pysoem;
mod sdo;
mod states;
mod torture;
