//! Requests, responses that a correct device could give, and streams in which frames are hidden.

use proptest::strategy::Union;

use crate::prelude::*;

/// Request and response of each public function as the Application Protocol V1.1b3 prints them (clauses 6.1 to 6.21).
pub(crate) const EXAMPLES: &[(&[u8], &[u8])] = &[
    (b"\x01\x00\x13\x00\x13", b"\x01\x03\xCD\x6B\x05"),
    (b"\x02\x00\xC4\x00\x16", b"\x02\x03\xAC\xDB\x35"),
    (b"\x03\x00\x6B\x00\x03", b"\x03\x06\x02\x2B\x00\x00\x00\x64"),
    (b"\x04\x00\x08\x00\x01", b"\x04\x02\x00\x0A"),
    (b"\x05\x00\xAC\xFF\x00", b"\x05\x00\xAC\xFF\x00"),
    (b"\x06\x00\x01\x00\x03", b"\x06\x00\x01\x00\x03"),
    (b"\x07", b"\x07\x6D"),
    (b"\x08\x00\x00\xA5\x37", b"\x08\x00\x00\xA5\x37"),
    (b"\x0B", b"\x0B\xFF\xFF\x01\x08"),
    (b"\x0C", b"\x0C\x08\x00\x00\x01\x08\x01\x21\x20\x00"),
    (b"\x0F\x00\x13\x00\x0A\x02\xCD\x01", b"\x0F\x00\x13\x00\x0A"),
    (b"\x10\x00\x01\x00\x02\x04\x00\x0A\x01\x02", b"\x10\x00\x01\x00\x02"),
    // Report server ID has no bytes in the specification: identifier, running, one more.
    (b"\x11", b"\x11\x03\x2A\xFF\x01"),
    (
        b"\x14\x0E\x06\x00\x04\x00\x01\x00\x02\x06\x00\x03\x00\x09\x00\x02",
        b"\x14\x0C\x05\x06\x0D\xFE\x00\x20\x05\x06\x33\xCD\x00\x40",
    ),
    (
        b"\x15\x0D\x06\x00\x04\x00\x07\x00\x03\x06\xAF\x04\xBE\x10\x0D",
        b"\x15\x0D\x06\x00\x04\x00\x07\x00\x03\x06\xAF\x04\xBE\x10\x0D",
    ),
    (b"\x16\x00\x04\x00\xF2\x00\x25", b"\x16\x00\x04\x00\xF2\x00\x25"),
    (
        b"\x17\x00\x03\x00\x06\x00\x0E\x00\x03\x06\x00\xFF\x00\xFF\x00\xFF",
        b"\x17\x0C\x00\xFE\x0A\xCD\x00\x01\x00\x03\x00\x0D\x00\xFF",
    ),
    (b"\x18\x04\xDE", b"\x18\x00\x06\x00\x02\x01\xB8\x12\x84"),
    (
        b"\x2B\x0E\x01\x00",
        b"\x2B\x0E\x01\x01\x00\x00\x03\x00\x16Company identification\x01\x0FProduct code XX\x02\x05V2.11",
    ),
];

/// Any PDU that a frame can carry.
pub(crate) fn any_pdu() -> impl Strategy<Value = Vec<u8>> {
    vec(any::<u8>(), 1..=253)
}

/// A function code that no specification lists.
fn unlisted() -> impl Strategy<Value = u8> {
    prop_oneof![9u8..=10, 13u8..=14, 18u8..=19, 25u8..=42, 44u8..=127]
}

/// Function code, address and a quantity up to `max`.
fn read(function: u8, max: u16) -> impl Strategy<Value = Vec<u8>> {
    // Short reads too, so that a test's streams stay small often.
    let quantity = prop_oneof![1..=9.min(max), 1..=max];
    (any::<[u8; 2]>(), quantity)
        .prop_map(move |(address, quantity)| [&[function][..], &address, &quantity.to_be_bytes()].concat())
}

/// Function code, address, quantity up to `max`, and the data of `bytes(quantity)` bytes.
fn write(function: u8, max: u16, bytes: fn(u16) -> usize) -> impl Strategy<Value = Vec<u8>> {
    read(function, max).prop_flat_map(move |head| {
        let count = bytes(u16::from_be_bytes([head[3], head[4]]));
        vec(any::<u8>(), count).prop_map(move |data| [&head[..], &[count as u8], &data].concat())
    })
}

