//! The configuration flow: what is taken over, what follows from it, and that a bad configuration changes nothing.

use mobgate::ethercat::application::{Address, Application};
use mobgate::ethercat::coe::abort::Abort;
use mobgate::port::ethercat::{ConfigError, Configuration, EthercatPlace, GatewayObjects, REASON_BYTES};
use mobgate::scanner::Kind;
use mobgate_simulator::Random;
use mobgate_simulator::rig::with_gateway;

use super::virtual_devices::virtual_devices;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port ecat ethercat
    route ecat 1-247 * * bus";

/// Objects behind a gateway that has an `ethercat` port.
fn with_objects(test: impl FnOnce(&EthercatPlace, GatewayObjects<'_>)) {
    with_gateway(1, SETTINGS, |_, rig| {
        let place = rig.gateway.ethercat().unwrap();
        test(place, GatewayObjects::new(place));
    });
}

fn at(index: u16, sub: u8) -> Address {
    Address { index, sub }
}

fn read(objects: &mut GatewayObjects<'_>, index: u16, sub: u8) -> u32 {
    let mut value = [0; 4];
    let bytes = if sub == 10 && index < 0x2010 || (index, sub) == (0x2020, 1) { 4 } else { 2 };
    objects.read(at(index, sub), &mut value[..bytes]).unwrap();
    u32::from_le_bytes(value)
}

/// As an SDO does it, once the table has checked the range.
fn write(objects: &mut GatewayObjects<'_>, index: u16, sub: u8, value: u32) -> Result<(), Abort> {
    let value = value.to_le_bytes();
    objects.check(at(index, sub), &value)?;
    objects.write(at(index, sub), &value);
    Ok(())
}

fn reason(objects: &mut GatewayObjects<'_>) -> String {
    let mut text = [0; REASON_BYTES as usize];
    objects.read(at(0x2006, 0), &mut text).unwrap();
    str::from_utf8(&text).unwrap().trim_end_matches('\0').to_owned()
}

fn layout(objects: &mut GatewayObjects<'_>, device: u16) -> [u16; 10] {
    std::array::from_fn(|entry| read(objects, 0x2011 + device, entry as u8 + 1) as u16)
}

/// Writes 200xh: the id, then count and first address of each kind.
fn configure(objects: &mut GatewayObjects<'_>, device: u16, settings: &[u16]) {
    for (value, sub) in settings.iter().zip(1..) {
        write(objects, 0x2001 + device, sub, (*value).into()).unwrap();
    }
}

#[test]
fn the_devices_of_the_vectors_have_the_layout_of_the_vectors() {
    with_objects(|place, mut objects| {
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
    });
}

#[test]
fn a_configuration_in_use_is_changed_only_after_its_flag_was_reset() {
    with_objects(|place, mut objects| {
        write(&mut objects, 0x2005, 1, 1).unwrap();
        for (index, sub) in [(0x2000, 1), (0x2001, 1), (0x2004, 10), (0x2007, 2), (0x2020, 1)] {
            assert_eq!(write(&mut objects, index, sub, 1), Err(Abort::State), "{index:04x}");
        }
        write(&mut objects, 0x2005, 2, 0).unwrap();
        assert!(!place.is_running());
        write(&mut objects, 0x2000, 1, 3).unwrap();
        assert_eq!(read(&mut objects, 0x2000, 1), 3);
    });
}

#[test]
fn a_configuration_that_is_taken_over_begins_with_empty_buffers() {
    with_objects(|place, mut objects| {
        write(&mut objects, 0x2005, 1, 1).unwrap();
        objects.outputs(0x1600, &[7; 120]);
        write(&mut objects, 0x2005, 2, 0).unwrap();
        place.outputs(|outputs| assert_eq!(outputs, [7; 120]));
        write(&mut objects, 0x2005, 1, 1).unwrap();
        place.outputs(|outputs| assert_eq!(outputs, [0; 120]));
    });
}

#[test]
fn the_parity_bit_counts_among_the_bits_of_a_character() {
    for (bits, parity, good) in
        [(0, 0, true), (0, 2, false), (0, 3, false), (1, 0, false), (1, 2, true), (1, 3, true)]
    {
        with_objects(|_, mut objects| {
            write(&mut objects, 0x2020, 2, bits).unwrap();
            write(&mut objects, 0x2020, 3, parity).unwrap();
            let taken = write(&mut objects, 0x2005, 1, 1);
            assert_eq!(taken.is_ok(), good, "{bits},{parity}");
            if !good {
                assert_eq!(taken, Err(Abort::Incompatible));
                let expected = format!("2020h: {} bits with parity {parity} are not RTU", 8 + bits);
                assert_eq!(reason(&mut objects), expected);
            }
        });
    }
}

#[test]
fn without_a_port_that_asks_nothing_is_taken_over() {
    let place = EthercatPlace::new();
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
        rig.console("delete port ecat").unwrap();
        world.run_for(embassy_time::Duration::from_millis(1));
        assert!(!place.is_running());
        assert_eq!(write(&mut objects, 0x2005, 1, 1), Err(Abort::LocalControl));
    });
}

