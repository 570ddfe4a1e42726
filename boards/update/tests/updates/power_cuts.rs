//! The power is cut at each operation of the flash: what starts afterwards is one of the two images, whole.

use mobgate::hal::FirmwareState;
use mobgate_update::{REASON_BYTES_MAX, Reason};

use crate::board::{BOARD, Board, file, firmware};
use crate::flash::WORD;

const BYTES: usize = 8192;

/// A board that is about to do something, and the images that may run afterwards.
struct Case<const ECC: bool> {
    board: Board<ECC>,
    images: [Vec<u8>; 2],
}

fn case<const ECC: bool>() -> Case<ECC> {
    let images = [("1.2.0", 1), ("1.3.0", 2)].map(|(version, seed)| firmware(BOARD, version, BYTES, seed));
    Case { board: Board::new(images[0].clone()), images }
}

/// Does it with a cut at each of its operations, then restarts the board as often as the power needs. Returns how often each image ran then.
fn cut<const ECC: bool>(case: &Case<ECC>, mut act: impl FnMut(&mut Board<ECC>) -> bool) -> [usize; 2] {
    let mut ran = [0, 0];
    let next = firmware(BOARD, "1.4.0", BYTES, 3);
    let next_file = file(&next);
    for operation in 0.. {
        let mut board = case.board.clone();
        board.cut_at(operation);
        let done = act(&mut board);
        board.keep_power();
        if done {
            assert!(operation > 2, "there are more operations than {operation}");
            return ran;
        }
        board.restart().expect("the power is on");
        let which = case.images.iter().position(|image| *image == board.running);
        ran[which.unwrap_or_else(|| panic!("operation {operation}: no whole image"))] += 1;
        // An update works from there, if need be after a confirmation.
        if board.state() == FirmwareState::OnTrial {
            board.confirm().unwrap();
        }
        board.update(&next_file).unwrap();
        board.restart().unwrap();
        assert!(board.running == next, "operation {operation}");
    }
    ran
}

fn check_each_operation<const ECC: bool>() {
    // Of an update: what runs stays, until its last operation.
    let mut case = case::<ECC>();
    let new = file(&case.images[1]);
    let [old, _] = cut(&case, |board| board.update(&new).is_ok());
    assert!(old > 2 * BYTES / WORD / 2, "{old}");
    // Of the swap: it goes on. With its last operation the new image is on trial, which a power cut ends.
    case.board.update(&new).unwrap();
    let [old, new] = cut(&case, |board| board.restart().is_some());
    assert!(old == 1 && new > 4 * BYTES / WORD / 2, "{old} {new}");
    // Of the confirmation: before its end the board may go back.
    case.board.restart().unwrap();
    assert_eq!(case.board.state(), FirmwareState::OnTrial);
    cut(&case, |board| {
        board.confirm().is_ok() && board.restart().is_some() && board.running == case.images[1]
    });
    // Of the way back: it goes on.
    let [old, new] = cut(&case, |board| board.restart().is_some());
    assert!(old > 4 * BYTES / WORD / 2 && new == 0, "{old} {new}");
}

#[test]
fn at_each_operation() {
    check_each_operation::<false>();
}

#[test]
fn at_each_operation_of_a_flash_with_error_correction() {
    check_each_operation::<true>();
}

#[test]
fn an_image_that_is_not_confirmed_goes_back_and_says_so() {
    let Case { mut board, images } = case::<false>();
    board.update(&file(&images[1])).unwrap();
    board.restart().unwrap();
    assert_eq!((board.state(), &board.running), (FirmwareState::OnTrial, &images[1]));
    board.restart().unwrap();
    assert_eq!(board.running, images[0]);
    let FirmwareState::WentBack { from: Some(from), why: "reset" } = board.state() else { panic!() };
    assert_eq!(from.as_str(), "1.3.0");
    // And stays.
    board.restart().unwrap();
    assert_eq!(board.running, images[0]);
}

#[test]
fn an_image_that_is_confirmed_stays() {
    let Case { mut board, images } = case::<true>();
    board.update(&file(&images[1])).unwrap();
    board.restart().unwrap();
    board.confirm().unwrap();
    for _ in 0..2 {
        board.restart().unwrap();
        assert_eq!((board.state(), &board.running), (FirmwareState::Confirmed, &images[1]));
    }
}

/// Why the image before went back, as the program learns it that was started for this reason.
fn reason<const ECC: bool>(board: &mut Board<ECC>, now: &str) -> Option<String> {
    let now = Reason::try_from(now).unwrap();
    board.program(async |updater| updater.reason(now).await).unwrap().map(|why| why.as_str().to_owned())
}

fn check_reason<const ECC: bool>() {
    let Case { mut board, images } = case::<ECC>();
    assert_eq!(reason(&mut board, "started by power"), None);
    board.update(&file(&images[1])).unwrap();
    board.restart().unwrap();
    assert_eq!(reason(&mut board, "started by reboot"), None);
    board.restart().unwrap();
    let gone_back = board.clone();
    assert_eq!(reason(&mut board, "the watchdog").as_deref(), Some("the watchdog"));
    board.restart().unwrap();
    assert_eq!(reason(&mut board, "started by power").as_deref(), Some("the watchdog"), "it is kept");
    // The next update has a story of its own.
    board.update(&file(&images[1])).unwrap();
    board.restart().unwrap();
    board.restart().unwrap();
    assert_eq!(reason(&mut board, "a fault").as_deref(), Some("a fault"));
    // A cut leaves the reason, or says that it is lost, and what runs stays.
    for operation in 0..REASON_BYTES_MAX / WORD {
        let mut board = gone_back.clone();
        board.cut_at(operation);
        let now = Reason::try_from(["the watchdog"; 13].join(", ").as_str()).unwrap();
        board.program(async |updater| updater.reason(now).await).unwrap_err();
        board.keep_power();
        board.restart().unwrap();
        assert_eq!(board.running, images[0]);
        reason(&mut board, "started by power").unwrap();
        board.update(&file(&images[1])).unwrap();
    }
}

#[test]
fn why_an_image_went_back_is_kept_until_the_next_update() {
    check_reason::<false>();
    check_reason::<true>();
}

#[test]
fn images_have_numbers_of_their_own() {
    let Case { mut board, images } = case::<false>();
    let id = |board: &mut Board<false>| board.program(async |updater| updater.id().await).unwrap();
    let before = id(&mut board);
    board.update(&file(&images[1])).unwrap();
    assert_eq!(id(&mut board), before, "what waits does not run");
    board.restart().unwrap();
    assert_ne!(id(&mut board), before);
    board.restart().unwrap();
    assert_eq!(id(&mut board), before);
}