/// A request of any function that a server could accept.
pub(crate) fn request() -> impl Strategy<Value = Vec<u8>> {
    let registers = |count: u16| 2 * usize::from(count);
    let bits = |count: u16| usize::from(count.div_ceil(8));
    let read_group = (any::<[u8; 4]>(), 1u16..=20)
        .prop_map(|(place, length)| [&[6][..], &place, &length.to_be_bytes()].concat());
    let write_group = (any::<[u8; 4]>(), vec(any::<[u8; 2]>(), 1..=20)).prop_map(|(place, data)| {
        [&[6][..], &place, &(data.len() as u16).to_be_bytes(), &data.concat()].concat()
    });
    let counted = |function: u8| {
        move |groups: Vec<Vec<u8>>| {
            let groups = groups.concat();
            [&[function, groups.len() as u8][..], &groups].concat()
        }
    };
    let with = |function: u8| move |fields: Vec<u8>| [&[function][..], &fields].concat();
    let choices: Vec<BoxedStrategy<Vec<u8>>> = vec![
        read(1, 2000).boxed(),
        read(2, 2000).boxed(),
        read(3, 125).boxed(),
        read(4, 125).boxed(),
        (any::<[u8; 2]>(), any::<bool>())
            .prop_map(|(at, on)| vec![5, at[0], at[1], u8::from(on) * 0xFF, 0])
            .boxed(),
        vec(any::<u8>(), 4).prop_map(with(6)).boxed(),
        prop_oneof![Just(7u8), Just(11), Just(12), Just(17)].prop_map(|function| vec![function]).boxed(),
        vec(any::<u8>(), 0..=20).prop_map(|data| [&[8, 0, 0][..], &data].concat()).boxed(),
        (1u8..=25, any::<[u8; 2]>()).prop_map(|(sub, data)| [&[8, 0, sub][..], &data].concat()).boxed(),
        write(15, 1968, bits).boxed(),
        write(16, 123, registers).boxed(),
        vec(read_group, 1..=5).prop_map(counted(20)).boxed(),
        vec(write_group, 1..=5).prop_map(counted(21)).boxed(),
        vec(any::<u8>(), 6).prop_map(with(22)).boxed(),
        (read(23, 125), write(0, 121, registers)).prop_map(|(r, w)| [&r[..], &w[1..]].concat()).boxed(),
        vec(any::<u8>(), 2).prop_map(with(24)).boxed(),
        (1u8..=4, any::<u8>()).prop_map(|(code, object)| vec![43, 14, code, object]).boxed(),
        vec(any::<u8>(), 0..=20).prop_map(|data| [&[43, 13][..], &data].concat()).boxed(),
        (unlisted(), vec(any::<u8>(), 0..=40)).prop_map(move |(function, data)| with(function)(data)).boxed(),
    ];
    Union::new(choices)
}

/// What a correct device could respond to `request`, exceptions included.
fn response(request: &[u8]) -> BoxedStrategy<Vec<u8>> {
    let function = request[0];
    let word = |at: usize| usize::from(u16::from_be_bytes([request[at], request[at + 1]]));
    let counted = move |count: usize| {
        vec(any::<u8>(), count).prop_map(move |data| [&[function, count as u8][..], &data].concat()).boxed()
    };
    let behind = |head: &[u8], count: core::ops::RangeInclusive<usize>| {
        let head = head.to_vec();
        vec(any::<u8>(), count).prop_map(move |data| [&head[..], &data].concat()).boxed()
    };
    let normal = match function {
        1 | 2 => counted(word(3).div_ceil(8)),
        3 | 4 | 23 => counted(2 * word(3)),
        5 | 6 | 21 | 22 => Just(request.to_vec()).boxed(),
        7 => behind(&[7], 1..=1),
        8 if [0, 1, 3, 4, 10, 20].contains(&word(1)) => Just(request.to_vec()).boxed(),
        8 if (11..=18).contains(&word(1)) || word(1) == 2 => behind(&request[..3], 2..=2),
        8 => behind(&request[..3], 0..=20),
        11 => behind(&[11], 4..=4),
        12 => (6usize..=70).prop_flat_map(counted).boxed(),
        17 => (0usize..=100).prop_flat_map(counted).boxed(),
        15 | 16 => Just(request[..5].to_vec()).boxed(),
        20 => {
            let groups = request[2..].chunks(7).map(|group| {
                let bytes = 2 * usize::from(u16::from_be_bytes([group[5], group[6]]));
                vec(any::<u8>(), bytes).prop_map(move |data| [&[bytes as u8 + 1, 6][..], &data].concat())
            });
            let groups: Vec<_> = groups.collect();
            groups
                .prop_map(|groups| {
                    let groups = groups.concat();
                    [&[20, groups.len() as u8][..], &groups].concat()
                })
                .boxed()
        }
        24 => vec(any::<[u8; 2]>(), 0..=31)
            .prop_map(|queue| {
                let count = queue.len() as u8;
                [&[24, 0, 2 + 2 * count, 0, count][..], &queue.concat()].concat()
            })
            .boxed(),
        43 if request[1] == 14 => behind(&request[..3], 3..=60),
        43 => behind(&request[..2], 0..=60),
        _ => behind(&[function], 0..=60),
    };
    let exception = (1u8..=255).prop_map(move |code| vec![function | 0x80, code]);
    prop_oneof![4 => normal, 1 => exception].boxed()
}

/// A request, and what a correct device could answer.
pub(crate) fn exchange() -> impl Strategy<Value = (Vec<u8>, Vec<u8>)> {
    request().prop_flat_map(|request| {
        let response = response(&request);
        (Just(request), response)
    })
}

/// Cuts `stream` at the given places, which may be anywhere.
pub(crate) fn cut(stream: &[u8], places: &[prop::sample::Index]) -> Vec<Vec<u8>> {
    let mut places: Vec<usize> = places.iter().map(|place| place.index(stream.len() + 1)).collect();
    places.sort_unstable();
    let mut pieces = Vec::new();
    let mut from = 0;
    for place in places {
        pieces.push(stream[from..place].to_vec());
        from = place;
    }
    pieces.push(stream[from..].to_vec());
    pieces
}
