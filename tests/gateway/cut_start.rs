//! When the copy of an arriving frame may begin, where its end is, and which CRC it has: by value.

use embassy_time::Instant;
use mobgate::modbus::delta::CrcDelta;
use mobgate::modbus::pdu::{End, request_end, response_end};
use mobgate::port::cut_through::timing::start;
use mobgate::settings::Lane;
use mobgate::settings::{Framing, LineSettings};
use mobgate_simulator::device::rtu;
use mobgate_simulator::timing::char_bits;
use proptest::prelude::{any, prop};
use proptest::{prop_assert_eq, proptest};

const READ: [u8; 5] = [3, 0, 7, 0, 1];
/// A second, as any time at which a frame begins.
const BEGUN: Instant = Instant::from_ticks(1_000_000);

fn line(baud: u32) -> LineSettings {
    LineSettings { baud, ..LineSettings::DEFAULT }
}

fn rtu_lane(baud: u32) -> Lane {
    Lane { framing: Framing::Rtu, line: line(baud) }
}

fn ascii_lane(baud: u32) -> Lane {
    Lane { framing: Framing::Ascii, line: LineSettings { data_bits: 7, ..line(baud) } }
}

/// Microseconds from the first bit of a frame of `bytes` bytes without its check to that of its copy.
fn start_us(input: &Lane, output: &Lane, bytes: Option<usize>) -> Option<u64> {
    start(BEGUN, input, output, bytes).map(|at| (at - BEGUN).as_micros())
}

#[test]
fn a_copy_on_a_line_as_slow_or_slower_begins_as_soon_as_the_unit_is_there() {
    assert_eq!(start_us(&rtu_lane(19_200), &rtu_lane(19_200), None), Some(573));
    assert_eq!(start_us(&rtu_lane(115_200), &rtu_lane(19_200), None), Some(96));
    let none = LineSettings { parity: mobgate::settings::Parity::None, ..line(19_200) };
    let none = Lane { framing: Framing::Rtu, line: none };
    // Ten bits a character are sooner over than eleven.
    assert_eq!(start_us(&none, &rtu_lane(19_200), None), Some(521));
    assert_eq!(start_us(&rtu_lane(19_200), &none, None), None);
    // Two characters of ten bits for one of eleven.
    assert_eq!(start_us(&rtu_lane(19_200), &ascii_lane(19_200), None), Some(573));
    assert_eq!(start_us(&ascii_lane(19_200), &ascii_lane(19_200), None), Some(1_563), "colon and two digits");
    assert_eq!(start_us(&ascii_lane(115_200), &rtu_lane(19_200), None), Some(261));
}

#[test]
fn a_copy_on_a_faster_line_begins_so_late_that_it_never_has_to_wait() {
    assert_eq!(start_us(&rtu_lane(9_600), &rtu_lane(115_200), None), None, "not before the length is known");
    // 8 characters of 1145.83 us less 7 of 95.49 us.
    assert_eq!(start_us(&rtu_lane(9_600), &rtu_lane(115_200), Some(6)), Some(8_499));
    assert_eq!(start_us(&rtu_lane(19_200), &rtu_lane(38_400), Some(23)), Some(14_323 - 6_875));
    // 8 of 1145.83 us less 13 of 86.81 us: the LRC is known when the frame is over.
    assert_eq!(start_us(&rtu_lane(9_600), &ascii_lane(115_200), Some(6)), Some(8_039));
    // 17 of 1041.67 us less 7 of 1145.83 us: at equal speeds, ASCII is the slow one.
    assert_eq!(start_us(&ascii_lane(9_600), &rtu_lane(9_600), None), None);
    assert_eq!(start_us(&ascii_lane(9_600), &rtu_lane(9_600), Some(6)), Some(9_688));
    // 17 of 1041.67 us less 15 of 86.81 us.
    assert_eq!(start_us(&ascii_lane(9_600), &ascii_lane(115_200), Some(6)), Some(16_407));
}

/// When each character of a frame of `bytes` bytes and its copy may be there and must leave: the formula is the earliest
/// start at which none has to wait.
#[test]
fn the_start_is_the_earliest_at_which_no_character_has_to_wait() {
    let lanes = [1_200, 9_600, 19_200, 115_200].map(|baud| [rtu_lane(baud), ascii_lane(baud)]);
    let lanes = lanes.as_flattened();
    for (input, output) in lanes.iter().flat_map(|input| lanes.iter().map(move |output| (input, output))) {
        for bytes in [2, 3, 6, 23, 254] {
            let wanted = earliest_us(input, output, bytes);
            let start = start_us(input, output, Some(bytes)).unwrap() as f64;
            assert!(
                (wanted - 1e-6..=wanted + 1.0).contains(&start),
                "{input:?} to {output:?}, {bytes}: {start}"
            );
            if let Some(unknown) = start_us(input, output, None) {
                assert!(
                    unknown as f64 >= wanted - 1e-6,
                    "{input:?} to {output:?}, {bytes}: not known, {unknown}"
                );
            }
        }
    }
}

