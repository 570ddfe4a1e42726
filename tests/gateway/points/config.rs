//! The lines of data points: what they set, what is wrong with bad ones, and that nothing is ever half applied.

use mobgate::frame::FramePool;
use mobgate::gateway::{Gateway, Ports};
use mobgate::language::{apply, write_line};
use mobgate::scanner::{Period, ScannerState, ValueType};
use mobgate::settings::PointAt;

use crate::prelude::*;

const GOOD: &str = "port  scan scanner
port  bus  serial uart1 rtu client 19200 8E1
route scan 1-247   * * bus
device meter unit 5 order 2301 label \"Main meter\"
device valve unit 9 check
point power  meter input 0 count 8 as f32 read high label \"Active power, W\"
point limit  meter holding 65535 write auto
point open   valve coil 3 count 10 read 250ms write auto multiple
point alarm  valve discrete 0 read low
point lamps  valve coil 16 count 32 as i16 write auto
point total  valve discrete 64 count 32 as u32
point run    meter holding 40 bit 3 write change
point fault  meter input 40 bit 15 read high
point speed  valve holding 40001 as i16 read manual
point energy meter holding 200 count 2 as u64
point flow   valve holding 210 as f64 scale 0.001
point serial meter input 100 as text 8
point heat   meter input 120 as i16 scale 0.1 offset -40
point mode   meter holding 41 bits 4-7 write auto
point alive  valve holding 42 write every 30s
point wide   valve coil 64 count 64 as i64
point seen   local input 100 of power quality 200
point kept   local holding 7 count 4 as u32
point lamp   local coil 0
point panel  local holding 20 of lamps
point runs   local coil 9 of run
point heats  local input 500 of heat
point raw    local holding 600 as i64 scale 10 offset 0.5
";

fn print(settings: &Settings) -> String {
    let mut text = String::new();
    for n in 0.. {
        let Some(written) = write_line(settings, n, &mut text) else { break };
        written.unwrap();
        text.push('\n');
    }
    text
}

fn error(line: &str) -> String {
    let mut settings = settings_of(GOOD);
    let before = settings.clone();
    let error = apply(&mut settings, line).unwrap_err();
    assert_eq!(settings, before, "{line} changed something");
    error.to_string()
}

#[test]
fn lines_of_devices_and_points_are_printed_as_they_were_typed() {
    let squeezed = |text: &str| {
        text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect::<Vec<_>>()
    };
    assert_eq!(squeezed(&print(&settings_of(GOOD))), squeezed(GOOD));
}

#[test]
fn a_point_that_is_written_by_itself_is_polled_only_if_it_says_when() {
    for (words, read, write) in [
        ("", Reading::Normal, Writing::Manual),
        ("write manual", Reading::Normal, Writing::Manual),
        ("write auto", Reading::Manual, Writing::Auto),
        ("write change", Reading::Manual, Writing::OnChange),
        ("read normal write auto", Reading::Normal, Writing::Auto),
        ("write change read high", Reading::High, Writing::OnChange),
        ("read manual", Reading::Manual, Writing::Manual),
        ("write every 2m", Reading::Manual, Writing::Every(Period(120_000))),
        ("read low write every 1ms", Reading::Low, Writing::Every(Period(1))),
    ] {
        let mut settings = settings_of(GOOD);
        apply(&mut settings, &format!("point new meter holding 100 {words}")).unwrap();
        let PointAt::Device { read: is_read, write: is_written, .. } = settings.points.last().unwrap().at
        else {
            panic!("{words}")
        };
        assert_eq!((is_read, is_written), (read, write), "{words}");
        assert_eq!(settings_of(&print(&settings)), settings, "{words}");
    }
}

