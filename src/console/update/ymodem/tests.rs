//! The receiver by value: how it responds to bytes and to silences.

extern crate std;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;

fn block(number: u8, data: &[u8]) -> Vec<u8> {
    let (first, length) = if data.len() > SHORT_BYTES { (STX, LONG_BYTES) } else { (SOH, SHORT_BYTES) };
    let mut padded = data.to_vec();
    padded.resize(length, 0x1a);
    let crc = CRC.checksum(&padded).to_be_bytes();
    [&[first, number, !number][..], &padded, &crc].concat()
}

fn header(name: &str, length: &str) -> Vec<u8> {
    let mut data = [name.as_bytes(), &[0], length.as_bytes(), &[0]].concat();
    data.resize(SHORT_BYTES, 0);
    block(0, &data)
}

/// Feeds all bytes; all but the last must do nothing.
fn feed(receiver: &mut Receiver, bytes: &[u8]) -> Action {
    let (last, others) = bytes.split_last().unwrap();
    for byte in others {
        assert_eq!(receiver.feed(*byte), Action::More);
    }
    receiver.feed(*last)
}

/// A receiver that has asked once.
fn asking() -> Receiver {
    let mut receiver = Receiver::new();
    assert_eq!(receiver.silence(), Action::Send(b"C"));
    receiver
}

/// A receiver of a file.
fn begun(length: &str) -> Receiver {
    let mut receiver = asking();
    let came = feed(&mut receiver, &header("firmware.mgu", length));
    assert_eq!(came, Action::Begin(length.split(' ').next().and_then(|digits| digits.parse().ok())));
    assert_eq!(receiver.accepted(), [ACK, ASK]);
    receiver
}

#[test]
fn crc_is_that_of_the_protocol() {
    // "CRC-16/XMODEM" in the catalogue of parametrised CRC algorithms.
    assert_eq!(CRC.checksum(b"123456789"), 0x31c3);
}

#[test]
fn a_file_of_known_length_arrives_without_its_padding_and_ends_with_the_first_eot() {
    let mut receiver = begun("1100 14716024117 100644");
    assert_eq!(feed(&mut receiver, &block(1, &[7; 1024])), Action::Data);
    assert_eq!(receiver.data(), [7; 1024]);
    assert_eq!(receiver.accepted(), [ACK]);
    assert_eq!(feed(&mut receiver, &block(2, &[8; 76])), Action::Data);
    assert_eq!(receiver.data(), [8; 76]);
    assert_eq!(receiver.accepted(), [ACK]);
    assert_eq!(receiver.feed(EOT), Action::Finish);
    assert_eq!(receiver.accepted(), [ACK, ASK]);
    assert_eq!(feed(&mut receiver, &block(0, &[0; 128])), Action::Done(&[ACK]));
}

#[test]
fn the_end_of_a_file_of_unknown_length_comes_twice() {
    for length in ["", "?"] {
        let mut receiver = begun(length);
        assert_eq!(feed(&mut receiver, &block(1, &[7; 100])), Action::Data);
        assert_eq!(receiver.data().len(), 128, "the padding cannot be told apart");
        receiver.accepted();
        assert_eq!(receiver.feed(EOT), Action::Send(&[NAK]));
        assert_eq!(receiver.feed(EOT), Action::Finish);
        assert_eq!(receiver.accepted(), [ACK, ASK]);
        assert_eq!(receiver.feed(EOT), Action::Send(&[ACK, ASK]), "its acknowledgement was lost");
    }
}

#[test]
fn block_numbers_wrap() {
    let mut receiver = begun("100000");
    for number in 1..=600u32 {
        let came = feed(&mut receiver, &block(number as u8, &[number as u8; 128]));
        assert_eq!(came, Action::Data, "block {number}");
        assert_eq!(receiver.accepted(), [ACK]);
    }
}

#[test]
fn a_block_that_came_already_is_acknowledged_and_not_written_again() {
    let mut receiver = begun("1000");
    assert_eq!(feed(&mut receiver, &header("firmware.mgu", "1000")), Action::Send(&[ACK, ASK]));
    assert_eq!(feed(&mut receiver, &block(1, &[7; 128])), Action::Data);
    receiver.accepted();
    assert_eq!(feed(&mut receiver, &block(1, &[7; 128])), Action::Send(&[ACK]));
    assert_eq!(feed(&mut receiver, &block(2, &[8; 128])), Action::Data);
    receiver.accepted();
    assert_eq!(feed(&mut receiver, &block(4, &[9; 128])), Action::Stopped(Stopped::OutOfOrder));
}

#[test]
fn any_corrupt_byte_of_a_block_makes_it_come_again() {
    let good = block(1, &[0x55; 128]);
    for at in 0..good.len() {
        for change in [0x01, 0x80, 0xff] {
            let mut receiver = begun("1000");
            let mut bad = good.clone();
            bad[at] ^= change;
            for byte in bad {
                // A corrupt first byte may look like any other.
                let came = receiver.feed(byte);
                assert!(matches!(came, Action::More), "byte {at} ^ {change:#x}: {came:?}");
            }
            assert_eq!(receiver.silence(), Action::Send(&[NAK]));
            assert_eq!(feed(&mut receiver, &good), Action::Data);
        }
    }
}