#[test]
fn every_reason_fits_into_its_object() {
    let longest = [
        ConfigError::InputsFull { device: 3 },
        ConfigError::OutputsFull { device: 3 },
        ConfigError::Character { bits: 9, parity: 3 },
        ConfigError::NoPort,
    ];
    let addresses = Kind::ALL.map(|kind| ConfigError::PastLastAddress { device: 3, kind });
    for error in longest.into_iter().chain(addresses) {
        assert!(error.to_string().len() <= REASON_BYTES.into(), "{error}");
    }
}

/// What a configuration should become, computed cell by cell: the layouts, unless it does not fit.
fn model(devices: &[Vec<u16>]) -> Option<Vec<[u16; 10]>> {
    let (mut input, mut output) = (Vec::new(), Vec::new());
    let mut layouts = Vec::new();
    for device in devices {
        let part = |buffer: &mut Vec<usize>, kinds: &[usize]| {
            let start = buffer.len();
            let mut places = vec![start as u16];
            for &kind in kinds {
                let (count, first) = (device[1 + 2 * kind], device[2 + 2 * kind]);
                (count == 0 || u32::from(first) + u32::from(count) - 1 <= 65_535).then_some(())?;
                places.push(buffer.len() as u16);
                let bytes: std::collections::BTreeSet<usize> = (0..usize::from(count))
                    .flat_map(|cell| if kind < 2 { vec![cell / 8] } else { vec![2 * cell, 2 * cell + 1] })
                    .collect();
                buffer.extend(bytes);
            }
            places.push(buffer.len().saturating_sub(1).max(start) as u16);
            (buffer.len() <= 120).then_some(places)
        };
        let places = [part(&mut input, &[0, 1, 2, 3])?, part(&mut output, &[0, 3])?].concat();
        layouts.push(places.try_into().unwrap());
    }
    Some(layouts)
}

fn random_device(random: &mut Random) -> Vec<u16> {
    let mut settings = vec![random.within(1..=247) as u16];
    for bits in [true, true, false, false] {
        let most = if bits { 70 } else { 9 };
        let most = if random.chance(0.03) { 65_535 } else { most };
        let count = random.within(0..=most) as u16;
        let last = 65_536 - u64::from(count);
        let address =
            if random.chance(0.05) { 65_535 - random.within(0..=80) } else { random.within(0..=last) };
        settings.extend([count, address.min(65_535) as u16]);
    }
    settings
}

#[test]
fn random_configurations_are_taken_over_as_a_model_says_or_not_at_all() {
    let mut random = Random::new(7);
    let (mut good, mut bad) = (0, 0);
    with_objects(|place, mut objects| {
        for round in 0..3_000_u32 {
            write(&mut objects, 0x2005, 2, 0).unwrap();
            let count = random.within(0..=4) as usize;
            let devices: Vec<_> = (0..4).map(|_| random_device(&mut random)).collect();
            write(&mut objects, 0x2000, 1, count as u32).unwrap();
            for (device, nth) in devices.iter().zip(0..) {
                configure(&mut objects, nth, device);
            }
            // What is not taken over must leave this as it is.
            objects.outputs(0x1600, &[round as u8; 120]);
            let before: Vec<_> = (0..4).map(|device| layout(&mut objects, device)).collect();
            let taken = write(&mut objects, 0x2005, 1, 1);
            let after: Vec<_> = (0..4).map(|device| layout(&mut objects, device)).collect();
            assert_eq!(place.is_running(), taken.is_ok());
            match model(&devices[..count]) {
                Some(mut layouts) => {
                    assert_eq!(taken, Ok(()), "{devices:?}");
                    layouts.resize(4, [0; 10]);
                    assert_eq!(after, layouts);
                    place.outputs(|outputs| assert_eq!(outputs, [0; 120]));
                    good += 1;
                }
                None => {
                    assert_eq!(taken, Err(Abort::Incompatible), "{devices:?}");
                    assert!(reason(&mut objects).starts_with("slave "));
                    assert_eq!(after, before);
                    place.outputs(|outputs| assert_eq!(outputs, [round as u8; 120]));
                    bad += 1;
                }
            }
        }
    });
    assert!(good > 300 && bad > 300, "{good} good, {bad} bad");
}

#[test]
fn the_configuration_after_power_on_can_be_used() {
    let plan = Configuration::default().plan().unwrap();
    assert_eq!(plan.speed.baud, 115_200);
    assert!(plan.layouts.iter().all(|layout| layout.0 == [0; 10]));
}
