//! The EtherCAT SubDevice: how long ethercrab takes to start it, and how images fare.

use ethercat_subdevice::device::Device;
use mobgate::fieldbus::DEVICE;
use mobgate_simulator::lan9252::over_spi;
use mobgate_simulator::sub_device::{exchange_images, start_up};

use crate::prelude::*;

static GATEWAY: Device = DEVICE;

const CYCLES: u64 = 100_000;
/// Between two accesses of the processor at most; an image takes about a dozen.
const PAUSE_US: u64 = 20;

pub(crate) fn figures() {
    let started = start_up(&GATEWAY, over_spi).expect("ethercrab reaches Op over SPI");
    let millis = started.time.as_micros() as f64 / 1e3;
    figure("ethercat_init_to_op", millis, "ms", Target::AtMost(300.0));
    figure("ethercat_init_to_op_mailbox_round_trips", started.round_trips as f64, "requests", Target::None);
    figure("ethercat_init_to_op_frames", started.frames as f64, "frames", Target::None);

    let exchanged = exchange_images(&GATEWAY, CYCLES, PAUSE_US).expect("ethercrab exchanges images");
    figure("ethercat_cycles", CYCLES as f64, "cycles", Target::None);
    figure("ethercat_short_working_counters", exchanged.short as f64, "cycles", Target::AtMost(0.0));
    figure("ethercat_images_lost", exchanged.lost as f64, "images", Target::AtMost(0.0));
    figure("ethercat_images_torn_or_old", exchanged.wrong as f64, "images", Target::AtMost(0.0));
}