#[test]
fn a_number_alone_is_modicons_notation_and_one_behind_a_table_is_that_of_the_wire() {
    for (modicon, wire) in [
        ("1", "coil 0"),
        ("9999", "coil 9998"),
        ("10001", "discrete 0"),
        ("30001", "input 0"),
        ("40001", "holding 0"),
        ("49999", "holding 9998"),
        ("410001", "holding 10000"),
        ("465536", "holding 65535"),
        ("300005", "input 4"),
        ("165536", "discrete 65535"),
    ] {
        let mut settings = settings_of(GOOD);
        apply(&mut settings, &format!("point new meter {modicon}")).unwrap();
        let point = settings.points.last().unwrap();
        assert_eq!(format!("{} {}", point.kind, point.first), wire);
        let long = mobgate::scanner::Modicon(point.kind, point.first).to_string();
        let expected = match modicon {
            "300005" => "30005",
            same => same,
        };
        assert_eq!(long.parse::<u32>().unwrap().to_string(), expected);
    }
    for bad in ["0", "10000", "20001", "50001", "100000", "166000", "465537"] {
        assert!(error(&format!("point new meter {bad}")).contains("such as 40001"), "{bad}");
    }
}

/// Lines, and the error that each gets on top of [`GOOD`].
const ERRORS: &str = r#"
point => column 6: end of line: expected a name for the point, as for a port
point x => column 8: end of line: expected the name of a device, or local
point x metr holding 0 => column 9: "metr": there is no device of this name
point x meter holdng 0 => column 15: "holdng": expected coil, discrete, input or holding, or a number such as 40001; did you mean holding?
point x meter holding 70000 => column 23: "70000": expected an address as it is on the wire from 0 to 65535
point x meter holding 0 count 124 => column 31: "124": expected values in a frame from 1 to 123
point x meter input 0 count 63 as f32 => column 29: "63": expected values in a frame from 1 to 62
point x meter coil 0 count 1969 => column 28: "1969": expected values from 1 to 1968
point x meter holding 65535 as u32 => column 15: "holding": the cells go beyond address 65535
point x local coil 50 count 16 as u16 => column 32: "as": is for registers only
point x meter coil 0 bit 3 => column 22: "bit": is for registers only
point x meter coil 0 count 17 as u16 => column 28: "17": expected a multiple of 16: a value has that many bits
point x meter coil 0 as u32 count 16 => column 35: "16": expected a multiple of 32: a value has that many bits
point x meter coil 65521 count 16 as u16 => column 15: "coil": the cells go beyond address 65535
point x meter holding 0 bit 16 => column 29: "16": expected a bit of the register from 0 to 15
point x meter holding 0 bit 3 count 2 => column 31: "count": bits of a register have neither count nor type
point x meter holding 0 as i16 bit 3 => column 32: "bit": bits of a register have neither count nor type
point x meter input 0 bit 3 write auto => column 29: "write": discrete inputs and input registers cannot be written
point x local holding 900 bit 3 => column 27: "bit": expected count, as, of, quality, scale, offset or label
point x local holding 900 of run => column 30: "run": has bits where the other has numbers
point x local coil 900 of lamps => column 27: "lamps": has numbers where the other has bits
point x meter input 0 write auto => column 23: "write": discrete inputs and input registers cannot be written
point x meter holding 0 read 250 => column 30: "250": expected a time with its unit, such as 300ms, 1.75ms, 750us, 1s or 2m
point x meter holding 0 read 750us => column 30: "750us": expected a time from 1ms to 3600s
point x meter holding 0 read 1.5ms => column 30: "1.5ms": expected whole milliseconds
point x meter holding 0 read sometimes => column 30: "sometimes": expected low, normal, high, manual, or a period such as 250ms
point x meter holding 0 count 2 count 3 => column 33: "count": is set twice in this line
point x meter holding 0 of power => column 25: "of": expected count, as, bit, read, write, multiple, bits, scale, offset or label
point x local holding 0 read high => column 25: "read": expected count, as, of, quality, scale, offset or label
point x local holding 10 => column 15: "holding": another local point has cells there
point x local input 201 => column 15: "input": another local point has cells there
point x local input 0 quality 199 => column 15: "input": another local point has cells there
point x local input 0 quality 0 => column 15: "input": another local point has cells there
point x local holding 900 of open => column 30: "open": has bits where the other has numbers
point x local holding 900 of seen => column 30: "seen": has no variable of its own
point x local holding 900 of nobody => column 30: "nobody": there is no point of this name
point x local holding 900 of power count 2 => column 36: "count": cannot be combined with of: the other point has the values
point power local input 900 of kept => column 7: "power": comes before the point that it would show: delete it first
point power meter input 0 count 7 as f32 => column 7: "power": another point shows this one: delete or change that first
point x meter holding 0 label "this label is too long for it" => column 31: "this label is too long for it": expected a label of at most 23 bytes, in quotes
point x meter holding 0 label "open => column 31: ""open": expected a label of at most 23 bytes, in quotes
point local meter holding 0 => column 7: "local": expected a name for the point, as for a port
device x => column 9: end of line: expected unit and the device's unit id
device x unit 256 => column 15: "256": expected a unit id from 1 to 255
device x unit 5 order 3201 => column 23: "3201": expected 0123, 2301, 1032 or 3210; did you mean 2301?
delete device meter => column 15: "meter": points refer to this device: delete them first
delete point power => column 14: "power": another point shows this one: delete or change that first
delete point nobody => column 14: "nobody": there is no point of this name
port other scanner => column 12: "scanner": another port is the scanner
port scan tcp server 502 => column 6: "scan": this port polls the devices: delete them first
port other scanner broadcast all => column 20: "broadcast": expected the end of the line
edit port scan broadcast all => column 16: "broadcast": a scanner has nothing to set
route scan 1 10.0.0.1 * bus => column 14: "10.0.0.1": clients of this source have no IP address: expected *
"#;

