//! PDU: which requests pass, how long responses are, which responses fit.

use mobgate::modbus::Exception;
use mobgate::modbus::pdu::{check_request, function_name, is_read};

use crate::prelude::*;
use crate::samples::{EXAMPLES, exchange, request};

/// Whether `function` with these first fields has a length of its own; else any length passes.
fn has_fixed_shape(request: &[u8]) -> bool {
    match request {
        [8, ..] | [43, 13, ..] => false,
        [function, ..] => matches!(function, 1..=7 | 11 | 12 | 15..=17 | 20..=24 | 43),
        [] => false,
    }
}

#[test]
fn the_specifications_examples_pass_and_fit() {
    for (request, response) in EXAMPLES {
        assert_eq!(check_request(request), Ok(()), "{request:02X?}");
        assert_eq!(fits(request, response), Ok(()), "{request:02X?}");
        assert_eq!(fits(request, &[request[0] | 0x80, 2]), Ok(()), "{request:02X?}");
    }
}

#[test]
fn a_response_to_another_function_never_fits() {
    for (request, _) in EXAMPLES {
        for (other, response) in EXAMPLES.iter().filter(|(other, _)| other[0] != request[0]) {
            assert_eq!(fits(request, response), Err(Misfit::Function), "{request:02X?} {other:02X?}");
            assert_eq!(fits(request, &[other[0] | 0x80, 2]), Err(Misfit::Function));
        }
    }
}

#[test]
fn an_exception_is_two_bytes_with_a_code() {
    let request = [3, 0, 0, 0, 1];
    assert_eq!(fits(&request, &[0x83, 0]), Err(Misfit::Function));
    assert_eq!(fits(&request, &[0x83]), Err(Misfit::Length));
    assert_eq!(fits(&request, &[0x83, 2, 0]), Err(Misfit::Length));
    assert_eq!(fits(&request, &Exception::BUSY.response(3)), Ok(()));
    assert_eq!(Exception::GATEWAY_NO_PATH.response(0x10), [0x90, 0x0A]);
    assert_eq!(Exception::BUSY.to_string(), "server device busy (06h)");
    assert_eq!(Exception(0x77).to_string(), "exception (77h)");
}

#[test]
fn quantities_pass_up_to_the_protocols_limits() {
    let read = |function: u8, quantity: u16| {
        let [high, low] = quantity.to_be_bytes();
        check_request(&[function, 0, 0, high, low]).is_ok()
    };
    let write = |head: &[u8], quantity: u16, bytes: usize| {
        let pdu = [head, &[0, 0], &quantity.to_be_bytes(), &[bytes as u8], &vec![0; bytes]].concat();
        check_request(&pdu).is_ok()
    };
    for (function, max) in [(1, 2000), (2, 2000), (3, 125), (4, 125)] {
        assert!(read(function, 1) && read(function, max));
        assert!(!read(function, 0) && !read(function, max + 1) && !read(function, u16::MAX));
    }
    assert!(write(&[15], 1968, 246) && !write(&[15], 1969, 247) && !write(&[15], 0, 0));
    assert!(write(&[16], 123, 246) && !write(&[16], 124, 248) && !write(&[16], 0, 0));
    let read_125 = [23, 0, 0, 0, 125];
    assert!(write(&read_125, 121, 242) && !write(&read_125, 122, 244) && !write(&read_125, 0, 0));
    assert!(!write(&[23, 0, 0, 0, 126], 1, 2) && !write(&[23, 0, 0, 0, 0], 1, 2));
    // A count that disagrees with the quantity, in either direction.
    assert!(!write(&[15], 8, 2) && !write(&[15], 9, 1) && !write(&[16], 1, 1) && !write(&[16], 1, 4));
}

