//! Where a PDU ends as far as its beginning tells, and what the public functions are, each by a table of all codes.

use mobgate::modbus::Exception;
use mobgate::modbus::pdu::{
    End, confirmation, function_name, is_broadcastable, request_end, request_length, response_end,
};

use crate::prelude::*;
use crate::samples::EXAMPLES;

/// A read of one register.
const READ: [u8; 5] = [3, 0, 7, 0, 1];

/// By function: behind how many bytes the end of a request is known, and that of its response, none where only silence tells; and
/// its name.
const TOLD: &[(u8, Option<usize>, Option<usize>, &str)] = &[
    (1, Some(1), Some(1), "read coils"),
    (2, Some(1), Some(1), "read discrete inputs"),
    (3, Some(1), Some(1), "read holding registers"),
    (4, Some(1), Some(1), "read input registers"),
    (5, Some(1), Some(1), "write single coil"),
    (6, Some(1), Some(1), "write single register"),
    (7, Some(1), Some(1), "read exception status"),
    // The query that is sent back may have any length: that of its response is known.
    (8, None, Some(1), "diagnostics"),
    (11, Some(1), Some(1), "get comm event counter"),
    (12, Some(1), Some(2), "get comm event log"),
    (15, Some(6), Some(1), "write multiple coils"),
    (16, Some(6), Some(1), "write multiple registers"),
    (17, Some(1), Some(2), "report server id"),
    (20, Some(2), Some(1), "read file record"),
    (21, Some(2), Some(1), "write file record"),
    (22, Some(1), Some(1), "mask write register"),
    (23, Some(10), Some(1), "read/write multiple registers"),
    (24, Some(1), Some(3), "read FIFO queue"),
    (43, Some(2), None, "encapsulated interface transport"),
];

/// What is said of the end with so many bytes of a PDU of `length` there, when `told` of them tell it.
fn end_with(there: usize, told: Option<usize>, length: usize) -> End {
    match told {
        Some(told) if there >= told => End::At(length),
        Some(_) => End::Later,
        None => End::Unknown,
    }
}

#[test]
fn the_end_is_known_with_the_byte_that_tells_it_and_not_before() {
    for ((request, response), (function, of_request, of_response, _)) in EXAMPLES.iter().zip(TOLD) {
        assert_eq!(request[0], *function);
        for there in 1..=request.len() {
            let expected = match (*function, there) {
                // Its sub-function tells that nothing will.
                (8, 1 | 2) => End::Later,
                _ => end_with(there, *of_request, request.len()),
            };
            assert_eq!(request_end(&request[..there]), expected, "{request:02X?} {there}");
            let known = matches!(expected, End::At(_)).then_some(request.len());
            assert_eq!(request_length(&request[..there]), known, "{request:02X?} {there}");
        }
        for there in 1..=response.len() {
            let expected = end_with(there, *of_response, response.len());
            assert_eq!(response_end(request, &response[..there]), expected, "{response:02X?} {there}");
        }
        assert_eq!(response_end(request, &[]), End::Later, "{function}");
        assert_eq!(response_end(request, &[function | 0x80]), End::At(2), "{function}");
        assert_eq!(response_end(request, &[function | 0x80, 4]), End::At(2), "{function}");
        assert_eq!(response_end(request, &[function | 0x80, 0]), End::Unknown, "there is no exception 0");
        assert_eq!(response_end(request, &[function ^ 1, 0, 0]), End::Unknown, "{function}");
    }
    assert_eq!(request_end(&[]), End::Later);
    let told = (response_end(&[], &[3]), response_length(&[], &[3]));
    assert_eq!(told, (End::Unknown, ResponseLength::Silence));
}

#[test]
fn of_a_code_that_is_not_public_only_the_silence_tells_the_end() {
    for function in (0..=255).filter(|function| TOLD.iter().all(|(public, ..)| public != function)) {
        for there in [&[function][..], &[function, 14], &[function, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0]] {
            assert_eq!((request_end(there), request_length(there)), (End::Unknown, None), "{there:02X?}");
            if function < 128 {
                assert_eq!(response_end(&[function, 0, 0, 0, 1], there), End::Unknown, "{there:02X?}");
            }
        }
    }
}

