//! Modbus requests of the MainDevice's own, of any function, by SDO (2033h).

use mobgate_simulator::Device;
use mobgate_simulator::rig::Rig;

use super::bench::with_wire;
use super::objects::{SETTINGS, read, read_bytes, write, write_bytes};
use crate::prelude::*;

const OPEN: u32 = 255;

/// A device with the unit 5 behind the gateway, and the objects.
fn with_device(test: impl FnOnce(&mut World<'_>, &Rig<'_>, Device, GatewayObjects<'_>)) {
    with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone()]);
        test(world, rig, device, GatewayObjects::new(rig.gateway.ethercat().unwrap()));
    });
}

/// Asks, waits for the end; state, error and response.
fn ask(world: &mut World<'_>, objects: &mut GatewayObjects<'_>, request: &[u8]) -> (u32, u32, Vec<u8>) {
    write_bytes(objects, 0x2033, 1, request).unwrap();
    assert_eq!(read(objects, 0x2033, 2), OPEN);
    let mut passed = 0;
    while read(objects, 0x2033, 2) == OPEN {
        world.run_for(Duration::from_millis(1));
        passed += 1;
        assert!(passed < 15_000, "it comes to an end");
    }
    (read(objects, 0x2033, 2), read(objects, 0x2033, 4), read_bytes(objects, 0x2033, 3))
}

#[test]
fn requests_of_any_function_are_answered_without_a_configuration() {
    with_device(|world, _, device, mut objects| {
        device.memory().holding[16] = 0x1234;
        assert_eq!(ask(world, &mut objects, &[5, 3, 0, 16, 0, 1]), (1, 0, vec![3, 2, 0x12, 0x34]));
        assert_eq!(ask(world, &mut objects, &[5, 6, 0, 17, 0, 9]), (1, 0, vec![6, 0, 17, 0, 9]));
        assert_eq!(device.memory().holding[17], 9);
        let unknown = ask(world, &mut objects, &[5, 100, 1, 2, 3]);
        assert_eq!(unknown, (3, 0, vec![100 | 0x80, 1]), "a function that the device does not know");
        assert_eq!(read(&mut objects, 0x2005, 2), 0, "no configuration is in use");
    });
}

#[test]
fn a_response_of_two_bytes_is_no_exception_because_its_second_one_looks_like_it() {
    with_device(|world, _, device, mut objects| {
        // Read exception status: 0Ah and 0Bh are what the gateway itself says by an exception.
        for status in [0x0a, 0x0b] {
            device.set_response(&[7, status]);
            assert_eq!(ask(world, &mut objects, &[5, 7]), (1, 0, vec![7, status]));
        }
    });
}

#[test]
fn the_longest_request_and_the_longest_response_pass() {
    with_device(|world, _, device, mut objects| {
        let values: Vec<u8> = (0..246).map(|byte| byte as u8).collect();
        let request = [&[5, 16, 0, 0, 0, 123, 246][..], &values].concat();
        assert_eq!(ask(world, &mut objects, &request), (1, 0, vec![16, 0, 0, 0, 123]));
        assert_eq!(device.memory().holding[122], 0xf4f5);
        let (state, _, response) = ask(world, &mut objects, &[5, 3, 0, 0, 0, 125]);
        assert_eq!((state, response.len()), (1, 252));
        assert_eq!(response[2..248], values);
    });
}

#[test]
fn a_response_that_does_not_come_ends_in_an_error() {
    with_device(|world, rig, device, mut objects| {
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        assert_eq!(ask(world, &mut objects, &[5, 3, 0, 16, 0, 1]), (2, 5, vec![]), "no response in time");
        rig.console("delete routes").unwrap();
        assert_eq!(ask(world, &mut objects, &[5, 3, 0, 16, 0, 1]), (2, 7, vec![]), "no way to it");
    });
}

#[test]
fn what_a_rule_forbids_is_answered_by_its_exception_and_has_come_to_its_end() {
    with_device(|world, rig, device, mut objects| {
        rig.console("delete routes").unwrap();
        rig.console("route ecat 5 * * bus readonly").unwrap();
        assert_eq!(ask(world, &mut objects, &[5, 6, 0, 17, 0, 9]), (3, 0, vec![0x86, 1]));
        assert_eq!(ask(world, &mut objects, &[5, 3, 0, 16, 0, 1]).0, 1);
        assert_eq!(device.writes(), []);
    });
}