#[test]
fn values_that_a_function_cannot_have_are_refused() {
    let refused: &[&[u8]] = &[
        &[],
        // Diagnostics without a whole sub-function.
        &[8],
        &[8, 0],
        // Byte counts that belong to neither the quantity nor the data.
        &[15, 0, 0, 0, 8, 2, 0],
        &[16, 0, 0, 0, 1, 3, 0, 0],
        &[5, 0, 0, 0x00, 0xFF],
        &[5, 0, 0, 0x01, 0x00],
        // File records: no group, a length of 0, half a group, a response longer than a PDU, data missing.
        &[20],
        &[20, 0],
        &[20, 7, 6, 0, 1, 0, 0, 0, 0],
        &[20, 6, 6, 0, 1, 0, 0, 0],
        &[20, 8, 6, 0, 1, 0, 0, 0, 1, 6],
        &[20, 7, 6, 0, 1, 0, 0, 0, 125],
        &[21],
        &[21, 0],
        &[21, 7, 6, 0, 1, 0, 0, 0, 0],
        &[21, 8, 6, 0, 1, 0, 0, 0, 1, 0],
        // Device identification: codes 0 and 5 do not exist.
        &[43],
        &[43, 14],
        &[43, 14, 0, 0],
        &[43, 14, 5, 0],
    ];
    for pdu in refused {
        assert_eq!(check_request(pdu), Err(Exception::ILLEGAL_VALUE), "{pdu:02X?}");
    }
    assert_eq!(check_request(&[20, 7, 6, 0, 1, 0, 0, 0, 124]), Ok(()));
    // Echo requests without data exist.
    assert_eq!(check_request(&[8, 0, 0]), Ok(()));
}

#[test]
fn function_codes_0_and_above_127_are_refused_and_all_others_can_pass() {
    for function in 0..=255 {
        let refused = function == 0 || function >= 128;
        for pdu in [vec![function], vec![function; PDU_BYTES_MAX]] {
            assert_eq!(check_request(&pdu) == Err(Exception::ILLEGAL_FUNCTION), refused, "{pdu:02X?}");
        }
        let known = EXAMPLES.iter().any(|(request, _)| request[0] == function & 0x7F);
        assert_eq!(function_name(function) == "unlisted function", !known, "{function}");
        if !refused && !known {
            assert_eq!(check_request(&[function]), Ok(()));
            assert_eq!(check_request(&vec![function; PDU_BYTES_MAX]), Ok(()));
            assert!(check_request(&vec![function; PDU_BYTES_MAX + 1]).is_err());
        }
    }
}

#[test]
fn nothing_that_can_write_counts_as_a_read() {
    let reads: Vec<u8> = (0..=255).filter(|&function| is_read(&[function, 0, 0, 0, 1])).collect();
    assert_eq!(reads, [1, 2, 3, 4, 7, 11, 12, 17, 20, 24]);
    let types: Vec<u8> = (0..=255).filter(|&mei| is_read(&[43, mei, 1, 0])).collect();
    assert_eq!(types, [14], "of function 43 only the device identification");
    assert!(!is_read(&[43]) && !is_read(&[]));
}

#[test]
fn counts_that_disagree_with_the_request_or_the_data_are_a_length_misfit() {
    let files = EXAMPLES.iter().find(|(request, _)| request[0] == 20).unwrap().0;
    let misfits: &[(&[u8], &[u8])] = &[
        (&[1, 0, 0, 0, 8], &[1, 2, 0]),
        (&[3, 0, 0, 0, 1], &[3, 3, 0, 0]),
        (&[23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 0], &[23, 1, 0, 0]),
        // The event log's head has six bytes.
        (&[12], &[12, 5, 0, 0, 0, 0, 0]),
        // File records: the whole's count, then the groups' lengths exchanged, then one beyond the end.
        (files, &[20, 11, 5, 6, 0, 0, 0, 0, 5, 6, 0, 0, 0, 0]),
        (files, &[20, 12, 3, 6, 0, 0, 7, 6, 0, 0, 0, 0, 0, 0]),
        (files, &[20, 12, 7, 6, 0, 0, 0, 0, 0, 0, 3, 6, 0, 0]),
        (files, &[20, 12, 5, 6, 0, 0, 0, 0, 9, 6, 0, 0, 0, 0]),
        // The queue's count of registers, and a queue without one.
        (&[24, 0, 0], &[24, 0, 6, 0, 3, 0, 0, 0, 0]),
        (&[24, 0, 0], &[24, 0, 6, 0, 1, 0, 0, 0, 0]),
        (&[24, 0, 0], &[24, 0, 0]),
        (&[24, 0, 0], &[24, 0, 1, 0]),
        (&[0x41], &[0x41; PDU_BYTES_MAX + 1]),
    ];
    for (request, response) in misfits {
        assert_eq!(fits(request, response), Err(Misfit::Length), "{response:02X?}");
    }
    assert_eq!(fits(&[24, 0, 0], &[24, 0, 2, 0, 0]), Ok(()));
    assert_eq!(fits(&[0x41], &[0x41; PDU_BYTES_MAX]), Ok(()));
}

