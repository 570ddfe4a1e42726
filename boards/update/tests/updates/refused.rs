//! Files that are refused, with the reason; what runs stays.

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use mobgate::hal::{FirmwareState, Update, UpdateError};
use mobgate_image::{HEADER_BYTES, INFO_OFFSET, Info};
use mobgate_update::{Trust, Updater};

use crate::board::{BOARD, Board, file, firmware};
use crate::flash::PAGE;

const BYTES: usize = 1600;

fn board() -> Board<false> {
    Board::new(firmware(BOARD, "1.2.0", BYTES, 1))
}

/// The file is refused for this reason, and a restart changes nothing.
#[track_caller]
fn refuses(file: &[u8], reason: UpdateError) {
    let mut board = board();
    let before = board.running.clone();
    assert_eq!(board.update(file), Err(reason));
    assert!(board.restart().is_some());
    assert_eq!(board.running, before);
    assert_eq!(board.state(), FirmwareState::Confirmed);
}

#[test]
fn a_file_in_which_a_bit_is_wrong() {
    let good = file(&firmware(BOARD, "1.3.0", BYTES, 2));
    // In each byte of the header, and in every ninth of the firmware.
    for at in (0..HEADER_BYTES).chain((HEADER_BYTES..good.len()).step_by(9)) {
        let mut wrong = good.clone();
        wrong[at] ^= 1 << (at % 8);
        let mut board = board();
        let before = board.running.clone();
        let reason = board.update(&wrong).unwrap_err();
        // Where it says what it is, other reasons come first.
        let says =
            (..12).contains(&at) || (INFO_OFFSET..INFO_OFFSET + 32).contains(&(at - HEADER_BYTES.min(at)));
        assert!(says || reason == UpdateError::Signature, "byte {at}: {reason}");
        board.restart().unwrap();
        assert_eq!(board.running, before, "byte {at}");
    }
    // And without the wrong bit.
    assert_eq!(board().update(&good).unwrap().as_str(), "1.3.0");
}

#[test]
fn a_file_that_nobody_or_somebody_else_has_signed() {
    let mut unsigned = file(&firmware(BOARD, "1.3.0", BYTES, 2));
    unsigned[12..HEADER_BYTES].fill(0);
    refuses(&unsigned, UpdateError::Signature);
    let of_another = file(&firmware(BOARD, "1.3.0", BYTES, 3));
    unsigned[12..HEADER_BYTES].copy_from_slice(&of_another[12..HEADER_BYTES]);
    refuses(&unsigned, UpdateError::Signature);
}

#[test]
fn an_older_version_unless_it_is_allowed() {
    let older = file(&firmware(BOARD, "1.1.9", BYTES, 2));
    refuses(&older, UpdateError::Older);
    let mut board = board();
    let taken = board.program(async |updater| {
        updater.begin(Some(older.len() as u32), true).await?;
        updater.write(&older).await?;
        updater.finish().await
    });
    assert_eq!(taken.unwrap().as_str(), "1.1.9");
}

#[test]
fn another_boards_image_and_what_is_no_image() {
    refuses(&file(&firmware("NUCLEO-OTHER", "1.3.0", BYTES, 2)), UpdateError::OtherBoard);
    refuses(&[0x7f; 4000], UpdateError::NotAnImage);
    refuses(&[], UpdateError::NotAnImage);
}

#[test]
fn a_file_that_is_cut_short_anywhere() {
    let whole = file(&firmware(BOARD, "1.3.0", BYTES, 2));
    for length in [HEADER_BYTES, HEADER_BYTES + 1, 1132, 1200, whole.len() - 1] {
        refuses(&whole[..length], UpdateError::Truncated);
    }
}

#[test]
fn an_image_that_does_not_fit() {
    refuses(&file(&firmware(BOARD, "1.3.0", 8193, 2)), UpdateError::TooLong);
    let begun = board().program(async |updater| updater.begin(Some(100_000), false).await);
    assert_eq!(begun, Err(UpdateError::TooLong));
}

#[test]
fn any_file_while_the_image_that_runs_is_on_trial() {
    let mut board = board();
    board.update(&file(&firmware(BOARD, "1.3.0", BYTES, 2))).unwrap();
    board.restart().unwrap();
    assert_eq!(board.state(), FirmwareState::OnTrial);
    let next = file(&firmware(BOARD, "1.4.0", BYTES, 3));
    assert_eq!(board.update(&next), Err(UpdateError::OnTrial));
    board.confirm().unwrap();
    assert_eq!(board.update(&next).unwrap().as_str(), "1.4.0");
}

#[test]
fn what_waits_is_forgotten_when_another_file_begins() {
    let mut board = board();
    let before = board.running.clone();
    let good = file(&firmware(BOARD, "1.3.0", BYTES, 2));
    let broken = board.program(async |updater| {
        updater.begin(None, false).await?;
        updater.write(&good).await?;
        updater.finish().await?;
        updater.begin(None, false).await?;
        updater.write(&good[..1500]).await
    });
    assert_eq!(broken, Ok(()));
    board.restart().unwrap();
    assert_eq!(board.running, before);
}

#[test]
fn any_file_if_the_firmware_was_built_without_a_key() {
    let board = board();
    let trust = Trust { running: Info::of_firmware(&board.running).unwrap(), key: None };
    let flash = Mutex::<NoopRawMutex, _>::new(board.flash);
    let mut updater = Updater::<_, _, PAGE, PAGE>::new(&flash, Board::<false>::layout(), trust);
    let refused = block_on(updater.begin(None, false)).unwrap_err();
    assert!(refused.to_string().contains("built without a key"), "{refused}");
}
