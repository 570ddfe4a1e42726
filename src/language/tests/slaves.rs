//! Slaves as lines: what is accepted, and what each error says.

use std::format;
use std::string::ToString;
use std::vec::Vec;

use super::{error, load, print, std};
use crate::language::*;
use crate::scanner::{ByteOrder, ValueType};
use crate::settings::*;

const SLAVES: &str = "port ecat ethercat
slave 0 unit 232 coil 10 count 18 discrete 10010 count 3 input 30010 count 6 holding 40010 count 4
slave 1 unit 7 holding 9005 read 20ms check on-silence substitute 4660
slave 2 unit 1 on-silence clear
slave 3 unit 5 input 0 count 3 as f32 holding 40 count 2 as i16 order 2301
";

#[test]
fn slaves_are_what_a_main_device_configures() {
    let settings = load(SLAVES);
    assert!(print(&settings).ends_with(SLAVES.split_once('\n').unwrap().1));
    assert_eq!(load(&print(&settings)), settings);
    let [first, second, third, fourth] = &settings.slaves[..] else { panic!("four") };
    let cells = |count, address| Cells { count, address };
    assert_eq!(first.cells, [cells(18, 10), cells(3, 10_010), cells(6, 30_010), cells(4, 40_010)]);
    assert_eq!((first.unit, first.polling_ms, first.check, first.filling()), (232, 1_000, false, None));
    assert_eq!((second.cells[3], second.polling_ms, second.check), (cells(1, 9_005), 20, true));
    assert_eq!((second.filling(), third.filling()), (Some(4_660), Some(0)));
    assert_eq!(fourth.cells, [cells(0, 0), cells(0, 0), cells(6, 0), cells(2, 40)]);
    assert_eq!((fourth.types, fourth.order), ([ValueType::F32, ValueType::I16], ByteOrder::Order2301));
}

#[test]
fn slaves_keep_their_order_and_belong_to_their_port() {
    let mut settings = load(SLAVES);
    apply(&mut settings, "slave 1 unit 9").unwrap();
    assert_eq!(settings.slaves[1], SlaveSettings::new(9));
    apply(&mut settings, "delete slave 0").unwrap();
    assert_eq!(settings.slaves.iter().map(|slave| slave.unit).collect::<Vec<_>>(), [9, 1, 5]);
    for line in ["delete port ecat", "port ecat scanner"] {
        let error = apply(&mut settings, line).unwrap_err().to_string();
        assert!(error.ends_with("this port polls the slaves: delete them first"), "{error}");
    }
    apply(&mut settings, "delete slaves").unwrap();
    apply(&mut settings, "delete port ecat").unwrap();
    for nth in 0..SLAVES_MAX {
        let line = format!("slave {nth} unit 1");
        assert!(apply(&mut settings, &line).is_err(), "no port asks it");
    }
    apply(&mut settings, "port ecat ethercat").unwrap();
    for nth in 0..SLAVES_MAX {
        apply(&mut settings, &format!("slave {nth} unit 1")).unwrap();
    }
    assert!(apply(&mut settings, &format!("slave {SLAVES_MAX} unit 1")).is_err(), "there are no more");
}

#[test]
fn what_is_wrong_with_a_slave_is_said() {
    let cases = [
        ("slave 5 unit 1", "\"5\": expected the next slave's number, or that of one there is, from 0 to 4"),
        ("slave 0 unit 1 coil 0 as u16", "\"as\": is for registers only"),
        ("slave 0 unit 1 input 0 as f16", "\"f16\": expected u16, i16, u32, i32"),
        #[cfg(feature = "long-values")] // Else the type is refused.
        ("slave 0 unit 1 input 65533 as f64", "\"65533\": the cells go beyond address 65535"),
        #[cfg(feature = "long-values")] // As above.
        ("slave 0 unit 1 input 0 as text", "\"text\": expected u16, i16, u32, i32"),
        ("slave 0 unit 1 input 65535 as f32", "\"65535\": the cells go beyond address 65535"),
        ("slave 0 unit 1 order 4321", "\"4321\": expected 0123, 2301, 1032 or 3210"),
        ("slave 0", "end of line: expected unit and the slave's unit id"),
        ("slave 0 unit 248", "expected a unit id from 1 to 247"),
        ("slave 0 unit 1 holding", "end of line: expected an address as it is on the wire"),
        ("slave 0 unit 1 holding 65535 count 2", "\"65535\": the cells go beyond address 65535"),
        ("slave 0 unit 1 holding 0 count 0", "\"0\": expected cells from 1 to 65535"),
        ("slave 0 unit 1 holding 0 holding 9", "\"holding\": is set twice in this line"),
        ("slave 0 unit 1 read 0", "expected a time from 1ms to 3600s"),
        ("slave 0 unit 1 read 1.5ms", "expected whole milliseconds"),
        ("slave 0 unit 1 on-silence", "expected hold, clear or substitute"),
        ("slave 0 unit 1 on-silence substitute", "expected a register's value"),
        ("slave 0 unit 1 onsilence clear", "did you mean on-silence?"),
        ("delete slave 4", "expected a slave's number from 0 to 3"),
    ];
    let mut settings = load(SLAVES);
    for (line, expected) in cases {
        let before = settings.clone();
        let error = apply(&mut settings, line).unwrap_err().to_string();
        assert!(error.contains(expected), "{line}: {error}");
        assert_eq!(settings, before);
    }
    assert!(error("slave 0 unit 1").contains("there is no EtherCAT port: type port NAME ethercat first"));
}

#[test]
fn the_port_has_an_id_or_the_alias_of_the_eeprom() {
    let mut settings = Settings::new();
    for (line, id) in [
        ("port X ethercat id 17", Some(17)),
        ("edit port X id 65535", Some(65_535)),
        ("edit port X id alias", None),
    ] {
        apply(&mut settings, line).unwrap();
        assert_eq!(settings.ethercat().unwrap().id, id, "{line}");
    }
}

#[test]
fn what_is_wrong_with_the_port_is_said() {
    let cases = [
        (
            "port X ethercat line 7",
            "column 22: \"7\": expected a port name: a letter, then letters, digits, - _ or ., at most 15, not local, discard or nopath",
        ),
        ("port X ethercat on-loss", "column 24: end of line: expected hold, clear or stop"),
        (
            "port X ethercat interface",
            "column 26: end of line: expected a network interface such as eth1, at most 15 characters",
        ),
        (
            "port X ethercat interface sixteen-letters0",
            "column 27: \"sixteen-letters0\": expected a network interface such as eth1, at most 15 characters",
        ),
        (
            "port X ethercat on-los stop",
            "column 17: \"on-los\": expected interface, line, on-loss, id, modules, emergencies",
        ),
        ("port X ethercat on-los stop", "; did you mean on-loss?"),
        #[cfg(feature = "eoe")]
        (
            "port X ethercat ethernet sixteen-letters0",
            "column 26: \"sixteen-letters0\": expected a network interface such as eth1, at most 15 characters",
        ),
        ("port X ethercat id 0", "column 20: \"0\": expected alias, or an id from 1 to 65535"),
    ];
    for (line, expected) in cases {
        let error = error(line);
        assert!(error.contains(expected), "{line}: {error}");
    }
}