#[test]
fn nobody_answers_a_broadcast_and_that_is_no_error() {
    with_device(|world, rig, device, mut objects| {
        rig.console("route ecat 0 * * bus").unwrap();
        assert_eq!(ask(world, &mut objects, &[0, 6, 0, 17, 0, 9]), (0, 0, vec![]));
        world.run_for(Duration::from_millis(100));
        assert_eq!(device.memory().holding[17], 9);
    });
}

#[test]
fn one_request_is_open_at_a_time_and_bad_ones_are_refused() {
    with_device(|_, rig, _, mut objects| {
        let request = [5, 3, 0, 16, 0, 1];
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &[5]), Err(Abort::TooShort));
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &[5, 0]), Err(Abort::Range));
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &[5, 0x83, 2]), Err(Abort::Range));
        assert_eq!(read(&mut objects, 0x2033, 2), 0);
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &request), Ok(()));
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &request), Err(Abort::State));
        rig.console("delete routes").unwrap();
        rig.console("delete port ecat").unwrap();
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        assert_eq!(write_bytes(&mut objects, 0x2033, 1, &request), Err(Abort::LocalControl), "no port");
    });
}

#[test]
fn a_request_that_is_open_when_other_devices_are_taken_over_ends() {
    with_device(|world, _, _, mut objects| {
        write_bytes(&mut objects, 0x2033, 1, &[5, 3, 0, 16, 0, 1]).unwrap();
        // It is on the wire.
        world.run_for(Duration::from_millis(2));
        write(&mut objects, 0x2005, 1, 1).unwrap();
        world.run_for(Duration::from_millis(2));
        assert_eq!((read(&mut objects, 0x2033, 2), read(&mut objects, 0x2033, 4)), (2, 4));
        assert_eq!(ask(world, &mut objects, &[5, 3, 0, 16, 0, 1]), (1, 0, vec![3, 2, 5, 16]));
    });
}

#[test]
fn ethercrab_asks_a_device_on_the_wire_by_parts_of_four_bytes() {
    let device = Device::new(5);
    device.memory().holding[16] = 0x1234;
    with_wire(19_200, SETTINGS, vec![device], async |dispatcher, _| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(dispatcher.master, 0).unwrap();
        let parts = async |first: u32, second: u32, bytes: u8| {
            gateway.sdo_write(0x2034, 1, first).await.unwrap();
            gateway.sdo_write(0x2034, 2, second).await.unwrap();
            gateway.sdo_write(0x2033, 5, bytes).await.unwrap();
            while gateway.sdo_read::<u8>(0x2033, 2).await.unwrap() == OPEN as u8 {
                Timer::after_millis(1).await;
            }
            gateway.sdo_read::<u8>(0x2033, 2).await.unwrap()
        };
        let state = parts(u32::from_le_bytes([5, 3, 0, 16]), u32::from_le_bytes([0, 1, 0, 0]), 6).await;
        assert_eq!(state, 1);
        assert_eq!(gateway.sdo_read::<[u8; 4]>(0x2033, 3).await.unwrap(), [3, 2, 0x12, 0x34]);
        let state = parts(u32::from_le_bytes([5, 6, 0, 17]), u32::from_le_bytes([0, 9, 0xee, 0xee]), 6).await;
        assert_eq!(state, 1);
        assert_eq!(gateway.sdo_read::<[u8; 5]>(0x2033, 3).await.unwrap(), [6, 0, 17, 0, 9]);
        assert!(gateway.sdo_write(0x2033, 5, 6_u8).await.is_err(), "no parts have come since");
    });
}

#[test]
fn a_request_passes_the_mailbox_in_segments() {
    let mut rig = gateway_in(PRE_OP);
    assert_eq!(rig.download(0x2033, 1, &[5; 255]), Err(0x0607_0012), "too long");
    assert_eq!(rig.download(0x2033, 1, &[5]), Err(0x0607_0013), "too short");
    assert_eq!(rig.upload(0x2033, 1), Err(0x0601_0001), "it is only written");
    assert_eq!(rig.upload(0x2033, 3), Ok(vec![]));
    // The bench's port never asks: it stays open.
    assert_eq!(rig.download(0x2033, 1, &[[5, 16].as_slice(), &[0; 252]].concat()), Ok(()));
    assert_eq!(rig.upload(0x2033, 2), Ok(vec![255]));
    assert_eq!(rig.download(0x2033, 1, &[5, 3, 0, 0, 0, 1]), Err(0x0800_0022), "one at a time");
    assert_eq!(rig.download(0x2033, 1, &[5, 7]), Err(0x0800_0022));
}