#[test]
fn diagnostics_have_a_length_by_their_sub_function_and_the_tunnel_by_its_type() {
    for sub in 0..=255 {
        let is_public = matches!(sub, 1..=4 | 10..=18 | 20);
        let expected = is_public.then_some(5);
        assert_eq!(request_length(&[8, 0, sub]), expected, "{sub}");
        assert_eq!(request_end(&[8, 0, sub]), expected.map_or(End::Unknown, End::At), "{sub}");
        assert_eq!(request_length(&[8, 1, sub]), None, "{sub}");
        let request = [8, 0, sub, 1, 2, 3];
        let response = match sub {
            0 => End::At(6),
            _ => expected.map_or(End::Unknown, End::At),
        };
        assert_eq!(response_end(&request, &[8]), response, "{sub}");
        assert_eq!(response_end(&[8, 1, sub, 1, 2], &[8]), End::Unknown, "{sub}");
        let tunnel = (sub == 14).then_some(4);
        assert_eq!(request_length(&[43, sub]), tunnel, "{sub}");
        assert_eq!(request_end(&[43, sub]), tunnel.map_or(End::Unknown, End::At), "{sub}");
    }
}

#[test]
fn a_count_that_no_pdu_has_room_for_tells_no_end() {
    for (head, most) in [
        (&[15, 0, 0, 0, 0][..], 247_u8),
        (&[16, 0, 0, 0, 0], 247),
        (&[20], 251),
        (&[21], 251),
        (&[23, 0, 0, 0, 0, 0, 0, 0, 0], 243),
    ] {
        let end = |count: u8| request_end(&[head, &[count]].concat());
        assert_eq!(end(most), End::At(PDU_BYTES_MAX), "{head:?}");
        assert_eq!((end(most + 1), end(255)), (End::Unknown, End::Unknown), "{head:?}");
        assert_eq!(end(0), End::At(head.len() + 1), "{head:?}");
    }
    for (request, head, most) in
        [(&[17][..], &[17][..], 251_u8), (&[12], &[12], 251), (&[24, 0, 0], &[24, 0], 250)]
    {
        let end = |count: u8| response_end(request, &[head, &[count]].concat());
        assert_eq!(end(most), End::At(PDU_BYTES_MAX), "{head:?}");
        assert_eq!((end(most + 1), end(255)), (End::Unknown, End::Unknown), "{head:?}");
    }
    assert_eq!(response_end(&[24, 0, 0], &[24, 1, 0]), End::Unknown);
    // What cannot have passed the check of requests.
    assert_eq!(response_end(&[3, 0, 0, 0, 126], &[3]), End::Unknown);
    assert_eq!(response_end(&[3, 0, 0, 0, 125], &[3]), End::At(252));
    assert_eq!(response_end(&[1, 0, 0, 0x07, 0xD8], &[1]), End::At(PDU_BYTES_MAX));
    assert_eq!(response_end(&[1, 0, 0, 0x07, 0xD9], &[1]), End::Unknown);
}

#[test]
fn a_read_that_is_answered_with_another_count_has_no_end() {
    for (request, response) in EXAMPLES.iter().filter(|(request, _)| matches!(request[0], 1..=4 | 23)) {
        for count in 0..=255 {
            let right = count == response[1];
            let expected = if right { End::At(response.len()) } else { End::Unknown };
            assert_eq!(response_end(request, &[request[0], count]), expected, "{request:02X?} {count}");
            assert_eq!(response_end(request, &[request[0], count, 1]), expected, "{request:02X?} {count}");
        }
    }
    // Of other functions the second byte is no count.
    assert_eq!(response_end(&[7], &[7, 0]), End::At(2));
    assert_eq!(response_end(&[5, 9, 9, 0, 0], &[5, 9]), End::At(5));
}

