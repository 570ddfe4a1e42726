//! The gateway's own unit: points that TCP and serial masters read and write, what they see of a device's variables, and
//! what they are told when they ask for what is not there.

use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1 timeout 100ms
    port plc serial uart2 rtu server 19200 8E1
    port P502 tcp server 502
    port scan scanner
    route scan 5 * * bus
    route P502 1 * * local
    route P502 2 * * local readonly
    route plc 1 * * local
    device meter unit 5
    point power meter holding 0 count 4 read high
    point limit meter holding 10 count 2 write auto read high
    point fixed meter holding 20 write manual
    point lamps meter coil 0 count 10 read normal write auto
    point ints local holding 1 count 8 as i16
    point floats local holding 10 count 8 as f32
    point flags local coil 3 count 10
    point seen local input 100 of power quality 200
    point set local holding 40 of limit quality 202
    point kept local holding 50 of fixed
    point shown local discrete 7 of lamps
    point last local holding 65535";

fn ask(world: &mut World<'_>, rig: &Rig<'_>, pdu: &[u8]) -> Vec<u8> {
    match rig.ask(world, 1, pdu) {
        Answer::Pdu(pdu) => pdu,
        other => panic!("{other:?}"),
    }
}

fn scanner<R>(rig: &Rig<'_>, f: impl FnOnce(&mut Scanner) -> R) -> R {
    rig.gateway.scanner().unwrap().with(f)
}

#[test]
fn variables_of_the_gateway_are_written_and_read_back_over_the_bounds_of_rows() {
    with_gateway(1, SETTINGS, |world, rig| {
        assert_eq!(ask(world, rig, &[3, 0, 1, 0, 2]), [3, 4, 0, 0, 0, 0]);
        assert_eq!(ask(world, rig, &[6, 0, 8, 0x12, 0x34]), [6, 0, 8, 0x12, 0x34]);
        assert_eq!(ask(world, rig, &[16, 0, 7, 0, 1, 2, 9, 9]), [16, 0, 7, 0, 1]);
        assert_eq!(ask(world, rig, &[3, 0, 7, 0, 2]), [3, 4, 9, 9, 0x12, 0x34]);
        // Big end first: 1.5 is 3FC0 0000.
        assert_eq!(ask(world, rig, &[16, 0, 10, 0, 2, 4, 0x3f, 0xc0, 0, 0]), [16, 0, 10, 0, 2]);
        let value = scanner(rig, |scanner| mobgate::scanner::ValueType::F32.take(scanner.input(RowId(5))));
        assert_eq!(value.unwrap().to_string(), "1.5");
        assert_eq!(ask(world, rig, &[5, 0, 4, 0xff, 0]), [5, 0, 4, 0xff, 0]);
        assert_eq!(ask(world, rig, &[15, 0, 10, 0, 3, 1, 0b101]), [15, 0, 10, 0, 3]);
        assert_eq!(ask(world, rig, &[1, 0, 3, 0, 10]), [1, 2, 0b1000_0010, 0b10]);
        assert_eq!(ask(world, rig, &[6, 0xff, 0xff, 0, 3]), [6, 0xff, 0xff, 0, 3]);
    });
}

#[test]
fn rows_that_follow_each_other_are_read_as_one_and_a_hole_is_no_address() {
    let settings = SETTINGS.replace("holding 10 count 8 as f32", "holding 9 count 8 as f32");
    with_gateway(1, &settings, |world, rig| {
        assert_eq!(ask(world, rig, &[3, 0, 1, 0, 24]).len(), 2 + 48);
        assert_eq!(ask(world, rig, &[3, 0, 1, 0, 25]), [0x83, 2]);
        assert_eq!(ask(world, rig, &[3, 0, 0, 0, 1]), [0x83, 2]);
        // All or nothing.
        assert_eq!(ask(world, rig, &[16, 0, 24, 0, 2, 4, 1, 1, 1, 1]), [0x90, 2]);
        assert_eq!(ask(world, rig, &[3, 0, 24, 0, 1]), [3, 2, 0, 0]);
        assert_eq!(ask(world, rig, &[3, 0xff, 0xff, 0, 2]), [0x83, 2]);
    });
}