/// The earliest start, character by character.
fn earliest_us(input: &Lane, output: &Lane, bytes: usize) -> f64 {
    // When a byte is there, when its check is, and when all is; in characters.
    let (there, check, end): (fn(usize) -> usize, _, _) = match input.framing {
        Framing::Rtu => (|byte| byte + 1, bytes + 2, bytes + 2),
        Framing::Ascii => (|byte| 2 * byte + 3, 2 * bytes + 3, 2 * bytes + 5),
    };
    let bytes_needed = (0..bytes).map(there);
    // The characters of the copy, each with what it needs of the frame.
    let needed: Vec<usize> = match (input.framing, output.framing) {
        (Framing::Rtu, Framing::Rtu) => bytes_needed.chain([bytes + 1, end]).collect(),
        (Framing::Ascii, Framing::Rtu) => bytes_needed.chain([check, end]).collect(),
        (_, Framing::Ascii) => {
            let digits = bytes_needed.flat_map(|needed| [needed; 2]);
            [there(0)].into_iter().chain(digits).chain([check, check, end, end]).collect()
        }
    };
    let us = |lane: &Lane| char_bits(&lane.line) as f64 * 1e6 / f64::from(lane.line.baud);
    let starts = needed
        .iter()
        .enumerate()
        .map(|(place, &needed)| needed as f64 * us(input) - place as f64 * us(output));
    // The unit is there before anything is sent.
    starts.fold(there(0) as f64 * us(input), f64::max)
}

#[test]
fn the_beginning_of_a_request_tells_its_end_as_soon_as_it_can() {
    assert_eq!(request_end(&[]), End::Later);
    for function in 1..=6 {
        assert_eq!(request_end(&[function]), End::At(5));
    }
    assert_eq!(request_end(&[16, 0, 0, 0, 2]), End::Later);
    assert_eq!(request_end(&[16, 0, 0, 0, 2, 4]), End::At(10));
    assert_eq!(request_end(&[23, 0, 0, 0, 1, 0, 0, 0, 1]), End::Later);
    assert_eq!(request_end(&[23, 0, 0, 0, 1, 0, 0, 0, 1, 2]), End::At(12));
    assert_eq!(request_end(&[8, 0]), End::Later);
    assert_eq!(request_end(&[8, 0, 99]), End::Unknown);
    for function in [20, 21, 43] {
        assert_eq!(request_end(&[function]), End::Later);
    }
    assert_eq!(request_end(&[65]), End::Unknown);
    assert_eq!(request_end(&[21, 251]), End::At(253), "as long as it may be");
    assert_eq!(request_end(&[21, 252]), End::Unknown);
    assert_eq!(request_end(&[0x83]), End::Unknown);
    assert_eq!(request_end(&[16, 0, 0, 0, 2, 255]), End::Unknown, "no frame is that long");
}

#[test]
fn the_beginning_of_a_response_tells_its_end_or_that_it_is_none() {
    assert_eq!(response_end(&READ, &[]), End::Later);
    assert_eq!(response_end(&READ, &[3]), End::At(4));
    assert_eq!(response_end(&READ, &[3, 2]), End::At(4));
    assert_eq!(response_end(&READ, &[3, 4]), End::Unknown, "another byte count");
    assert_eq!(response_end(&READ, &[4]), End::Unknown, "another function");
    assert_eq!(response_end(&READ, &[0x83]), End::At(2));
    assert_eq!(response_end(&READ, &[0x83, 0]), End::Unknown);
    assert_eq!(response_end(&[16, 0, 0, 0, 1, 2, 0, 0], &[16]), End::At(5));
    assert_eq!(response_end(&[65, 1], &[65]), End::Unknown);
}

#[test]
fn whatever_the_units_and_however_long_the_frame_its_crc_is_changed_by_what_its_unit_changes() {
    for change in 1..=u8::MAX {
        let mut delta = CrcDelta::new(0, change);
        // Bit by bit, by the polynomial of Serial Line 2.5.1.2.
        let step = |register: u16| (0..8).fold(register, |crc, _| (crc >> 1) ^ ((crc & 1) * 0xa001));
        let mut expected = step(change.into());
        for length in 0..=253 {
            assert_eq!(u16::from_le_bytes(delta.translate([0; 2])), expected, "{change} {length}");
            delta.pass(1);
            expected = step(expected);
        }
    }
}

proptest! {
    #[test]
    fn another_units_id_turns_the_same_bits_of_the_crc_wrong_as_before(
        pdu in prop::collection::vec(any::<u8>(), 1..=253),
        from in any::<u8>(),
        to in any::<u8>(),
        damage in any::<u16>(),
    ) {
        let crc = |unit| {
            let frame = rtu::frame(unit, &pdu);
            u16::from_le_bytes([frame[frame.len() - 2], frame[frame.len() - 1]])
        };
        let mut delta = CrcDelta::new(from, to);
        delta.pass(pdu.len());
        let sent = u16::from_le_bytes(delta.translate((crc(from) ^ damage).to_le_bytes()));
        prop_assert_eq!(sent, crc(to) ^ damage);
    }
}