#[test]
fn a_response_that_repeats_another_field_is_an_echo_misfit() {
    // For each function that repeats fields: the first and the last byte of the response that must be the request's.
    for (function, first, last) in
        [(5, 1, 4), (6, 1, 4), (8, 1, 4), (15, 1, 4), (16, 1, 4), (21, 1, 14), (22, 1, 6), (43, 1, 2)]
    {
        let (request, response) = EXAMPLES.iter().find(|(request, _)| request[0] == function).unwrap();
        for at in first..=last {
            let mut wrong = response.to_vec();
            wrong[at] ^= 1;
            assert_eq!(fits(request, &wrong), Err(Misfit::Echo), "{wrong:02X?} at {at}");
        }
    }
    // The tunnel's type, and the data of the sub-functions that repeat it.
    assert_eq!(fits(&[43, 13, 1], &[43, 14, 1]), Err(Misfit::Echo));
    assert_eq!(fits(&[43, 13, 1], &[43, 13, 2]), Ok(()));
    for sub in [0, 1, 3, 10, 20] {
        assert_eq!(fits(&[8, 0, sub, 0, 0], &[8, 0, sub, 0, 1]), Err(Misfit::Echo), "{sub}");
    }
    // A counter is the device's to say, its sub-function is not.
    assert_eq!(fits(&[8, 0, 11, 0, 0], &[8, 0, 11, 1, 2]), Ok(()));
    assert_eq!(fits(&[8, 0, 11, 0, 0], &[8, 0, 12, 1, 2]), Err(Misfit::Echo));
}

proptest! {
    #[test]
    fn a_correct_exchange_passes_and_fits((request, response) in exchange()) {
        prop_assert_eq!(check_request(&request), Ok(()));
        prop_assert_eq!(fits(&request, &response), Ok(()));
    }

    #[test]
    fn a_length_is_never_announced_wrongly((request, response) in exchange()) {
        let mut known = false;
        for end in 0..=response.len() {
            match response_length(&request, &response[..end]) {
                ResponseLength::Known(length) => {
                    prop_assert_eq!(length, response.len());
                    known = true;
                }
                ResponseLength::More => prop_assert!(!known && end < 3),
                ResponseLength::Silence => prop_assert!(!known && end > 0),
            }
        }
        let by_silence = response[0] == request[0] && match request[..] {
            [8, high, low, ..] => high != 0 || !matches!(low, 0..=4 | 10..=18 | 20),
            [function, ..] => !matches!(function, 1..=7 | 11 | 12 | 15..=17 | 20..=24),
            [] => unreachable!("requests have a function code"),
        };
        prop_assert_eq!(known, !by_silence);
    }

    #[test]
    fn a_truncated_or_longer_response_does_not_fit((request, response) in exchange(), more in any::<u8>()) {
        if let ResponseLength::Known(_) = response_length(&request, &response) {
            for end in 0..response.len() {
                prop_assert_eq!(fits(&request, &response[..end]), Err(Misfit::Length));
            }
            prop_assert_eq!(fits(&request, &[&response[..], &[more]].concat()), Err(Misfit::Length));
        }
    }

    #[test]
    fn a_truncated_or_longer_request_is_refused(request in request(), more in any::<u8>()) {
        if has_fixed_shape(&request) {
            for end in 0..request.len() {
                prop_assert_eq!(check_request(&request[..end]), Err(Exception::ILLEGAL_VALUE));
            }
            let longer = [&request[..], &[more]].concat();
            prop_assert_eq!(check_request(&longer), Err(Exception::ILLEGAL_VALUE));
        }
    }

    #[test]
    fn a_response_fits_no_read_of_another_quantity((request, response) in exchange(), quantity in 1u16..=125) {
        if matches!(request[0], 3 | 4 | 23) && response[0] == request[0] {
            let mut other = request.clone();
            other[3..5].copy_from_slice(&quantity.to_be_bytes());
            prop_assert_eq!(fits(&other, &response).is_ok(), other == request);
        }
    }

    #[test]
    fn random_bytes_never_panic(request in vec(any::<u8>(), 0..=300), response in vec(any::<u8>(), 0..=300)) {
        let _ = check_request(&request);
        let _ = response_length(&request, &response);
        if fits(&request, &response).is_ok() {
            prop_assert!((1..=PDU_BYTES_MAX).contains(&response.len()));
            prop_assert_eq!(response[0] | 0x80, request[0] | 0x80);
        }
    }
}
