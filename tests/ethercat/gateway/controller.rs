//! A controller that is not there, comes, and goes, as the gateway's port shows it; and what is read of it, as the port is set.

use ethercat_subdevice::eoe::{Eoe, EthernetError, FRAME_BYTES_MAX, IpSettings, Link, NoEthernet};
use ethercat_subdevice::foe::NoFiles;
use ethercat_subdevice::lan9252::Lan9252 as Driver;
use mobgate::fieldbus::{Controller, LONG_DEVICE, long_device, serve, serve_long};
use mobgate::gateway::Status;
use mobgate_simulator::esc::{MainDevice, SharedSegment};
use mobgate_simulator::rig::{Rig, Size, with_gateway_on};
use mobgate_simulator::sub_device::line_of_kind;
use mobgate_simulator::world::Clock;

use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port ecat ethercat line bus
    route ecat 1-247 * * bus";

/// The gateway's side of EtherCAT runs at the chip of `line`, which has this `timing`.
fn serve_at<'g>(world: &World<'g>, rig: &Rig<'g>, line: &SharedSegment, timing: Timing) -> Lan9252 {
    let place = rig.gateway.ethercat().unwrap();
    let lan9252 = Lan9252::new(line.borrow().chip(0), timing);
    let driver = Driver::new(lan9252.spi(), Wiring::default());
    let mut interrupt = lan9252.interrupt();
    world.spawn(async move {
        serve(place, None, NoFiles, driver, None, async || interrupt.wait_for_high().await.unwrap()).await;
    });
    lan9252
}

#[test]
fn the_port_says_that_no_controller_responds_and_works_when_one_does() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let port = || rig.gateway.ports()[1].status();
        let line = line_of(&GATEWAY);
        // It stays in reset for as long as this holds.
        let absent = Timing { test_nanos: u64::MAX / 2, ..Timing::USUAL };
        let lan9252 = serve_at(world, rig, &line, absent);
        world.run_for(Duration::from_secs(9));
        assert!(matches!(place.controller(), Controller::Missing(_)), "{:?}", place.controller());
        assert!(matches!(port(), Status::Failed(_)), "{:?}", port());

        lan9252.set_timing(Timing::USUAL);
        world.run_for(Duration::from_secs(2));
        assert_eq!((place.controller(), port()), (Controller::Present, Status::Open));
        with_master(world, cable(line.clone()), async |dispatcher| {
            dispatcher.to_pre_op().await.unwrap();
        });

        lan9252.set_timing(absent);
        lan9252.reset();
        world.run_for(Duration::from_secs(2));
        assert!(matches!(place.controller(), Controller::Lost(_)), "{:?}", place.controller());
        assert_eq!(port(), Status::Lost);
        lan9252.set_timing(Timing::USUAL);
        world.run_for(Duration::from_secs(2));
        assert_eq!((place.controller(), port()), (Controller::Present, Status::Open));
        with_master(world, cable(line.clone()), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.unwrap();
            let device = group.subdevice(dispatcher.master, 0).unwrap();
            assert_eq!(device.sdo_read::<u8>(0x10f3, 2).await.unwrap(), 6, "it tells of that once");
            assert_eq!(device.sdo_read::<[u8; 25]>(0x10f3, 6).await.unwrap()[6], 6, "by its text");
        });
    });
}

/// The product code and the objects F000h, as ethercrab reads them at `line`.
fn product(world: &mut World<'_>, line: &SharedSegment) -> (u32, Option<u16>) {
    with_master(world, cable(line.clone()), async |dispatcher| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        let product = device.sdo_read(0x1018, 2).await.unwrap();
        (product, device.sdo_read(0xf000, 2).await.ok())
    })
}

#[test]
fn the_setting_modules_makes_it_another_device_at_once_also_in_op() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let line = line_of(&GATEWAY);
        serve_at(world, rig, &line, Timing::USUAL);
        world.run_for(Duration::from_secs(2));
        let fixed = GATEWAY.identity.product;
        assert_eq!(product(world, &line), (fixed, None));
        with_master(world, cable(line.clone()), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.unwrap();
            let group = dispatcher.to_op(group, 0).await.unwrap();
            rig.console("edit port ecat modules").unwrap();
            Timer::after_millis(200).await;
            assert!(!group.tx_rx(dispatcher.master).await.unwrap().all_op(), "it starts anew");
        });
        assert_eq!(product(world, &line), (fixed + 1, Some(32)));
        assert_eq!(place.controller(), Controller::Present);
        rig.console("edit port ecat no-modules").unwrap();
        world.run_for(Duration::from_millis(200));
        assert_eq!(product(world, &line), (fixed, None));
        with_master(world, cable(line.clone()), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.unwrap();
            dispatcher.to_op(group, 0).await.unwrap();
        });
    });
}

