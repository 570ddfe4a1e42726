//! Update files in any pieces, whole and broken.

use mobgate_image::{
    BOARD_BYTES_MAX, DECIDED_BYTES, HEADER_BYTES, Header, INFO_OFFSET, Info, Receiver, Refused, Version,
};
use proptest::prelude::*;
use proptest::sample::Index;

const ROOM_BYTES: u32 = 64 * 1024;

mobgate_image::info!(THIS, "NUCLEO-H743ZI");

fn running() -> Info {
    Info::new("NUCLEO-H743ZI", "1.2.3").unwrap()
}

/// A firmware of `bytes` that is not all the same, with this info.
fn firmware(info: Info, bytes: usize) -> Vec<u8> {
    let mut firmware: Vec<u8> = (0..bytes).map(|index| (index / 3) as u8).collect();
    let block = info.to_bytes();
    firmware[INFO_OFFSET..INFO_OFFSET + block.len()].copy_from_slice(&block);
    firmware
}

fn file(firmware: &[u8]) -> Vec<u8> {
    let header = Header { firmware_bytes: firmware.len() as u32, signature: [7; 64] };
    [header.to_bytes().as_slice(), firmware].concat()
}

/// Hands `file` over in pieces that end at `cuts`. The firmware, or the reason and how many bytes had come by then.
fn receive(file: &[u8], cuts: &[Index], older: bool) -> Result<(Vec<u8>, Header, Info), (Refused, usize)> {
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(file.len() + 1)).collect();
    ends.push(file.len());
    ends.sort_unstable();
    let mut receiver = Receiver::new(running(), ROOM_BYTES, older);
    let (mut firmware, mut from) = (Vec::new(), 0);
    for end in ends {
        match receiver.take(&file[from..end]) {
            Ok(bytes) => firmware.extend_from_slice(bytes),
            Err(refused) => {
                assert_eq!(receiver.take(b"more"), Err(refused), "it stays refused");
                assert_eq!(receiver.finish().unwrap_err(), refused);
                return Err((refused, end));
            }
        }
        from = end;
    }
    assert_eq!(receiver.progress().0, firmware.len() as u32);
    let (header, info) = receiver.finish().map_err(|refused| (refused, from))?;
    Ok((firmware, header, info))
}

fn cuts() -> impl Strategy<Value = Vec<Index>> {
    prop::collection::vec(any::<Index>(), 0..40)
}

fn length() -> impl Strategy<Value = usize> {
    DECIDED_BYTES - HEADER_BYTES..3000
}

proptest! {
    #[test]
    fn a_file_gives_its_firmware_in_any_pieces(cuts in cuts(), bytes in length()) {
        let image = firmware(Info::new("NUCLEO-H743ZI", "1.3.0").unwrap(), bytes);
        let (received, header, info) = receive(&file(&image), &cuts, false).unwrap();
        prop_assert_eq!(received, image);
        prop_assert_eq!(header, Header { firmware_bytes: bytes as u32, signature: [7; 64] });
        prop_assert_eq!((info.board(), info.version().to_string()), ("NUCLEO-H743ZI", "1.3.0".to_owned()));
    }

    #[test]
    fn what_ends_early_is_truncated_and_what_goes_on_is_too_long(
        cuts in cuts(), bytes in length(), end in any::<Index>(), more in 1..100_usize,
    ) {
        let mut file = file(&firmware(running(), bytes));
        let end = end.index(file.len());
        let refused = receive(&file[..end], &cuts, false).unwrap_err().0;
        let missing_bytes = (file.len() - end) as u32;
        if end < HEADER_BYTES {
            prop_assert_eq!(refused, Refused::NotAnImage);
        } else {
            prop_assert_eq!(refused, Refused::Truncated { missing_bytes });
        }
        file.resize(file.len() + more, 0x1a);
        prop_assert_eq!(receive(&file, &cuts, false).unwrap_err().0, Refused::TooLong);
    }

    #[test]
    fn a_foreign_or_older_firmware_is_refused_by_its_first_bytes(cuts in cuts(), bytes in length(), older: bool) {
        let foreign = Info::new("NUCLEO-H743ZI2", "9.9.9").unwrap();
        let whole = file(&firmware(foreign, bytes));
        let (refused, _) = receive(&whole[..DECIDED_BYTES], &cuts, older).unwrap_err();
        prop_assert_eq!(refused, Refused::OtherBoard(foreign));

        let old = Info::new("NUCLEO-H743ZI", "1.2.3-rc.9").unwrap();
        let whole = file(&firmware(old, bytes));
        if older {
            prop_assert!(receive(&whole, &cuts, true).is_ok());
        } else {
            let (refused, _) = receive(&whole[..DECIDED_BYTES], &cuts, false).unwrap_err();
            prop_assert_eq!(refused, Refused::Older(old.version()));
        }
    }

    #[test]
    fn anything_else_is_not_an_image(bytes: Vec<u8>, cuts in cuts()) {
        prop_assume!(!bytes.starts_with(b"MOBGATE\x01"));
        prop_assert_eq!(receive(&bytes, &cuts, true).unwrap_err().0, Refused::NotAnImage);
    }

    #[test]
    fn no_bytes_panic(bytes: Vec<u8>, length: u32, flip in any::<Index>(), cuts in cuts()) {
        let mut file = file(&firmware(running(), 2000));
        file[8..12].copy_from_slice(&length.to_le_bytes());
        let _ = receive(&file, &cuts, true);
        let at = flip.index(file.len());
        file.splice(at.., bytes);
        let _ = receive(&file, &cuts, true);
    }

    #[test]
    fn versions_are_ordered_as_their_numbers_and_read_back(
        a in any::<[u16; 3]>(), b in any::<[u16; 3]>(), kind in 0..4_usize, number in 0..16384_u16,
    ) {
        let text = |[x, y, z]: [u16; 3]| format!("{x}.{y}.{z}");
        let parse = |text: &str| Version::parse(text).unwrap();
        prop_assert_eq!(parse(&text(a)).cmp(&parse(&text(b))), a.cmp(&b));
        let before = ["alpha", "beta", "rc"].get(kind).map(|kind| format!("-{kind}.{number}"));
        let text = text(a) + &before.unwrap_or_default();
        prop_assert_eq!(parse(&text).to_string(), text.as_str());
        prop_assert_eq!(Info::new("x", &text).unwrap().version(), parse(&text));
    }
}

