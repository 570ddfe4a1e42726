//! Messages by value: fragments both ways, and IP settings.

use core::net::Ipv4Addr;
use std::collections::VecDeque;
use std::vec;
use std::vec::Vec;

use embassy_time::{Duration, Instant};

use super::{Eoe, Ethernet, EthernetError, FRAME_BYTES_MAX, IpSettings, Link, REASSEMBLY_WAIT};
use crate::mailbox::MailboxError;

/// Bytes of a message in a mailbox of 128 bytes.
const ROOM: usize = 122;
const START: Instant = Instant::from_secs(1_000);

#[derive(Default)]
struct Net {
    received: Vec<Vec<u8>>,
    waiting: VecDeque<Vec<u8>>,
    settings: IpSettings,
    refuses: Option<EthernetError>,
    starts: usize,
}

impl Link for Net {
    fn receive(&mut self, frame: &[u8]) {
        self.received.push(frame.to_vec());
    }

    fn transmit(&mut self, into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let frame = self.waiting.pop_front()?;
        into[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }

    fn start(&mut self) {
        self.starts += 1;
    }

    fn configure(&mut self, settings: &IpSettings) -> Result<(), EthernetError> {
        self.settings = settings.clone();
        self.refuses.map_or(Ok(()), Err)
    }

    fn settings(&mut self) -> Result<IpSettings, EthernetError> {
        self.refuses.map_or(Ok(self.settings.clone()), Err)
    }
}

/// A link that has frames only.
struct Bare;

impl Link for Bare {
    fn receive(&mut self, _frame: &[u8]) {}

