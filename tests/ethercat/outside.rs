//! MainDevices in other programs, which reach the simulated segment over a pair of virtual network interfaces.

use std::process::Child;

use mobgate_simulator::esc::Segment;
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::own_network::{SEGMENT_END, in_own_network, start_master};

use mobgate_simulator::esc::samples::simple_device;

use crate::prelude::*;

/// Waits until `program` has ended, and sees to it that it ended well.
pub(crate) async fn ends_well(program: &mut Child) {
    let status = loop {
        if let Some(status) = program.try_wait().unwrap() {
            break status;
        }
        Timer::after_millis(10).await;
    };
    assert!(status.success(), "the MainDevice's script: {status}");
}

#[test]
fn pysoem_brings_simple_devices_to_op_over_a_virtual_cable() {
    in_own_network("outside::pysoem_brings_simple_devices_to_op_over_a_virtual_cable", || {
        let chips = (0..2).map(|_| Chip::new(Kind::ET1100, simple_device()));
        let segment = Rc::new(RefCell::new(Segment::new(chips)));
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let mut script = start_master("simple_devices.py", &[]);
        serve(&socket, &segment, ends_well(&mut script)).unwrap();
        let chip = segment.borrow().chip(1);
        let mut outputs = [0; 2];
        chip.borrow_mut().read(mobgate_simulator::esc::now(), 0x1000, &mut outputs);
        assert_eq!(outputs, [0x12, 0x34]);
    });
}