#[test]
fn files_are_read_in_responses_of_up_to_a_whole_pdu() {
    let group = |registers: u16| {
        let [high, low] = registers.to_be_bytes();
        [6, 0, 1, 0, 0, high, low]
    };
    let length = |registers: &[u16]| {
        let groups: Vec<u8> = registers.iter().flat_map(|&registers| group(registers)).collect();
        response_length(&[&[20, groups.len() as u8], &groups[..]].concat(), &[20])
    };
    assert_eq!(length(&[1]), ResponseLength::Known(6));
    assert_eq!(length(&[2, 3]), ResponseLength::Known(2 + 6 + 8));
    assert_eq!(length(&[124]), ResponseLength::Known(252));
    for bad in [&[125][..], &[0], &[1, 0], &[0, 1], &[60, 64], &[]] {
        assert_eq!(length(bad), ResponseLength::Silence, "{bad:?}");
    }
    assert_eq!(length(&[60, 63]), ResponseLength::Known(2 + 122 + 128));
    assert_eq!(length(&[256]), ResponseLength::Silence);
}

#[test]
fn each_public_function_has_its_name_and_no_other_code_has_one() {
    for function in 0..=127 {
        let public = TOLD.iter().find(|(public, ..)| *public == function);
        let name = public.map_or("unlisted function", |(.., name)| name);
        assert_eq!((function_name(function), function_name(function | 0x80)), (name, name), "{function}");
    }
}

#[test]
fn what_changes_something_may_be_broadcast_and_what_wants_a_response_may_not() {
    for function in 0..=255 {
        // Reads, and 23 and 43, which are of no use without a response.
        let wants_response = matches!(function, 1..=4 | 7 | 11 | 12 | 17 | 20 | 23 | 24 | 43);
        for request in [&[function][..], &[function, 13, 0, 0, 1], &[function, 14, 0, 0, 1]] {
            assert_eq!(is_broadcastable(request), !wants_response, "{request:?}");
        }
    }
    assert!(!is_broadcastable(&[]));
}

#[test]
fn a_response_of_its_own_is_known_for_writes_that_are_repeated_to_the_requester() {
    for function in 0..=255 {
        let request = [function, 1, 2, 3, 4, 5, 6, 7, 8];
        let repeated = match function {
            5 | 6 | 15 | 16 => Some(&request[..5]),
            22 => Some(&request[..7]),
            _ => None,
        };
        assert_eq!(confirmation(&request), repeated, "{function}");
        let bytes = repeated.map_or(5, <[u8]>::len);
        assert_eq!(confirmation(&request[..bytes - 1]), None, "{function}");
        assert_eq!(confirmation(&request[..bytes]), repeated, "{function}");
    }
    assert_eq!(confirmation(&[]), None);
}

#[test]
fn of_what_is_not_repeated_nothing_is_compared() {
    // A word that the device chooses, of all sub-functions but those whose data come back.
    for sub in 0..=255_u8 {
        let comes_back = matches!(sub, 0 | 1 | 3 | 4 | 10 | 20);
        let other = fits(&[8, 0, sub, 0, 0], &[8, 0, sub, 0, 7]);
        assert_eq!(other, if comes_back { Err(Misfit::Echo) } else { Ok(()) }, "{sub}");
        assert_eq!(fits(&[8, 0, sub, 0, 0], &[8, 1, sub, 0, 0]), Err(Misfit::Echo), "{sub}");
    }
    assert_eq!(fits(&[43, 14, 1, 0], &[43, 14, 1, 9]), Ok(()));
    assert_eq!(fits(&[65, 1], &[65, 2]), Ok(()));
    assert_eq!(fits(&[65, 1], &[]), Err(Misfit::Length));
    assert_eq!(fits(&[], &[65]), Err(Misfit::Length));
    assert_eq!(fits(&[12], &[12, 6, 0, 0, 0, 0, 0, 0]), Ok(()));
    assert_eq!(Exception(0x0B).response(0x18), [0x98, 0x0B]);
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