#[test]
fn an_error_names_the_word_and_its_column() {
    for case in ERRORS.trim().lines() {
        let (line, expected) = case.split_once(" => ").unwrap();
        assert_eq!(error(line), expected, "{line}");
    }
    let mut empty = Settings::new();
    let error = apply(&mut empty, "device x unit 5").unwrap_err().to_string();
    assert_eq!(error, "column 8: \"x\": there is no scanner port: type port NAME scanner first");
}

#[test]
fn devices_points_and_values_are_bounded() {
    let mut settings = settings_of("port scan scanner\n");
    for unit in 1..=32 {
        apply(&mut settings, &format!("device d{unit} unit {unit}")).unwrap();
    }
    let full = apply(&mut settings, "device d33 unit 33").unwrap_err().to_string();
    assert_eq!(full, "column 8: \"d33\": there are 32 devices already, the maximum");
    for point in 0..128 {
        apply(&mut settings, &format!("point p{point} d1 holding {point}")).unwrap();
    }
    let full = apply(&mut settings, "point more d1 holding 0").unwrap_err().to_string();
    assert_eq!(full, "column 7: \"more\": there are 128 points already, the maximum");
    for point in 0..16 {
        let _ = apply(&mut settings, &format!("point p{point} d1 holding 0 count 123"));
    }
    let full = apply(&mut settings, "point p17 d1 holding 0 count 123").unwrap_err().to_string();
    assert_eq!(full, "column 14: \"holding\": the values of all points would take more than 4096 bytes");
    assert_eq!(settings_of(&print(&settings)), settings);
}

#[test]
fn places_close_up_when_a_device_or_a_point_goes() {
    let mut settings = settings_of(GOOD);
    for line in [
        "delete point runs",
        "delete point run",
        "delete point fault",
        "delete point seen",
        "delete point power",
        "delete point limit",
        "delete point energy",
        "delete point serial",
        "delete point heats",
        "delete point heat",
        "delete point mode",
        "delete device meter",
    ] {
        apply(&mut settings, line).unwrap();
    }
    assert_eq!(settings_of(&print(&settings)), settings);
    apply(&mut settings, "point shows local coil 50 of open").unwrap();
    apply(&mut settings, "delete point alarm").unwrap();
    assert!(print(&settings).contains("coil 50 of open"));
    assert!(print(&settings).contains("open  valve coil 3"));
}