#[test]
fn a_devices_variables_come_from_memory_at_once_with_their_age_and_status() {
    with_gateway(1, SETTINGS, |world, rig| {
        assert_eq!(ask(world, rig, &[4, 0, 201, 0, 1]), [4, 2, 0xff, 0xff], "never read");
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone()]);
        world.run_for(30 * SECOND);
        let before = device.counters().all_requests();
        let asked = Instant::now();
        for _ in 0..100 {
            let answer = rig.ask(world, 1, &[4, 0, 100, 0, 4]);
            assert_eq!(answer, Answer::Pdu(vec![4, 8, 5, 0, 5, 1, 5, 2, 5, 3]));
        }
        assert!(asked.elapsed() < 5 * MS);
        assert!(device.counters().all_requests() <= before + 1, "the bus does not notice");
        let [4, 4, _, status, 0, tenths] = ask(world, rig, &[4, 0, 200, 0, 2])[..] else { panic!() };
        assert!(status & 2 != 0 && tenths <= 2, "{status:02x} {tenths}");
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        world.run_for(12 * SECOND);
        let [4, 4, _, status, 0, tenths] = ask(world, rig, &[4, 0, 200, 0, 2])[..] else { panic!() };
        assert_eq!(status & 0b1_0000, 0b1_0000, "left alone");
        assert!((115..=122).contains(&tenths), "{tenths}");
        assert_eq!(ask(world, rig, &[4, 0, 100, 0, 1]), [4, 2, 5, 0], "the last value is kept");
        assert_eq!(ask(world, rig, &[2, 0, 7, 0, 10])[..2], [2, 2]);
    });
}

#[test]
fn a_write_to_a_devices_variable_goes_on_to_the_device_and_only_where_it_is_automatic() {
    with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone()]);
        world.run_for(SECOND);
        assert_eq!(ask(world, rig, &[16, 0, 40, 0, 2, 4, 0, 7, 0, 8]), [16, 0, 40, 0, 2]);
        world.run_for(100 * MS);
        assert_eq!(device.memory().holding[10..12], [7, 8]);
        assert_eq!(device.writes().len(), 1);
        assert_eq!(ask(world, rig, &[6, 0, 50, 0, 1]), [0x86, 2]);
        assert_eq!(ask(world, rig, &[6, 0, 100, 0, 1]), [0x86, 2], "that is an input register");
        assert_eq!(rig.ask(world, 2, &[6, 0, 1, 0, 1]).exception(), Some(1));
        world.run_for(SECOND);
        assert_eq!(device.writes().len(), 1);
    });
}

#[test]
fn a_serial_master_and_a_tcp_master_see_the_same_and_their_last_errors_have_the_codes_of_the_vectors() {
    with_gateway(1, SETTINGS, |world, rig| {
        let mut master = rig.master("uart2");
        // The gateway listens before it believes that a request is one.
        world.run_for(SECOND);
        let last = |name: &str| {
            let port = rig.gateway.settings(|settings| settings.find(name)).unwrap();
            rig.gateway.ports()[port.index()].stats.last_error()
        };
        assert_eq!(last("P502"), LastError::None);
        assert_eq!(world.run_until(master.request(1, &[6, 0, 1, 0, 77])), Answer::Pdu(vec![6, 0, 1, 0, 77]));
        assert_eq!(ask(world, rig, &[3, 0, 1, 0, 1]), [3, 2, 0, 77]);
        for (pdu, exception, error) in [
            (&[3, 0, 0, 0, 1][..], 2, LastError::Address),
            (&[7], 1, LastError::Function),
            (&[65, 1], 1, LastError::Function),
            (&[3, 0, 1, 0, 126], 3, LastError::Response),
            (&[1, 0, 3, 0x7d, 0], 3, LastError::Response),
            (&[5, 0, 3, 1, 0], 3, LastError::Value),
            (&[15, 0, 3, 0, 9, 1, 0], 3, LastError::Value),
        ] {
            assert_eq!(ask(world, rig, pdu), [pdu[0] | 0x80, exception], "{pdu:02x?}");
            assert_eq!(last("P502"), error, "{pdu:02x?}");
            assert_eq!(world.run_until(master.request(1, pdu)).exception(), Some(exception), "{pdu:02x?}");
            assert_eq!(last("plc"), error, "{pdu:02x?}");
        }
    });
}