#[test]
fn a_lost_byte_is_missed_after_a_second_and_a_lost_block_after_five() {
    let mut receiver = begun("1000");
    assert_eq!(receiver.patience(), Duration::from_secs(5));
    assert_eq!(receiver.silence(), Action::Send(&[NAK]));
    let good = block(1, &[7; 128]);
    assert_eq!(feed(&mut receiver, &good[1..]), Action::More);
    assert_eq!(
        receiver.patience(),
        Duration::from_secs(1),
        "the number 1 looks like the beginning of a block"
    );
    assert_eq!(receiver.silence(), Action::Send(&[NAK]));
    assert_eq!(feed(&mut receiver, &good[2..]), Action::More);
    assert_eq!(receiver.patience(), Duration::from_millis(200), "this does not");
    assert_eq!(receiver.silence(), Action::Send(&[NAK]));
    assert_eq!(feed(&mut receiver, &good[..130]), Action::More);
    assert_eq!(receiver.patience(), Duration::from_secs(1));
    assert_eq!(receiver.silence(), Action::Send(&[NAK]));
    assert_eq!(feed(&mut receiver, &good), Action::Data);
}

#[test]
fn it_gives_up_after_ten_failures_in_a_row_and_after_two_minutes_without_a_file() {
    let mut receiver = begun("1000");
    for number in 1..=2 {
        (0..10).for_each(|_| assert_eq!(receiver.silence(), Action::Send(&[NAK])));
        assert_eq!(feed(&mut receiver, &block(number, &[7; 128])), Action::Data);
        receiver.accepted();
    }
    (0..10).for_each(|_| assert_eq!(receiver.silence(), Action::Send(&[NAK])));
    assert_eq!(receiver.silence(), Action::Stopped(Stopped::Silent));

    let mut receiver = Receiver::new();
    (0..40).for_each(|_| assert_eq!(receiver.silence(), Action::Send(b"C")));
    assert_eq!(receiver.patience() * 40, Duration::from_secs(120));
    assert_eq!(receiver.silence(), Action::Stopped(Stopped::NoFile));
}

#[test]
fn two_cans_or_ctrl_c_between_blocks_cancel_and_one_can_does_not() {
    for start in [asking, || begun("1000")] {
        assert_eq!(feed(&mut start(), &[CAN, CAN]), Action::Stopped(Stopped::Cancelled));
        assert_eq!(start().feed(CTRL_C), Action::Stopped(Stopped::Cancelled));
        let mut receiver = start();
        assert_eq!(feed(&mut receiver, &[CAN, b'x', CAN, CAN, CTRL_C]), Action::More);
        assert!(matches!(receiver.silence(), Action::Send(_)));
        // Within a block they are data.
        assert_eq!(feed(&mut begun("1000"), &block(1, &[CAN, CAN, CTRL_C, EOT])), Action::Data);
    }
}

#[test]
fn keys_before_the_file_do_no_harm() {
    let mut receiver = asking();
    for keys in [&b"\r\n"[..], b"help\r", &[EOT], &[0]] {
        assert_eq!(feed(&mut receiver, keys), Action::More);
        assert_eq!(receiver.silence(), Action::Send(b"C"));
    }
    assert_eq!(feed(&mut receiver, &header("x", "5")), Action::Begin(Some(5)));
}

#[test]
fn a_transfer_without_a_file_and_one_with_two_end_it() {
    assert_eq!(feed(&mut asking(), &block(0, &[0; 128])), Action::Stopped(Stopped::NoFile));
    assert_eq!(feed(&mut asking(), &block(1, &[0; 128])), Action::Stopped(Stopped::OutOfOrder));
    let mut receiver = begun("0");
    assert_eq!(receiver.feed(EOT), Action::Finish);
    receiver.accepted();
    assert_eq!(feed(&mut receiver, &header("second", "5")), Action::Stopped(Stopped::SecondFile));
}

#[test]
fn a_file_that_is_whole_is_taken_even_if_its_sender_leaves_without_the_last_block() {
    let mut receiver = begun("0");
    assert_eq!(receiver.feed(EOT), Action::Finish);
    receiver.accepted();
    assert_eq!(receiver.silence(), Action::Send(b"C"));
    assert_eq!(receiver.silence(), Action::Done(&[]));
}

proptest! {
    #[test]
    fn any_file_arrives_as_it_was_in_blocks_of_any_size(
        file in proptest::collection::vec(any::<u8>(), 0..5000),
        sizes in proptest::collection::vec(any::<bool>(), 1..6),
    ) {
        let mut receiver = begun(&std::format!("{}", file.len()));
        let (mut rest, mut arrived) = (&file[..], Vec::new());
        let mut number = 0u8;
        while !rest.is_empty() {
            let long = sizes[usize::from(number) % sizes.len()];
            number = number.wrapping_add(1);
            let (now, later) = rest.split_at(rest.len().min(if long { LONG_BYTES } else { SHORT_BYTES }));
            rest = later;
            prop_assert_eq!(feed(&mut receiver, &block(number, now)), Action::Data);
            arrived.extend_from_slice(receiver.data());
            receiver.accepted();
        }
        prop_assert_eq!(receiver.feed(EOT), Action::Finish);
        prop_assert_eq!(arrived, file);
    }

    #[test]
    fn random_bytes_never_panic_nor_pass_for_data(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
        let mut receiver = begun("100000");
        for byte in bytes {
            let came = if byte % 61 == 0 { receiver.silence() } else { receiver.feed(byte) };
            prop_assert_ne!(came, Action::Data);
            if matches!(came, Action::Stopped(_) | Action::Done(_)) {
                break;
            }
            if matches!(came, Action::Finish) {
                receiver.accepted();
            }
        }
    }
}
