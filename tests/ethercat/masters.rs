//! A real MainDevice on the gateway's description: ethercrab, in process and in virtual time.

use mobgate::ethercat::device::Device;
use mobgate::port::ethercat::DEVICE;
use mobgate_simulator::esc::DirectPdi;
use mobgate_simulator::sub_device::{SharedEcho, start_up};

static GATEWAY: Device = DEVICE;

#[test]
fn ethercrab_brings_the_gateway_to_op_with_its_default_mapping() {
    let started = start_up(&GATEWAY, DirectPdi::new, SharedEcho::default()).unwrap();
    assert_eq!(started.working_counter, 3);
    assert!(started.round_trips >= 2 * (120 + 3), "each mapped entry is asked for: {started:?}");
    assert!(started.time.as_millis() <= 300, "{started:?}");
    println!("{started:?}");
}
