//! What many of the figures use.

pub(crate) use embassy_time::{Duration, Instant, Timer};
pub(crate) use mobgate_simulator::client::Response;
pub(crate) use mobgate_simulator::client::load::ClosedLoop;
pub(crate) use mobgate_simulator::fault::When;
pub(crate) use mobgate_simulator::rig::{Rig, machine, with_gateway};
pub(crate) use mobgate_simulator::{Client, Device, Fault, Faults, Random, World, rig};

pub(crate) use crate::{Target, figure};