    fn transmit(&mut self, _into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        None
    }
}

fn eoe() -> Eoe<Net> {
    Eoe::new(Net::default())
}

fn content(bytes: usize, salt: usize) -> Vec<u8> {
    (0..bytes).map(|at| (at * 7 + at / 256 + salt) as u8).collect()
}

/// A fragment in the words of the standard: its number, its offset in units, and its frame's number.
fn fragment(last: bool, number: u8, offset: u16, frame: u8, bytes: &[u8]) -> Vec<u8> {
    let place = u16::from(number) + 64 * offset + 4096 * u16::from(frame);
    [&[0, u8::from(last)], &place.to_le_bytes()[..], bytes].concat()
}

fn take(eoe: &mut Eoe<Net>, message: &[u8], after: Duration) {
    assert_eq!(eoe.request(message, ROOM, START + after), Ok(None), "{message:02x?}");
}

fn ask(eoe: &mut Eoe<impl Link>, message: &[u8]) -> Vec<u8> {
    eoe.request(message, ROOM, START).unwrap().expect("a response").to_vec()
}

fn all(eoe: &mut Eoe<Net>, room: usize) -> Vec<Vec<u8>> {
    core::iter::from_fn(|| eoe.next(room)).map(|message| message.to_vec()).collect()
}

const NOW: Duration = Duration::MIN;

#[test]
fn a_frame_in_one_fragment_arrives() {
    let mut eoe = eoe();
    take(&mut eoe, &fragment(true, 0, 2, 5, &content(60, 0)), NOW);
    assert_eq!(eoe.link.received, [content(60, 0)]);
}

#[test]
fn fragments_are_put_together_up_to_the_longest_frame() {
    for (bytes, arrives) in [(13, false), (14, true), (97, true), (FRAME_BYTES_MAX, true), (1515, false)] {
        let (mut eoe, frame) = (eoe(), content(bytes, 1));
        let count = frame.chunks(96).count();
        for (nth, bytes) in frame.chunks(96).enumerate() {
            let offset = if nth == 0 { frame.len().div_ceil(32) } else { 3 * nth };
            take(&mut eoe, &fragment(nth + 1 == count, nth as u8, offset as u16, 1, bytes), NOW);
        }
        assert_eq!(eoe.link.received, vec![frame; usize::from(arrives)]);
    }
}

#[test]
fn what_does_not_fit_drops_its_frame_and_not_the_next_one() {
    let (first, last) = (fragment(false, 0, 3, 1, &content(64, 0)), content(20, 9));
    let second = fragment(true, 1, 2, 1, &last);
    let cases: [(&str, Vec<Vec<u8>>); 10] = [
        ("no first one", vec![second.clone()]),
        ("a number too far", vec![first.clone(), fragment(true, 2, 2, 1, &last)]),
        ("another frame", vec![first.clone(), fragment(true, 1, 2, 2, &last)]),
        ("another offset", vec![first.clone(), fragment(true, 1, 3, 1, &last)]),
        ("not all units", vec![fragment(false, 0, 3, 1, &content(63, 0)), second.clone()]),
        ("nothing", vec![fragment(false, 0, 3, 1, &[]), fragment(true, 1, 0, 1, &last)]),
        ("longer than announced", vec![fragment(false, 0, 2, 1, &content(64, 0)), second.clone()]),
        ("twice", vec![first.clone(), fragment(false, 1, 2, 1, &content(32, 0)), second.clone()]),
        ("after its end", vec![second.clone(), second.clone()]),
        ("longer than a frame", vec![fragment(true, 0, 63, 1, &content(1515, 0))]),
    ];
    for (name, messages) in cases {
        let mut eoe = eoe();
        messages.iter().for_each(|message| take(&mut eoe, message, NOW));
        assert_eq!(eoe.link.received, Vec::<Vec<u8>>::new(), "{name}");
        take(&mut eoe, &first, NOW);
        take(&mut eoe, &second, NOW);
        assert_eq!(eoe.link.received, [[content(64, 0), last.clone()].concat()], "{name}");
    }
}

#[test]
fn a_number_past_the_last_one_begins_nothing() {
    let mut eoe = eoe();
    for number in 0..64 {
        let offset = if number == 0 { 63 } else { number };
        take(&mut eoe, &fragment(false, number as u8, offset, 1, &content(32, 0)), NOW);
    }
    take(&mut eoe, &fragment(true, 0, 1, 1, &content(32, 0)), NOW);
    assert_eq!(eoe.link.received.len(), 1);
}

#[test]
fn a_frame_whose_next_fragment_is_late_is_dropped() {
    for (late, arrives) in [(REASSEMBLY_WAIT - Duration::from_millis(1), true), (REASSEMBLY_WAIT, false)] {
        let mut eoe = eoe();
        take(&mut eoe, &fragment(false, 0, 3, 1, &content(32, 0)), NOW);
        take(&mut eoe, &fragment(false, 1, 1, 1, &content(32, 0)), late);
        take(&mut eoe, &fragment(true, 2, 2, 1, &content(9, 0)), late + late);
        assert_eq!(eoe.link.received.len(), usize::from(arrives), "{late:?}");
    }
}

#[test]
fn a_time_behind_a_frame_is_cut_off_and_one_that_is_wanted_is_refused() {
    let mut eoe = eoe();
    let mut message = fragment(true, 0, 2, 1, &content(44, 0));
    message[1] |= 2;
    take(&mut eoe, &message, NOW);
    (message[0], message[1]) = (0x20, 1 | 4);
    assert_eq!(ask(&mut eoe, &message), [0x21, 1, 2, 0]);
    // The last fragment asks for the whole frame.
    message[1] = 4;
    take(&mut eoe, &message, NOW);
    // Its time is not all there.
    take(&mut eoe, &[0, 3, 64, 0, 1, 2, 3], NOW);
    assert_eq!(eoe.link.received, [content(40, 0), content(44, 0)]);
    assert_eq!(eoe.next(ROOM), None);
}

#[test]
fn frames_leave_in_fragments_of_whole_units_on_the_main_devices_port() {
    let mut eoe = eoe();
    eoe.link.waiting.extend([content(230, 3), content(60, 4)]);
    let mut on_port = fragment(true, 0, 2, 1, &content(60, 0));
    on_port[0] = 0x10;
    take(&mut eoe, &on_port, NOW);
    let frame = content(230, 3);
    let expected = [
        [&[0x10, 0, 0x00, 0x12][..], &frame[..96]].concat(),
        [&[0x10, 0, 0xc1, 0x10][..], &frame[96..192]].concat(),
        [&[0x10, 1, 0x82, 0x11][..], &frame[192..]].concat(),
        [&[0x10, 1, 0x80, 0x20][..], &content(60, 4)].concat(),
    ];
    assert!(eoe.is_sending());
    assert_eq!(all(&mut eoe, ROOM), expected);
    assert!(!eoe.is_sending());
}

#[test]
fn frame_numbers_begin_anew_after_15_and_rise_with_frames_only() {
    let mut eoe = eoe();
    for nth in 1..40_u8 {
        assert_eq!(eoe.next(ROOM), None);
        eoe.link.waiting.push_back(content(60, 0));
        assert_eq!(eoe.next(ROOM).unwrap()[3] >> 4, nth % 16);
    }
}

#[test]
fn a_frame_that_no_mailbox_carries_makes_room_for_the_next() {
    let mut eoe = eoe();
    eoe.link.waiting.extend([content(60, 0), content(20, 0)]);
    // A mailbox of 34 bytes.
    assert_eq!(eoe.next(28), None);
    assert_eq!(eoe.next(28).unwrap()[4..], content(20, 0));
    // Less than a header.
    eoe.link.waiting.push_back(content(60, 0));
    assert_eq!((eoe.next(0), eoe.is_sending()), (None, false));
}

#[test]
fn a_start_drops_what_is_not_complete() {
    let mut eoe = eoe();
    eoe.link.waiting.extend([content(200, 0), content(30, 0)]);
    take(&mut eoe, &fragment(false, 0, 3, 1, &content(64, 0)), NOW);
    assert!(eoe.next(ROOM).is_some());
    eoe.start();
    assert_eq!(eoe.link.starts, 1, "the link hears of it");
    take(&mut eoe, &fragment(true, 1, 2, 1, &content(20, 0)), NOW);
    assert_eq!(eoe.link.received.len(), 0);
    assert_eq!(eoe.next(ROOM).unwrap()[4..], content(30, 0));
}

fn example() -> IpSettings {
    IpSettings {
        mac: Some([2, 0, 0, 1, 2, 3]),
        address: Some(Ipv4Addr::new(192, 168, 7, 9)),
        mask: Some(Ipv4Addr::new(255, 255, 255, 0)),
        gateway: Some(Ipv4Addr::new(192, 168, 7, 1)),
        dns_server: Some(Ipv4Addr::new(8, 8, 4, 4)),
        name: Some("gateway".try_into().unwrap()),
    }
}

/// The bytes of the example, field by field.
const FIELDS: [&[u8]; 6] = [
    &[2, 0, 0, 1, 2, 3],
    &[9, 7, 168, 192],
    &[0, 255, 255, 255],
    &[1, 7, 168, 192],
    &[4, 4, 8, 8],
    b"gateway\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0",
];

/// The example with some of its fields.
fn some(flags: u8) -> IpSettings {
    let IpSettings { mac, address, mask, gateway, dns_server, name } = example();
    let has = |bit: u8| flags & 1 << bit != 0;
    IpSettings {
        mac: mac.filter(|_| has(0)),
        address: address.filter(|_| has(1)),
        mask: mask.filter(|_| has(2)),
        gateway: gateway.filter(|_| has(3)),
        dns_server: dns_server.filter(|_| has(4)),
        name: name.filter(|_| has(5)),
    }
}

#[test]
fn settings_come_with_or_without_room_for_fields_that_are_not_set() {
    for flags in 0..64_u8 {
        let included = |nth: &usize| flags & 1 << nth != 0;
        let packed: Vec<u8> = (0..6).filter(included).flat_map(|nth| FIELDS[nth]).copied().collect();
        let zeros = |nth: usize| vec![0; FIELDS[nth].len()];
        let spaced = (0..6).flat_map(|nth| if included(&nth) { FIELDS[nth].to_vec() } else { zeros(nth) });
        for body in [packed, spaced.collect()] {
            let mut eoe = eoe();
            let response = ask(&mut eoe, &[&[0x12, 1, 0, 0, flags, 0, 0, 0], &body[..]].concat());
            assert_eq!(response, [0x13, 1, 0, 0], "{flags:02x}");
            assert_eq!(eoe.link.settings, some(flags), "{flags:02x} {body:02x?}");
        }
    }
}

#[test]
fn a_name_may_end_early() {
    let mut eoe = eoe();
    assert_eq!(ask(&mut eoe, b"\x02\x01\0\0\x20\0\0\0box"), [3, 1, 0, 0]);
    assert_eq!(eoe.link.settings.name.as_deref(), Some("box"));
    assert_eq!(ask(&mut eoe, b"\x02\x01\0\0\x20\0\0\0b\xff"), [3, 1, 1, 0]);
}

#[test]
fn what_is_no_devices_address_is_refused() {
    for (flags, field) in [
        (0x01, &[1, 0, 0, 0, 0, 1][..]),
        (0x02, &[1, 0, 0, 224]),
        (0x02, &[255; 4]),
        (0x04, &[0, 255, 0, 255]),
        (0x08, &[1, 0, 0, 239]),
    ] {
        let mut eoe = eoe();
        let message = [&[2, 1, 0, 0, flags, 0, 0, 0], field].concat();
        assert_eq!(ask(&mut eoe, &message), [3, 1, 1, 0], "{field:?}");
        assert_eq!(eoe.link.settings, IpSettings::default());
    }
    // All networks, and none.
    for mask in [[0; 4], [255; 4]] {
        assert_eq!(ask(&mut eoe(), &[&[2, 1, 0, 0, 4, 0, 0, 0][..], &mask].concat()), [3, 1, 0, 0]);
    }
}

#[test]
fn settings_are_read_with_all_addresses() {
    let mut eoe = eoe();
    eoe.link.settings = example();
    let expected = [&[0x17, 1, 0, 0, 0x3f, 0, 0, 0], &FIELDS.concat()[..]].concat();
    assert_eq!(ask(&mut eoe, &[0x16, 1, 0, 0]), expected);
    // A mailbox of 42 bytes has no room for the name, and one of 34 none for the addresses.
    let read = |eoe: &mut Eoe<Net>, room| eoe.request(&[6, 1, 0, 0], room, START).unwrap().unwrap().to_vec();
    assert_eq!(read(&mut eoe, 36), [&[7, 1, 0, 0, 0x1f, 0, 0, 0], &FIELDS[..5].concat()[..]].concat());
    assert_eq!(read(&mut eoe, 28), [7, 1, 1, 0]);
    eoe.link.settings = IpSettings::default();
    assert_eq!(ask(&mut eoe, &[6, 1, 0, 0])[4..], [&[0x1f][..], &[0; 25]].concat());
}

#[test]
fn what_is_refused_has_its_code() {
    let mut eoe = eoe();
    let set = [2, 1, 0, 0, 0, 0, 0, 0];
    for (error, code) in [
        (EthernetError::Unspecified, [1, 0]),
        (EthernetError::UnsupportedFrameType, [2, 0]),
        (EthernetError::NoIpSupport, [1, 2]),
        (EthernetError::NoDhcpSupport, [2, 2]),
    ] {
        eoe.link.refuses = Some(error);
        assert_eq!(ask(&mut eoe, &set), [&[3, 1], &code[..]].concat());
        assert_eq!(ask(&mut eoe, &[6, 1, 0, 0]), [&[7, 1], &code[..]].concat());
    }
    let mut bare = Eoe::new(Bare);
    assert_eq!(ask(&mut bare, &set), [3, 1, 1, 2]);
    assert_eq!(ask(&mut bare, &[6, 1, 0, 0]), [7, 1, 1, 2]);
    assert_eq!(ask(&mut eoe, &[0x34, 1, 0, 0, 0, 0]), [0x35, 1, 1, 4], "no filter is set");
    assert_eq!(ask(&mut eoe, &[0x38, 1, 0, 0]), [0x39, 1, 1, 4], "and none is read");
}

#[test]
fn what_is_no_request_has_the_mailboxes_error() {
    let mut eoe = eoe();
    for kind in [1, 3, 5, 7, 9, 10, 11, 12, 13, 14, 15] {
        let refused = eoe.request(&[kind, 1, 0, 0], ROOM, START);
        assert_eq!(refused, Err(MailboxError::ServiceNotSupported), "{kind}");
    }
    let short: [&[u8]; 5] =
        [&[], &[0, 1, 0], &[2, 1, 0, 0, 1, 0, 0], &[2, 1, 0, 0, 1, 0, 0, 0, 1], &[6, 1, 0]];
    for message in short {
        assert_eq!(eoe.request(message, ROOM, START), Err(MailboxError::SizeTooShort), "{message:02x?}");
    }
    assert!(eoe.link.received.is_empty());
}
