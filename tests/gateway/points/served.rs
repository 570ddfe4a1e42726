//! What clients of the gateway's own unit get, against a model that keeps each cell by itself; and the borders of tables,
//! rows and numbers.

use mobgate::scanner::{Full, Modicon, ROWS_MAX, TypedValue, ValueType};
use proptest::collection::vec;

use super::{START, add, answered, at, exchange, response, row, scanner, scanner_with};
use crate::prelude::*;

/// Rows without a device: table, first cell, cells.
const ROWS: [(Kind, u16, u16); 8] = [
    (Kind::Holding, 2, 8),
    (Kind::Holding, 10, 4),
    (Kind::Holding, 65_534, 2),
    (Kind::Input, 0, 5),
    (Kind::Coil, 3, 13),
    (Kind::Coil, 16, 5),
    (Kind::Coil, 65_530, 6),
    (Kind::Discrete, 1, 17),
];

fn served() -> Scanner {
    let (mut scanner, device) = scanner();
    for (kind, first, count) in ROWS {
        add(&mut scanner, Row { device: None, ..row(device, kind, first, count) });
    }
    scanner
}

/// What the request gets of `cells`, which has all that are there, and what it makes of them.
fn model(cells: &mut HashMap<(u8, u16), u16>, request: &[u8]) -> Result<Vec<u8>, Exception> {
    let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
    let table = match request[0] {
        1 | 5 | 15 => 1,
        2 => 2,
        3 | 6 | 16 => 3,
        4 => 4,
        _ => return Err(Exception::ILLEGAL_FUNCTION),
    };
    let count = if matches!(request[0], 5 | 6) { 1 } else { word(3) };
    let addresses = (0..count).map(|nth| word(1).checked_add(nth).map(|address| (table, address)));
    let places: Option<Vec<(u8, u16)>> = addresses.collect();
    let places = places.filter(|places| places.iter().all(|place| cells.contains_key(place)));
    let places = places.ok_or(Exception::ILLEGAL_ADDRESS)?;
    let bit = |nth: usize| u16::from(request[6 + nth / 8] >> (nth % 8) & 1);
    for (nth, place) in places.iter().enumerate() {
        let value = match request[0] {
            5 => u16::from(request[3] != 0),
            6 => word(3),
            15 => bit(nth),
            16 => word(6 + 2 * nth),
            _ => cells[place],
        };
        cells.insert(*place, value);
    }
    let values: Vec<u16> = places.iter().map(|place| cells[place]).collect();
    let data: Vec<u8> = match request[0] {
        1 | 2 => values
            .chunks(8)
            .map(|bits| bits.iter().rev().fold(0, |byte, bit| byte << 1 | *bit as u8))
            .collect(),
        3 | 4 => values.iter().flat_map(|value| value.to_be_bytes()).collect(),
        _ => return Ok(request[..5].to_vec()),
    };
    Ok([vec![request[0], data.len() as u8], data].concat())
}

/// Requests about cells that are there, beside them, and over the bounds of rows.
fn any_request() -> impl Strategy<Value = Vec<u8>> {
    let first = prop_oneof![8 => 0..20_u16, 1 => 65_528..=65_535_u16];
    (0..=8_usize, first, 1..=17_u16, vec(any::<u8>(), 34)).prop_map(|(function, first, count, data)| {
        let function = [1, 2, 3, 4, 5, 6, 15, 16, 23][function];
        let second = match function {
            5 => u16::from(data[0] & 1) * 0xff00,
            6 => u16::from_be_bytes([data[0], data[1]]),
            _ => count,
        };
        let bytes = match function {
            15 => usize::from(count).div_ceil(8),
            16 => 2 * usize::from(count),
            _ => 0,
        };
        let head = [vec![function], first.to_be_bytes().to_vec(), second.to_be_bytes().to_vec()].concat();
        let counted = if bytes > 0 { vec![bytes as u8] } else { vec![] };
        [head, counted, data[..bytes].to_vec()].concat()
    })
}

