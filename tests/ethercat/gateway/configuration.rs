//! The configuration flow: what is taken over, what follows from it, and that a bad configuration changes nothing.

use mobgate::fieldbus::{ConfigError, Configuration, REASON_BYTES, Room};
use mobgate::scanner::Kind;
use mobgate::settings::PortKind;

use super::objects::{SETTINGS, configure, layout, objects, read, reason, write};
use super::virtual_devices::virtual_devices;
use crate::prelude::*;

#[test]
fn the_devices_of_the_vectors_have_the_layout_of_the_vectors() {
    let (place, mut objects) = objects();
    for (device, nth) in virtual_devices().iter().zip(0..) {
        configure(&mut objects, nth, &device.settings());
    }
    assert_eq!(layout(&mut objects, 0), [0; 10]);
    write(&mut objects, 0x2005, 1, 1).unwrap();
    assert_eq!((read(&mut objects, 0x2005, 1), read(&mut objects, 0x2005, 2)), (0, 1));
    for (device, nth) in virtual_devices().iter().zip(0..) {
        assert_eq!(layout(&mut objects, nth), device.layout);
    }
    assert!(place.is_running());
}

#[test]
fn a_configuration_in_use_is_changed_in_pre_op_only_and_is_not_in_use_then() {
    let (place, mut objects) = objects();
    write(&mut objects, 0x2005, 1, 1).unwrap();
    objects.entered(AlState::SafeOp);
    for (index, sub) in [(0x2000, 1), (0x2001, 1), (0x2004, 10), (0x2007, 2), (0x2020, 1)] {
        assert_eq!(write(&mut objects, index, sub, 1), Err(Abort::State), "{index:04x}");
    }
    objects.entered(AlState::PreOp);
    write(&mut objects, 0x2000, 1, 4).unwrap();
    assert!(place.is_running(), "there are four already");
    write(&mut objects, 0x2000, 1, 3).unwrap();
    assert!(!place.is_running());
    assert_eq!((read(&mut objects, 0x2000, 1), read(&mut objects, 0x2005, 2)), (3, 0));
}

#[test]
fn a_configuration_that_is_taken_over_begins_with_empty_buffers() {
    let (place, mut objects) = objects();
    write(&mut objects, 0x2005, 1, 1).unwrap();
    objects.outputs(0x1600, &[7; 120]);
    write(&mut objects, 0x2005, 2, 0).unwrap();
    place.outputs(|outputs| assert_eq!(outputs[..120], [7; 120]));
    write(&mut objects, 0x2005, 1, 1).unwrap();
    place.outputs(|outputs| assert_eq!(outputs, [0; 512]));
}

#[test]
fn the_parity_bit_may_count_among_the_bits_of_a_character_and_need_not() {
    for (bits, parity, good) in
        [(0, 0, true), (0, 2, true), (0, 3, true), (1, 0, false), (1, 2, true), (1, 3, true)]
    {
        let (_, mut objects) = objects();
        write(&mut objects, 0x2020, 2, bits).unwrap();
        write(&mut objects, 0x2020, 3, parity).unwrap();
        let taken = write(&mut objects, 0x2005, 1, 1);
        assert_eq!(taken.is_ok(), good, "{bits},{parity}");
        if !good {
            assert_eq!(taken, Err(Abort::Incompatible));
            let expected = format!("2020h: {} bits with parity {parity} are not RTU", 8 + bits);
            assert_eq!(reason(&mut objects), expected);
        }
    }
}

#[test]
fn without_a_port_that_asks_nothing_is_taken_over() {
    let place = EthercatState::new();
    let mut objects = GatewayObjects::new(&place);
    assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::LocalControl));
    assert_eq!(reason(&mut objects), "no ethercat port is set");
    assert!(!place.is_running());
}

#[test]
fn when_its_port_is_deleted_a_configuration_is_not_in_use_any_more() {
    with_gateway(1, SETTINGS, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        write(&mut objects, 0x2005, 1, 1).unwrap();
        rig.console("edit port ecat on-loss clear").unwrap();
        world.run_for(embassy_time::Duration::from_millis(1));
        assert!(place.is_running(), "a changed port is no other port");
        rig.console("delete routes").unwrap();
        rig.console("delete slaves").unwrap();
        rig.console("delete port ecat").unwrap();
        world.run_for(embassy_time::Duration::from_millis(1));
        assert!(!place.is_running());
        assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::LocalControl));
    });
}