#[test]
fn the_setting_modules_makes_a_gateway_with_long_images_the_modular_one_with_long_images() {
    static LONG: Device = LONG_DEVICE;
    let size = Size { ethercat: EthercatState::long, ..Size::default() };
    with_gateway_on(Clock::Virtual, size, 1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let line = line_of_kind(Kind::IP_CORE, &LONG);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        world.spawn(async move {
            let attention = async || interrupt.wait_for_high().await.unwrap();
            serve_long(place, None, NoFiles, NoEthernet, esc, None, attention).await;
        });
        world.run_for(Duration::from_secs(2));
        let fixed = LONG.identity.product;
        for _ in 0..2 {
            assert_eq!(product(world, &line), (fixed, None));
            rig.console("edit port ecat modules").unwrap();
            world.run_for(Duration::from_millis(200));
            assert_eq!(product(world, &line), (fixed + 1, Some(32)));
            rig.console("edit port ecat no-modules").unwrap();
            world.run_for(Duration::from_millis(200));
        }
    });
}

/// A network that has no frames.
struct Silent;

impl Link for Silent {
    fn receive(&mut self, _frame: &[u8]) {}

    fn transmit(&mut self, _into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        None
    }

    fn settings(&mut self) -> Result<IpSettings, EthernetError> {
        Ok(IpSettings::default())
    }
}

#[test]
fn the_setting_ethernet_makes_it_a_device_that_offers_it_at_once_also_with_modules() {
    let size = Size { ethercat: EthercatState::long, ethercat_interfaces: true, ..Size::default() };
    let settings = SETTINGS.replace("line bus", "line bus interface eth1");
    with_gateway_on(Clock::Virtual, size, 1, &settings, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let chip = line_of_kind(Kind::IP_CORE, long_device(false, false)).borrow().chip(0);
        let (esc, mut interrupt) = direct(chip.clone());
        world.spawn(async move {
            let attention = async || interrupt.wait_for_high().await.unwrap();
            serve_long(place, None, NoFiles, Eoe::new(Silent), esc, None, attention).await;
        });
        for (words, offered) in [
            ("on-loss stop", false),
            ("ethernet eoe0", true),
            ("modules", true),
            ("ethernet none", false),
            ("ethernet eoe1 no-modules", true),
        ] {
            rig.console(&format!("edit port ecat {words}")).unwrap();
            world.run_for(Duration::from_millis(200));
            let device = long_device(words == "modules" || words == "ethernet none", offered);
            let mut master = MainDevice::new(chip.clone(), device);
            let message = world.run_until(async {
                master.bring_to(AlState::PreOp).await.unwrap();
                // "Get IP" and its response, or the mailbox's error 2.
                let mut request = [0; 128];
                request[..10].copy_from_slice(&[4, 0, 0, 0, 0, 0x12, 6, 1, 0, 0]);
                master.write(device.memory.start(Channel::MailboxOut), &request).await.unwrap();
                Timer::after_millis(5).await;
                master.read(device.memory.start(Channel::MailboxIn), 128).await.unwrap()
            });
            let expected = if offered { (2, [7, 1, 0, 0]) } else { (0, [1, 0, 2, 0]) };
            assert_eq!((message[5] & 0x0f, message[6..10].try_into().unwrap()), expected, "{words}");
        }
    });
}

#[test]
fn a_board_with_a_controller_takes_no_network_interface() {
    with_gateway(1, SETTINGS, |_, rig| {
        for words in ["interface eth1", "ethernet eoe0"] {
            let refused = rig.console(&format!("edit port ecat {words}")).unwrap_err();
            let expected =
                "the EtherCAT controller is wired to this board: there is no network interface to choose";
            assert_eq!(refused, expected);
        }
        assert_eq!(rig.gateway.settings(|settings| settings.ethercat().unwrap().interface.clone()), None);
    });
}

#[test]
fn outputs_are_proved_from_the_setting_on_while_process_data_go_on() {
    /// A read of 120 bytes: address and length, the bytes, and the proof that all came.
    const READ_BYTES: u64 = 145;
    const CYCLES: u64 = 50;
    with_gateway(1, SETTINGS, |world, rig| {
        let line = line_of(&GATEWAY);
        let lan9252 = serve_at(world, rig, &line, Timing::USUAL);
        // Until the controller is found.
        world.run_for(Duration::from_secs(2));
        with_master(world, cable(line.clone()), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.unwrap();
            let group = dispatcher.to_op(group, 0).await.unwrap();
            // Its arrival there is told.
            Timer::after_millis(1).await;
            let mut cost = Vec::new();
            for words in ["", "prove-outputs", "no-prove-outputs"] {
                rig.console(&format!("edit port ecat {words} on-loss hold")).unwrap();
                lan9252.take_traffic();
                for _ in 0..CYCLES {
                    let seen = group.tx_rx(dispatcher.master).await.unwrap();
                    assert!(seen.all_op() && seen.working_counter == 3, "{words}: {seen:?}");
                    Timer::after_millis(1).await;
                }
                cost.push(lan9252.take_traffic().bytes / CYCLES);
            }
            let [once, proved, once_again] = cost[..] else { unreachable!() };
            assert!(proved.abs_diff(once + READ_BYTES) <= 1, "{once} bytes, then {proved}");
            assert!(once.abs_diff(once_again) <= 1, "{once} bytes, at the end {once_again}");
        });
    });
}
