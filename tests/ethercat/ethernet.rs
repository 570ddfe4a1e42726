//! Ethernet through mailboxes (EoE) with a MainDevice by others.

use std::net::Ipv4Addr;

use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::own_network::{SEGMENT_END, in_own_network, start_master_with};

use crate::outside::ends_well;
use crate::prelude::*;

#[test]
fn statement_52_soemx_sets_and_reads_addresses_and_gets_its_frames_back() {
    in_own_network("ethernet::statement_52_soemx_sets_and_reads_addresses_and_gets_its_frames_back", || {
        let line = line_of(&ETHERNET_128);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let application = Shared::new(Bench::default());
        application.0.borrow_mut().ethernet.link.echoes = true;
        let mut sub_device = SubDevice::new(&ETHERNET_128, esc, application.clone());
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let lengths = [14, 60, 118, 119, 500, 1513, 1514].map(|length: usize| length.to_string());
        let mut script = start_master_with("soemx", "ethernet.py", &lengths);
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        match serve(&socket, &line, select(device, ends_well(&mut script))).unwrap() {
            Either::First(never) => never,
            Either::Second(()) => {}
        }
        let settings = application.0.borrow().ethernet.link.settings.clone();
        assert_eq!(settings.address, Some(Ipv4Addr::new(10, 1, 2, 3)));
        assert_eq!(settings.gateway, Some(Ipv4Addr::new(10, 1, 0, 1)));
    });
}
