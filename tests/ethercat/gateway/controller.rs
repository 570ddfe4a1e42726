//! A controller that is not there, comes, and goes, as the gateway's port shows it.

use embassy_time::Duration;
use embedded_hal_async::digital::Wait;
use mobgate::ethercat::device::Device;
use mobgate::ethercat::lan9252::{Lan9252 as Driver, Wiring};
use mobgate::gateway::Status;
use mobgate::port::ethercat::{Controller, DEVICE, serve};
use mobgate_simulator::Lan9252;
use mobgate_simulator::lan9252::Timing;
use mobgate_simulator::rig::with_gateway;
use mobgate_simulator::sub_device::{cable, line_of, with_master};

static GATEWAY: Device = DEVICE;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port ecat ethercat line bus
    route ecat 1-247 * * bus";

#[test]
fn the_port_says_that_no_controller_answers_and_works_when_one_does() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let port = || rig.gateway.ports()[1].status();
        let line = line_of(&GATEWAY);
        // It stays in reset for as long as this holds.
        let absent = Timing { test_nanos: u64::MAX / 2, ..Timing::USUAL };
        let lan9252 = Lan9252::new(line.borrow().chip(0), absent);
        let driver = Driver::new(lan9252.spi(), Wiring::default());
        let mut interrupt = lan9252.interrupt();
        world.spawn(async move {
            serve(place, driver, async || interrupt.wait_for_high().await.unwrap()).await;
        });
        world.run_for(Duration::from_secs(9));
        assert!(matches!(place.controller(), Controller::Missing(_)), "{:?}", place.controller());
        assert!(matches!(port(), Status::Failed(_)), "{:?}", port());

        lan9252.set_timing(Timing::USUAL);
        world.run_for(Duration::from_secs(2));
        assert_eq!((place.controller(), port()), (Controller::Present, Status::Open));
        with_master(world, cable(line.clone()), async |desk| {
            desk.to_pre_op().await.unwrap();
        });

        lan9252.set_timing(absent);
        lan9252.reset();
        world.run_for(Duration::from_secs(2));
        assert!(matches!(place.controller(), Controller::Lost(_)), "{:?}", place.controller());
        assert_eq!(port(), Status::Lost);
        lan9252.set_timing(Timing::USUAL);
        world.run_for(Duration::from_secs(2));
        assert_eq!((place.controller(), port()), (Controller::Present, Status::Open));
    });
}