#[test]
fn pre_releases_come_before_their_version() {
    let texts =
        ["1.0.0-alpha.1", "1.0.0-alpha.2", "1.0.0-beta.1", "1.0.0-rc.1", "1.0.0-rc.10", "1.0.0", "1.0.1"];
    let versions = texts.map(|text| Version::parse(text).unwrap());
    assert!(versions.is_sorted_by(|a, b| a < b));
}

#[test]
fn what_is_no_version_of_ours_is_refused() {
    for text in [
        "",
        "1",
        "1.2",
        "1.2.",
        "1.2.3.4",
        "1.2.65536",
        "01.2.3",
        "1.2.3-",
        "1.2.3-rc",
        "1.2.3-rc.16384",
        "1.2.3-rc.1.2",
        "1.2.3-dev.1",
        "1.2.3+4",
        "v1.2.3",
        " 1.2.3",
    ] {
        assert_eq!(Version::parse(text), None, "{text:?}");
    }
}

#[test]
fn a_boards_name_is_short_printable_ascii() {
    let longest = "x".repeat(BOARD_BYTES_MAX);
    assert_eq!(Info::new(&longest, "1.0.0").unwrap().board(), longest);
    for name in ["", "seventeen letters", "na\u{ef}ve", "a\0b", "a\n"] {
        assert_eq!(Info::new(name, "1.0.0"), None, "{name:?}");
    }
}

#[test]
fn a_firmware_that_has_no_room_or_no_info_is_refused_by_its_header() {
    let header = |firmware_bytes| Header { firmware_bytes, signature: [0; 64] }.to_bytes();
    let refused = |firmware_bytes| {
        let mut receiver = Receiver::new(running(), ROOM_BYTES, false);
        receiver.take(&header(firmware_bytes)).err()
    };
    assert_eq!(refused(ROOM_BYTES), None);
    let bytes_max = ROOM_BYTES;
    assert_eq!(refused(ROOM_BYTES + 1), Some(Refused::TooLarge { bytes: ROOM_BYTES + 1, bytes_max }));
    assert_eq!(refused((DECIDED_BYTES - HEADER_BYTES) as u32), None);
    assert_eq!(refused((DECIDED_BYTES - HEADER_BYTES) as u32 - 1), Some(Refused::NotAnImage));
}

#[test]
fn a_reason_says_what_a_person_can_use() {
    let other = Info::new("NUCLEO-F767ZI", "1.0.0").unwrap();
    assert_eq!(Refused::OtherBoard(other).to_string(), "the image is for another board, NUCLEO-F767ZI");
    let older = Refused::Older(other.version()).to_string();
    assert_eq!(older, "the image has version 1.0.0, which is older than what runs");
}

/// As firmware has it: the name of its board, the version of its package.
#[test]
fn the_macro_makes_the_block_of_this_package() {
    assert_eq!(
        (THIS.board(), THIS.version().to_string()),
        ("NUCLEO-H743ZI", env!("CARGO_PKG_VERSION").to_owned())
    );
    assert_eq!(Info::of_firmware(&firmware(THIS, 2000)), Some(THIS));
    assert_eq!(Info::of_firmware(&[0; 1024]), None);
}