proptest! {
    #[test]
    fn clients_read_what_was_written_whichever_rows_the_cells_belong_to(requests in vec(any_request(), 1..60)) {
        let mut scanner = served();
        let cells = ROWS.iter().flat_map(|(kind, first, count)| {
            (0..*count).map(move |nth| ((kind.read_function(), first + nth), 0))
        });
        let mut cells: HashMap<(u8, u16), u16> = cells.collect();
        for request in requests {
            let response = scanner.serve(&request, START).map(|pdu| pdu.to_vec());
            prop_assert_eq!(response, model(&mut cells, &request), "{:?}", request);
        }
    }
}

#[test]
fn the_longest_read_is_answered_and_what_no_response_holds_is_refused() {
    let (mut scanner, device) = scanner();
    add(&mut scanner, Row { device: None, ..row(device, Kind::Holding, 0, 200) });
    add(&mut scanner, Row { device: None, ..row(device, Kind::Coil, 0, 2_100) });
    let mut bytes = |function, count: u16| {
        let [high, low] = count.to_be_bytes();
        scanner.serve(&[function, 0, 0, high, low], START).map(|pdu| pdu.len())
    };
    assert_eq!((bytes(3, 125), bytes(3, 126)), (Ok(252), Err(Exception::ILLEGAL_VALUE)));
    assert_eq!((bytes(1, 2_008), bytes(1, 2_009)), (Ok(253), Err(Exception::ILLEGAL_VALUE)));
    assert_eq!(scanner.serve(&[16, 0, 0, 0, 1], START), Err(Exception::ILLEGAL_VALUE));
    assert_eq!(scanner.serve(&[3, 0, 0, 0], START), Err(Exception::ILLEGAL_FUNCTION));
}

#[test]
fn clients_write_a_devices_variable_where_it_goes_on_by_itself() {
    for (write, open) in
        [(Writing::Never, false), (Writing::Manual, false), (Writing::Auto, true), (Writing::OnChange, true)]
    {
        let (mut scanner, device) = scanner();
        let polled = add(&mut scanner, Row { write, ..row(device, Kind::Holding, 0, 2) });
        let shown = Row { device: None, of: Some(polled), ..row(device, Kind::Holding, 50, 2) };
        scanner.add_row(shown, START).unwrap();
        let written = scanner.serve(&[16, 0, 50, 0, 2, 4, 1, 2, 3, 4], START).map(|pdu| pdu.to_vec());
        let expected = if open { Ok(vec![16, 0, 50, 0, 2]) } else { Err(Exception::ILLEGAL_ADDRESS) };
        assert_eq!(written, expected, "{write:?}");
        assert_eq!(scanner.input(polled), if open { &[1, 2, 3, 4] } else { &[0; 4] }, "{write:?}");
        assert_eq!(scanner.status(polled, START).any(Status::WRITE_MARKED), open, "{write:?}");
        assert_eq!(scanner.age(polled, START), None, "a device's value is as old as its last reading");
    }
}

#[test]
fn only_cells_that_are_there_are_put_and_only_where_the_row_is_written() {
    let (mut scanner, device, never) = scanner_with(|device| row(device, Kind::Input, 0, 2));
    let own =
        add(&mut scanner, Row { device: None, write: Writing::Never, ..row(device, Kind::Input, 0, 2) });
    let flags = add(&mut scanner, row(device, Kind::Coil, 0, 10));
    let mut put = |id, from, count, cells: &[u8]| scanner.put(id, from, count, cells, START);
    assert_eq!(put(never, 0, 1, &[1, 2]), Err(Refused::ReadOnly));
    assert_eq!(put(own, 0, 1, &[1, 2]), Ok(()));
    assert_eq!(put(own, 1, 1, &[3, 4]), Ok(()));
    assert_eq!(put(own, 1, 2, &[5, 6, 7, 8]), Err(Refused::NotThere));
    assert_eq!(put(own, 2, 1, &[5, 6]), Err(Refused::NotThere));
    assert_eq!(put(own, u16::MAX, 1, &[5, 6]), Err(Refused::NotThere));
    assert_eq!(put(own, 0, 2, &[5, 6, 7]), Err(Refused::NotThere));
    assert_eq!(put(flags, 2, 8, &[0b1010_0101]), Ok(()));
    assert_eq!(put(flags, 2, 9, &[0xff]), Err(Refused::NotThere));
    assert_eq!(put(flags, 0, 9, &[0xff]), Err(Refused::NotThere));
    assert_eq!(put(RowId(9), 0, 1, &[1, 2]), Err(Refused::NotThere));
    assert_eq!((scanner.input(own), scanner.input(flags)), (&[1, 2, 3, 4][..], &[0b1001_0100, 0b10][..]));
}