#[test]
fn the_line_of_the_port_is_set_as_the_master_wants_it_until_somebody_sets_it_otherwise() {
    let settings = SETTINGS.replace("port ecat ethercat", "port ecat ethercat line bus");
    with_gateway(1, &settings, |world, rig| {
        let mut objects = GatewayObjects::new(rig.gateway.ethercat().unwrap());
        let mut run = || world.run_for(embassy_time::Duration::from_millis(1));
        let speed = || {
            rig.gateway.settings(|settings| {
                let Some(PortKind::Serial(serial)) = settings.ports[0].as_ref().map(|port| &port.kind) else {
                    panic!("the first port is the line")
                };
                serial.line.speed().to_string()
            })
        };
        for (sub, value) in [(1, 38_400), (2, 0), (3, 0), (4, 1)] {
            write(&mut objects, 0x2020, sub, value).unwrap();
        }
        run();
        assert_eq!(speed(), "19200 8E1", "it has not been taken over yet");
        write(&mut objects, 0x2005, 1, 1).unwrap();
        run();
        assert_eq!(speed(), "38400 8N2");
        rig.console("edit port bus 9600 8O1").unwrap();
        rig.console("edit port ecat on-loss hold").unwrap();
        run();
        assert_eq!(speed(), "9600 8O1");
        write(&mut objects, 0x2005, 2, 0).unwrap();
        write(&mut objects, 0x2005, 1, 1).unwrap();
        run();
        assert_eq!(speed(), "38400 8N2");

        for (bits, parity, expected) in
            [(0, 2, "38400 8E2"), (1, 2, "38400 8E2"), (0, 3, "38400 8O2"), (1, 3, "38400 8O2")]
        {
            write(&mut objects, 0x2005, 2, 0).unwrap();
            write(&mut objects, 0x2020, 2, bits).unwrap();
            write(&mut objects, 0x2020, 3, parity).unwrap();
            write(&mut objects, 0x2005, 1, 1).unwrap();
            run();
            assert_eq!(speed(), expected, "{bits},{parity}");
        }

        write(&mut objects, 0x2005, 2, 0).unwrap();
        rig.console("edit port ecat line other").unwrap();
        assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::LocalControl));
        assert_eq!(reason(&mut objects), "the ethercat port's line is no RTU client");
    });
}

#[test]
fn every_reason_fits_into_its_object() {
    let longest = [
        ConfigError::InputsFull { slave: 31, room: 512 },
        ConfigError::OutputsFull { slave: 31, room: 512 },
        ConfigError::MemoryFull { values: "output", bytes: 1_500, room: 1_144 },
        ConfigError::Character { bits: 9, parity: 3 },
        ConfigError::NoPort,
        ConfigError::NoLine,
        ConfigError::NotInUse,
        ConfigError::NoStore,
        ConfigError::NotSaved,
        ConfigError::EntriesFull { slave: 31 },
        ConfigError::OtherModule { slave: 31 },
        ConfigError::ModulesInUse,
    ];
    let addresses = Kind::ALL.map(|kind| ConfigError::PastLastAddress { slave: 31, kind });
    let halves = Kind::ALL.map(|kind| ConfigError::HalfValue { slave: 31, kind });
    for error in longest.into_iter().chain(addresses).chain(halves) {
        assert!(error.to_string().len() <= REASON_BYTES.into(), "{error}");
    }
}

#[test]
fn an_image_may_fill_its_room_to_the_last_byte_and_not_a_byte_more() {
    let (place, mut objects) = objects();
    write(&mut objects, 0x2000, 1, 1).unwrap();
    // 60 holding registers: 120 bytes each way.
    configure(&mut objects, 0, &[1, 0, 0, 0, 0, 0, 0, 60, 0]);
    let plan = |inputs, outputs| {
        place.configuration(|configuration| configuration.plan(Room { inputs, outputs }).map(|_| ()))
    };
    assert_eq!(plan(120, 120), Ok(()));
    assert_eq!(plan(119, 120), Err(ConfigError::InputsFull { slave: 0, room: 119 }));
    assert_eq!(plan(120, 119), Err(ConfigError::OutputsFull { slave: 0, room: 119 }));

    write(&mut objects, 0x2005, 1, 1).unwrap();
    assert_eq!(layout(&mut objects, 0), [0, 0, 0, 0, 0, 119, 0, 0, 0, 119], "they are used to the last");
    write(&mut objects, 0x2005, 2, 0).unwrap();
    configure(&mut objects, 0, &[1, 0, 0, 1, 0, 0, 0, 60, 0]);
    assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::Incompatible));
    assert_eq!(reason(&mut objects), "slave 0 ends past the 120 input bytes");
}

#[test]
fn a_value_of_32_bits_is_not_cut_in_two() {
    let (place, mut objects) = objects();
    place.follow(&settings_of("port ecat ethercat\nslave 0 unit 1 input 0 count 2 as f32"), true);
    write(&mut objects, 0x2001, 6, 3).unwrap();
    assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::Incompatible));
    assert_eq!(reason(&mut objects), "slave 0: half a value of input");
    write(&mut objects, 0x2001, 6, 6).unwrap();
    assert_eq!(write(&mut objects, 0x2005, 1, 1), Ok(()));
}

#[test]
fn the_configuration_after_power_on_can_be_used() {
    assert_eq!(Configuration::default().plan(Room::FIRST).unwrap().baud, 115_200);
    assert_eq!(Configuration::default().slaves().len(), 4);
}
