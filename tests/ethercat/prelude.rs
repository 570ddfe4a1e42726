//! What many of these tests use.

pub(crate) use embassy_futures::select::{Either, select};
pub(crate) use embassy_time::{Duration, Instant, Timer};
pub(crate) use embedded_hal_async::digital::Wait;
pub(crate) use ethercat_description::{esi, sii};
pub(crate) use ethercat_subdevice::al_state::AlState;
pub(crate) use ethercat_subdevice::application::Application;
pub(crate) use ethercat_subdevice::coe::abort::Abort;
pub(crate) use ethercat_subdevice::device::Device;
pub(crate) use ethercat_subdevice::esc::Esc;
pub(crate) use ethercat_subdevice::foe::FileAccess;
pub(crate) use ethercat_subdevice::lan9252::{InterruptPin, Wiring};
pub(crate) use ethercat_subdevice::object::{DataType, Object};
pub(crate) use ethercat_subdevice::sub_device::SubDevice;
pub(crate) use ethercat_subdevice::sync_manager::Channel;
pub(crate) use ethercrab::error::{Error, MailboxError};
pub(crate) use mobgate::fieldbus::{DEVICE, EthercatState, GatewayObjects};
pub(crate) use mobgate::language::apply;
pub(crate) use mobgate::settings::Settings;
pub(crate) use mobgate_simulator::esc::{Chip, Command, Kind};
pub(crate) use mobgate_simulator::fault::When;
pub(crate) use mobgate_simulator::lan9252::Timing;
pub(crate) use mobgate_simulator::random::each_seed;
pub(crate) use mobgate_simulator::rig::{settings_of, with_gateway};
pub(crate) use mobgate_simulator::sub_device::{
    Dispatcher, Group, Paced, SharedEcho, cable, direct, image, line_of, note_pulses, spawn, with_master,
};
pub(crate) use mobgate_simulator::{Fault, Faults, Lan9252, Random, World};
pub(crate) use roxmltree::{Document, Node};
pub(crate) use std::cell::RefCell;
pub(crate) use std::rc::Rc;

pub(crate) use crate::bench::*;