/// A line of the language, good or bad.
fn any_line() -> impl Strategy<Value = String> {
    let name = || prop::sample::select(vec!["a", "b", "c", "d"]);
    let kind = || prop::sample::select(vec!["coil", "discrete", "input", "holding", "hold"]);
    let option = prop::sample::select(vec![
        "count 2",
        "count 60",
        "count 123",
        "as f32",
        "as u32",
        "count 32",
        "bit 3",
        "bits 4-7",
        "as u64",
        "as f64",
        "as text 7",
        "scale 0.1",
        "scale -2.50",
        "offset -40",
        "write every 30s",
        "read high",
        "read manual",
        "read 10ms",
        "write auto",
        "write manual",
        "multiple",
        "of a",
        "of b",
        "quality 5",
        "quality 100",
        "label \"x y\"",
        "nonsense",
    ]);
    let options = move || prop::collection::vec(option.clone(), 0..4).prop_map(|words| words.join(" "));
    let point = |place: &'static str| {
        (name(), kind(), 0..40_u16, options()).prop_map(move |(name, kind, first, options)| {
            format!("point {name} {place} {kind} {first} {options}")
        })
    };
    prop_oneof![
        4 => point("m"),
        2 => point("n"),
        4 => point("local"),
        1 => (name(), prop::sample::select(vec!["40001", "30007", "7", "20001"]))
            .prop_map(|(name, at)| format!("point {name} m {at}")),
        2 => name().prop_map(|name| format!("delete point {name}")),
        1 => prop::sample::select(vec!["delete device m", "delete device n", "delete port scan"]).prop_map(str::to_owned),
        2 => (prop::sample::select(vec!["m", "n"]), 0..300_u16, prop::sample::select(vec!["", "check", "order 2301"]))
            .prop_map(|(name, unit, options)| format!("device {name} unit {unit} {options}")),
    ]
}

proptest! {
    #[test]
    fn random_lines_are_applied_whole_or_not_at_all_and_the_scanner_has_what_the_settings_say(
        lines in prop::collection::vec(any_line(), 1..40),
    ) {
        let places = Ports::<2>::new();
        let pool = FramePool::new(&[], 0);
        let scanner = ScannerState::new();
        let gateway = Gateway::new(&pool, &places, &[]).with_scanner(&scanner);
        let mut settings = settings_of("port scan scanner\ndevice m unit 1\ndevice n unit 2\n");
        gateway.apply(&settings).unwrap();
        for line in lines {
            let before = settings.clone();
            if apply(&mut settings, &line).is_err() {
                prop_assert_eq!(&settings, &before, "{}", line);
                continue;
            }
            prop_assert_eq!(&settings_of(&print(&settings)), &settings, "{}", line);
            gateway.apply(&settings).unwrap();
            scanner.with(|scanner| {
                prop_assert_eq!((scanner.devices(), scanner.rows()), (settings.devices.len(), settings.points.len()));
                for (at, device) in settings.devices.iter().enumerate() {
                    prop_assert_eq!(scanner.device(DeviceId(at as u8)), Some(&device.device));
                }
                for (at, point) in settings.points.iter().enumerate() {
                    let row = scanner.row(RowId(at as u8)).unwrap();
                    prop_assert_eq!((row.kind, row.first, row.count), (point.kind, point.first, point.cells()));
                    let bytes = match point.value {
                        ValueType::Bit => usize::from(point.count).div_ceil(8),
                        value => usize::from(2 * point.count * value.registers()),
                    };
                    prop_assert_eq!(scanner.input(RowId(at as u8)).len(), bytes);
                }
                Ok(())
            })?;
        }
    }
}