#[test]
fn marking_takes_rows_that_share_a_cell_with_the_range_and_says_why_there_is_none() {
    let (mut scanner, device) = scanner();
    let ten = add(&mut scanner, Row { read: Reading::Manual, ..row(device, Kind::Holding, 10, 10) });
    add(&mut scanner, Row { read: Reading::Manual, ..row(device, Kind::Input, 10, 10) });
    for (first, last, touched) in
        [(0, 9, false), (0, 10, true), (19, 19, true), (20, 99, false), (12, 13, true), (0, u16::MAX, true)]
    {
        for function in [3, 6, 16] {
            let marked = scanner.mark_range(device, function, first, last, START);
            assert_eq!(marked, if touched { Ok(1) } else { Err(Refused::NotThere) }, "{first} {last}");
        }
        assert_eq!(scanner.mark_range(device, 1, first, last, START), Err(Refused::NotThere));
        assert_eq!(scanner.mark_range(device, 7, first, last, START), Err(Refused::NotThere));
    }
    let status = scanner.status(ten, START);
    assert!(status.any(Status::READ_MARKED) && status.any(Status::WRITE_MARKED));
    let fixed = add(&mut scanner, Row { write: Writing::Never, ..row(device, Kind::Holding, 30, 1) });
    assert_eq!(scanner.mark_range(device, 6, 30, 30, START), Err(Refused::ReadOnly));
    assert_eq!([scanner.write(fixed), scanner.begin(fixed, START)], [Err(Refused::ReadOnly); 2]);
    assert_eq!(scanner.begin(ten, START), Ok(()));
    assert_eq!(scanner.begin(ten, START), Err(Refused::Blocked));
    assert_eq!([scanner.write(ten), scanner.read(ten, START)], [Err(Refused::Blocked); 2]);
    assert_eq!((scanner.finish(ten), scanner.finish(ten)), (Ok(()), Err(Refused::NotBlocked)));
    let own = add(&mut scanner, Row { device: None, ..row(device, Kind::Holding, 30, 1) });
    assert_eq!([scanner.write(own), scanner.read(own, START)], [Err(Refused::NoDevice); 2]);
    let gone = RowId(99);
    assert_eq!([scanner.write(gone), scanner.read(gone, START)], [Err(Refused::NotThere); 2]);
    assert_eq!([scanner.begin(gone, START), scanner.finish(gone)], [Err(Refused::NotThere); 2]);
}

#[test]
fn a_device_that_is_left_alone_says_how_long() {
    let (mut scanner, device, id) = scanner_with(|device| row(device, Kind::Holding, 0, 1));
    for _ in 0..3 {
        super::lose(&mut scanner, at(0)).unwrap();
    }
    assert_eq!(scanner.read(id, at(1_000)), Err(Refused::BackingOff(Duration::from_secs(14))));
    let refused = Refused::BackingOff(Duration::from_millis(1_500)).to_string();
    assert_eq!(refused, "its device does not respond; next attempt in 2s");
    let status = |ms| scanner.device_status(device, at(ms)).unwrap();
    assert_eq!((status(14_999).backs_off_until, status(15_000).backs_off_until), (Some(at(15_000)), None));
    assert_eq!((status(0).requests, status(0).failures, status(0).responses), (3, 3, 0));
    assert_eq!((status(0).alive, status(0).error), (Some(false), Some(ErrorCode::Timeout)));
    assert!(scanner.status(id, at(14_999)).any(Status::BACKING_OFF));
    assert!(!scanner.status(id, at(15_000)).any(Status::BACKING_OFF));
}

