//! SOEM, by pysoem, on the gateway's SubDevice over a virtual cable.

use embassy_futures::select::{Either, select};
use embedded_hal_async::digital::Wait;
use mobgate::ethercat::device::Device;
use mobgate::ethercat::sub_device::SubDevice;
use mobgate::port::ethercat::{DEVICE, EthercatPlace, GatewayObjects};
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::sub_device::{direct, line_of};

use crate::bench::Shared;
use crate::outside::{SEGMENT_END, ends_well, in_own_network, start_master};

static GATEWAY: Device = DEVICE;

#[test]
fn pysoem_starts_the_gateway_reads_its_objects_and_meets_its_watchdog() {
    in_own_network("pysoem::pysoem_starts_the_gateway_reads_its_objects_and_meets_its_watchdog", || {
        let line = line_of(&GATEWAY);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let place = EthercatPlace::new();
        let objects = Shared::new(GatewayObjects::new(&place));
        let mut sub_device = SubDevice::new(&GATEWAY, esc, objects.clone());
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let identity = [GATEWAY.identity.vendor, GATEWAY.identity.product].map(|number| number.to_string());
        let mut script = start_master("gateway.py", &identity);
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        match serve(&socket, &line, select(device, ends_well(&mut script))).unwrap() {
            Either::First(never) => never,
            Either::Second(()) => {}
        }
        let last = (0..120).map(|byte: u32| (499 + byte) as u8).collect::<Vec<_>>();
        place.outputs(|outputs| assert_eq!(outputs[..120], last, "the outputs of its last cycle"));
        assert!(!objects.0.borrow().outputs_valid(), "which are not valid any more");
    });
}
