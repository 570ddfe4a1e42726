//! Modbus TCP: round trip, and streams whose frames do not depend on how they are cut.
#![no_main]

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use mobgate::modbus::tcp::{ADU_BYTES_MAX, Header, MbapError, Parsed, encode, parse};

#[derive(Debug, Arbitrary)]
struct Input<'a> {
    frames: Vec<(u16, u8, u16, &'a [u8])>,
    /// Lengths of the reads, used over and over.
    reads: Vec<u8>,
    raw: &'a [u8],
}

/// What a stream gave: frames in order, and why it ended.
type Found = (Vec<(Header, Vec<u8>)>, Option<MbapError>);

fuzz_target!(|input: Input| {
    let Input { frames, reads, raw } = input;
    let mut stream = Vec::new();
    let mut expected = Vec::new();
    for (transaction, unit, protocol, pdu) in frames {
        let header = Header { transaction, unit };
        let mut out = [0; ADU_BYTES_MAX];
        let Ok(frame) = encode(header, pdu, &mut out) else {
            assert!(pdu.is_empty() || pdu.len() > 253);
            continue;
        };
        assert_eq!(parse(frame), Ok(Parsed::Frame { header, pdu, consumed: frame.len() }));
        // A quarter of the frames belong to another protocol.
        let protocol = if protocol % 4 == 0 { protocol } else { 0 };
        stream.extend_from_slice(&frame[..2]);
        stream.extend_from_slice(&protocol.to_be_bytes());
        stream.extend_from_slice(&frame[4..]);
        if protocol == 0 {
            expected.push((header, pdu.to_vec()));
        }
    }
    assert_eq!(follow(&stream, &reads), (expected, None));

    stream.extend_from_slice(raw);
    let found = follow(&stream, &reads);
    assert_eq!(found, follow(&stream, &[]));
    assert_eq!(found, follow(&stream, &[1]));
});

/// Reads `stream` in pieces of the given lengths, at most what a buffer of one frame has room for.
fn follow(stream: &[u8], reads: &[u8]) -> Found {
    let mut lengths = reads.iter().map(|&length| usize::from(length).max(1)).cycle();
    let mut rest = stream;
    let mut buffer = Vec::new();
    let mut found = Vec::new();
    while !rest.is_empty() {
        let room = ADU_BYTES_MAX - buffer.len();
        assert!(room > 0, "a full buffer is never incomplete");
        let (read, later) = rest.split_at(lengths.next().unwrap_or(room).min(room).min(rest.len()));
        buffer.extend_from_slice(read);
        rest = later;
        loop {
            let used = match parse(&buffer) {
                Err(error) => return (found, Some(error)),
                Ok(Parsed::Incomplete) => break,
                Ok(Parsed::Skip { consumed }) => consumed,
                Ok(Parsed::Frame { header, pdu, consumed }) => {
                    found.push((header, pdu.to_vec()));
                    consumed
                }
            };
            buffer.drain(..used);
        }
    }
    (found, None)
}