#[test]
fn each_table_has_its_functions_and_limits_and_its_numbers_in_modicons_notation() {
    for (kind, read, writes, bits, most) in [
        (Kind::Coil, 1, &[5, 15][..], true, [2000, 1968]),
        (Kind::Discrete, 2, &[], true, [2000, 1968]),
        (Kind::Input, 4, &[], false, [125, 123]),
        (Kind::Holding, 3, &[6, 16], false, [125, 123]),
    ] {
        assert_eq!(kind.read_function(), read);
        let of = |function| Kind::of_function(function).filter(|(of, _)| *of == kind).map(|(_, write)| write);
        for function in 0..=255 {
            let expected =
                if function == read { Some(false) } else { writes.contains(&function).then_some(true) };
            assert_eq!(of(function), expected, "{kind:?} {function}");
        }
        assert_eq!((kind.is_bits(), kind.is_writable()), (bits, !writes.is_empty()));
        assert_eq!([false, true].map(|write| kind.cells_max(write)), most);
        let bytes = if bits { [0, 1, 1, 2] } else { [0, 2, 16, 18] };
        assert_eq!([0, 1, 8, 9].map(|cells| kind.bytes(cells)), bytes);
    }
    let parsed = |number| Modicon::parse(number).map(|Modicon(kind, address)| (kind.modicon(), address));
    for (digit, is_table) in [(0, true), (1, true), (2, false), (3, true), (4, true), (5, false)] {
        for (nth, address) in [(1, 0), (2, 1), (9_998, 9_997), (9_999, 9_998)] {
            assert_eq!(parsed(digit * 10_000 + nth), is_table.then_some((digit, address)), "{digit} {nth}");
        }
        assert_eq!(parsed(digit * 10_000), None);
        // Without its leading zero a coil's number above 9999 is another table's.
        for (nth, address) in [(1, 0), (2, 1), (10_000, 9_999), (65_535, 65_534), (65_536, 65_535)] {
            let expected = (is_table && digit > 0).then_some((digit, address));
            if digit > 0 {
                assert_eq!(parsed(digit * 100_000 + nth), expected, "{digit} {nth}");
            }
        }
        if digit > 0 {
            assert_eq!((parsed(digit * 100_000), parsed(digit * 100_000 + 65_537)), (None, None), "{digit}");
        }
    }
    for (address, text) in [(0, "40001"), (9_998, "49999"), (9_999, "410000"), (65_535, "465536")] {
        assert_eq!(Modicon(Kind::Holding, address).to_string(), text);
    }
    assert_eq!(Modicon(Kind::Coil, 0).to_string(), "00001");
    assert_eq!(Modicon(Kind::Coil, 9_999).to_string(), "010000");
}

#[test]
fn values_are_typed_as_their_limits_allow() {
    for (kind, text, registers) in [
        (ValueType::U16, "0", Some([0, 0, 0, 0])),
        (ValueType::U16, "65535", Some([0xff, 0xff, 0, 0])),
        (ValueType::U16, "65536", None),
        (ValueType::U16, "-1", None),
        (ValueType::U16, "0x12", Some([0, 0x12, 0, 0])),
        (ValueType::U16, "12x", None),
        (ValueType::U16, "0x-1", None),
        (ValueType::U16, "--1", None),
        (ValueType::I16, "-32768", Some([0x80, 0, 0, 0])),
        (ValueType::I16, "-32769", None),
        (ValueType::I16, "32767", Some([0x7f, 0xff, 0, 0])),
        (ValueType::I16, "32768", None),
        (ValueType::U32, "4294967295", Some([0xff; 4])),
        (ValueType::U32, "4294967296", None),
        (ValueType::U32, "-1", None),
        (ValueType::U32, "0x10203", Some([0, 1, 2, 3])),
        (ValueType::I32, "-2147483648", Some([0x80, 0, 0, 0])),
        (ValueType::I32, "-2147483649", None),
        (ValueType::I32, "2147483648", None),
        (ValueType::I32, "-2", Some([0xff, 0xff, 0xff, 0xfe])),
        (ValueType::F32, "1.5", Some([0x3f, 0xc0, 0, 0])),
        (ValueType::F32, "0x10", None),
    ] {
        let parsed = kind.parse(text).map(|bytes| <[u8; 4]>::try_from(&bytes[..4]).unwrap());
        assert_eq!(parsed, registers, "{kind:?} {text}");
        if let (Some(registers), false) = (registers, text.starts_with("0x")) {
            let taken = kind.take(&registers[..2 * usize::from(kind.registers())]);
            assert_eq!(taken.map(|value| value.to_string()).as_deref(), Some(text), "{kind:?}");
            assert_eq!(kind.take(&registers[..2 * usize::from(kind.registers()) - 1]), None, "{kind:?}");
        }
    }
    assert_eq!(TypedValue::Fraction(0.25).to_string(), "0.25");
    assert_eq!(ValueType::default().registers(), 1);
}

#[test]
fn a_range_takes_as_many_rows_as_it_takes_frames_and_the_last_free_one() {
    for (kind, count, rows) in [
        (Kind::Input, 125, 1),
        (Kind::Input, 126, 2),
        (Kind::Input, 250, 2),
        (Kind::Holding, 123, 1),
        (Kind::Holding, 124, 2),
        (Kind::Coil, 1_968, 1),
        (Kind::Discrete, 2_000, 1),
        (Kind::Discrete, 2_001, 2),
    ] {
        for free in [rows - 1, rows, rows + 1] {
            let (mut scanner, device) = scanner();
            for nth in 0..ROWS_MAX - free {
                scanner.add_row(row(device, Kind::Coil, nth as u16, 1), START).unwrap();
            }
            let added = scanner.add_range(row(device, kind, 7, count), START);
            let expected = if free < rows { Err(Full::Rows) } else { Ok(()) };
            assert_eq!(added, expected, "{kind:?} {count} {free}");
            let added = ROWS_MAX - free + if free < rows { 0 } else { rows };
            assert_eq!(scanner.rows(), added, "{kind:?} {count} {free}");
        }
    }
}

#[test]
fn rows_that_are_read_at_once_are_asked_for_in_the_order_of_asking() {
    let (mut scanner, device) = scanner();
    let rows = [0, 50, 20].map(|first| {
        add(&mut scanner, Row { read: Reading::Manual, ..row(device, Kind::Holding, first, 1) })
    });
    for order in [[1, 0, 2], [2, 1, 0], [0, 2, 1]] {
        order.iter().for_each(|&nth| scanner.read(rows[nth], at(0)).unwrap());
        let asked = order.map(|_| exchange(&mut scanner, at(0)).unwrap().pdu[2]);
        assert_eq!(asked, order.map(|nth| [0, 50, 20][nth]));
    }
}

#[test]
fn a_row_that_is_to_be_written_again_is_written_before_one_of_later() {
    for is_newer in [true, false] {
        let (mut scanner, device) = scanner();
        let [high, low] = [40, 3].map(|first| {
            let (input, output) = (scanner.allocate(2).unwrap(), scanner.allocate(2).unwrap());
            let (read, write) = (Reading::Manual, Writing::OnChange);
            scanner
                .add_row(Row { input, output, read, write, ..row(device, Kind::Holding, first, 1) }, START)
                .unwrap()
        });
        scanner.set_outputs(true);
        if is_newer {
            // It has another value while the first one is on its way.
            scanner.write(high).unwrap();
            let request = scanner.next(at(0)).unwrap();
            scanner.write(high).unwrap();
            scanner.answered(request.device, at(0), Ok(&response(&request)));
        } else {
            // The device has another value.
            scanner.read(high, at(0)).unwrap();
            answered(&mut scanner, at(0), &[3, 2, 0, 7]);
        }
        scanner.write(low).unwrap();
        let written = [(); 2].map(|()| exchange(&mut scanner, at(0)).unwrap().pdu);
        assert_eq!(written.map(|pdu| (pdu[0], pdu[2])), [(6, 40), (6, 3)], "{is_newer}");
    }
}

#[test]
fn an_output_that_waits_goes_on_waiting_while_outputs_are_on() {
    let (mut scanner, device) = scanner();
    let id = add(&mut scanner, Row { write: Writing::OnChange, ..row(device, Kind::Holding, 0, 1) });
    scanner.write(id).unwrap();
    for (on, waits) in [(true, true), (false, false)] {
        scanner.set_outputs(on);
        assert_eq!(scanner.status(id, START).any(Status::WRITE_MARKED), waits);
    }
}
