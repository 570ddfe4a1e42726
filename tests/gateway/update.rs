//! New firmware at the console, over lines that lose and corrupt blocks.

use std::convert::Infallible;

use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::console::{Ended, Mode, run};
use mobgate::hal::{FirmwareState, NoUpdate, SharedUpdate, TcpHost, Update, UpdateError, Version};
use mobgate::settings::{PortId, TcpListen};
use mobgate_simulator::Network;
use mobgate_simulator::console::NoStore;
use mobgate_simulator::firmware::Firmware;
use mobgate_simulator::net::ClientStream;
use mobgate_simulator::random::each_seed;
use mobgate_simulator::ymodem::{NotSent, Sender, Weather};

use crate::board::{Board, image};
use crate::prelude::*;

/// An engineer who may log in over a network.
const USER: &str = "user anna role engineer password \
    \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"";

/// Lets `scenario` sit at a console of a gateway.
fn at_console(
    seed: u64,
    (path, mode): (Path, Mode),
    (update, board): (&mut impl Update, &Board),
    scenario: impl AsyncFnOnce(Sender<ClientStream>),
) -> Option<Ended> {
    let mut ended = None;
    rig::with_gateway(seed, USER, |world, rig| {
        let network = Network::new(seed);
        let mut host = network.host();
        let listen = TcpListen { address: None, port: 23 };
        host.listen(&listen).unwrap();
        let stream = network.connect_over(path, machine(1), 23).unwrap();
        let scenario = scenario(Sender::new(stream, Weather::default(), seed));
        let console = async {
            let (mut stream, _) = host.accept(&listen).await.unwrap();
            ended = run(rig.gateway, &mut stream, &mut NoStore, update, board, mode).await.ok();
            // Who sits there sees the end.
        };
        world.run_until(embassy_futures::join::join(console, scenario));
    });
    ended
}

const TERMINAL: (Path, Mode) = (USB, Mode::Echo);

/// As by USB: packets of 64 bytes, a millisecond each.
const USB: Path = Path {
    latency: Duration::from_millis(1),
    piece_bytes_max: Some(64),
    piece_spacing: Duration::from_micros(50),
    coalesce: Duration::from_ticks(0),
    window_bytes: 65_536,
};

/// Types `update`, and gives what is shown before the gateway asks.
async fn begin(sender: &mut Sender<ClientStream>) -> String {
    sender.type_in("update\r").await;
    sender.read_for(150 * MS).await
}

#[test]
fn a_file_is_taken_its_version_is_shown_and_the_gateway_starts_again() {
    for (long, with_length) in [(true, true), (false, true), (true, false)] {
        let (firmware, board) = (Firmware::default(), Board::default());
        firmware.set_pace(Duration::from_millis(30));
        let file = image(5000);
        at_console(1, TERMINAL, (&mut firmware.clone(), &board), async |mut sender| {
            let begun = begin(&mut sender).await;
            assert!(
                begun.ends_with("update\r\n"),
                "nothing that a sender may take for a response: {begun:?}"
            );
            assert_eq!(sender.send(&file, long, with_length).await, Ok(()));
            let shown = sender.read_for(3 * SECOND).await;
            assert!(
                shown.contains("9.8.7 is complete and genuine; it starts now, on trial\r\n"),
                "{shown:?}"
            );
            assert_eq!(board.restarts.get(), 1);
        });
        let [taken] = &firmware.taken()[..] else { panic!("one file") };
        assert_eq!(taken[..5000], file);
        // Without a length the last block's padding is left to who knows the image.
        assert_eq!(taken.len(), if with_length { 5000 } else { 5120 });
        assert_eq!(firmware.announced(), (with_length.then_some(5000), false));
    }
}

#[test]
fn lost_cut_and_corrupt_blocks_and_responses_make_it_slower_and_nothing_else() {
    each_seed(30, |seed| {
        let mut random = Random::new(seed);
        let (firmware, board) = (Firmware::default(), Board::default());
        let file = image(random.index(20_000));
        let long = random.chance(0.7);
        let weather = Weather { corrupt: 0.1, lost: 0.05, cut: 0.05, deaf: 0.05 };
        at_console(seed, TERMINAL, (&mut firmware.clone(), &board), async |mut sender| {
            begin(&mut sender).await;
            sender.weather = weather;
            assert_eq!(sender.send(&file, long, true).await, Ok(()), "seed {seed}");
            assert!(sender.read_for(3 * SECOND).await.contains("9.8.7"), "seed {seed}");
        });
        assert_eq!(firmware.taken(), [file], "seed {seed}");
        assert_eq!(board.restarts.get(), 1);
    });
}

#[test]
fn what_is_refused_ends_at_the_sender_too_and_the_console_goes_on() {
    let reasons = [
        (0, UpdateError::NotAnImage, "this is no image of mobgate"),
        (1500, UpdateError::OtherBoard, "the image is for another board"),
        (1500, UpdateError::Older, "the image is older than what runs"),
        (usize::MAX, UpdateError::Signature, "the image's signature is wrong"),
        (usize::MAX, UpdateError::Truncated, "the image is incomplete"),
    ];
    for (bytes, why, text) in reasons {
        let (firmware, board) = (Firmware::default(), Board::default());
        firmware.refuse(bytes, why);
        at_console(1, TERMINAL, (&mut firmware.clone(), &board), async |mut sender| {
            begin(&mut sender).await;
            assert_eq!(sender.send(&image(5000), true, true).await, Err(NotSent::Cancelled), "{why:?}");
            let shown = sender.read_for(3 * SECOND).await;
            assert!(shown.contains(&format!("error: {text}\r\n")), "{shown:?}");
            assert!(shown.rsplit("error").next().unwrap().contains("mobgate> "), "{shown:?}");
            sender.type_in("show version\r").await;
            assert!(sender.read_for(SECOND).await.contains("on board, up"));
        });
        assert_eq!((firmware.taken().len(), firmware.unfinished(), board.restarts.get()), (0, None, 0));
    }
}

#[test]
fn who_sends_nothing_or_cancels_or_breaks_off_gets_the_console_back() {
    for (case, within, text) in [
        (0, 2, "error: cancelled"),
        (1, 125, "error: no file came"),
        (2, 65, "error: the transfer broke off"),
        (3, 3, "error: cancelled"),
    ] {
        let (firmware, board) = (Firmware::default(), Board::default());
        at_console(1, TERMINAL, (&mut firmware.clone(), &board), async |mut sender| {
            begin(&mut sender).await;
            let begun = Instant::now();
            match case {
                0 => {
                    Timer::after_millis(400).await;
                    sender.type_in("\x03").await;
                }
                1 => {}
                2 => sender.send_half(&image(8000)).await,
                _ => {
                    sender.send_half(&image(8000)).await;
                    sender.type_in("\x18\x18\x18\x18\x18\x08\x08\x08\x08\x08").await;
                }
            }
            let shown = sender.read_for(9 * SECOND).await;
            assert!(shown.contains(text), "{case}: {shown:?}");
            assert!(begun.elapsed() < Duration::from_secs(within + 10), "{case}");
            sender.type_in("show version\r").await;
            assert!(sender.read_for(SECOND).await.contains("on board, up"));
        });
        assert_eq!(
            (firmware.taken().len(), firmware.unfinished(), board.restarts.get()),
            (0, None, 0),
            "{case}"
        );
    }
}

#[test]
fn older_firmware_is_allowed_by_a_word_and_at_the_gateway_only() {
    for (mode, allowed) in [(Mode::Echo, true), (Mode::Network(machine(1), None), false)] {
        let (firmware, board) = (Firmware::default(), Board::default());
        at_console(1, (USB, mode), (&mut firmware.clone(), &board), async |mut sender| {
            sender.type_in(if allowed { "update older\r" } else { "anna\nlet me in\nupdate older\n" }).await;
            if allowed {
                sender.read_for(150 * MS).await;
                assert_eq!(sender.send(&image(500), true, true).await, Ok(()));
            } else {
                let shown = sender.read_for(SECOND).await;
                assert!(shown.contains("at the gateway's own terminal only"), "{shown:?}");
            }
        });
        assert_eq!(firmware.announced(), (allowed.then_some(500), allowed));
    }
}

#[test]
fn a_board_without_updates_says_what_to_do_instead() {
    let board = Board::default();
    at_console(1, TERMINAL, (&mut NoUpdate("buy another"), &board), async |mut sender| {
        sender.type_in("update\rshow update\r").await;
        let shown = sender.read_for(SECOND).await;
        assert!(shown.contains("error: no updates here: buy another\r\n"), "{shown:?}");
        assert!(shown.contains("does not update itself: see update"), "{shown:?}");
    });
}

#[test]
fn one_update_at_a_time_and_a_console_that_is_cut_lets_others_begin() {
    let firmware = Firmware::default();
    let shared = Mutex::<NoopRawMutex, _>::new(firmware.clone());
    let board = Board::default();
    let mut ours = SharedUpdate::new(&shared);
    at_console(1, TERMINAL, (&mut ours, &board), async |mut sender| {
        begin(&mut sender).await;
        sender.send_half(&image(8000)).await;
        let mut other = SharedUpdate::new(&shared);
        assert_eq!(other.begin(None, false).await, Err(UpdateError::Busy));
        let cut = async { drop(sender) };
        select(cut, Timer::after_secs(1)).await;
    });
    assert_eq!(firmware.unfinished(), None);
    let mut other = ours.another();
    World::new(1).run_until(async {
        assert_eq!(other.begin(None, false).await, Ok(()));
    });
}

/// Pipes in `input` as a user by SSH, up to its end; gives what is shown, and how the session ended.
fn pipe(firmware: &Firmware, board: &Board, input: &[u8]) -> (String, Option<Ended>) {
    let mode = Mode::User { name: "anna", peer: machine(1), port: PortId(0), edits: false };
    let (mut shown, mut ended) = (Vec::new(), None);
    rig::with_gateway(1, USER, |world, rig| {
        let mut piped = Piped { input, shown: &mut shown };
        world.run_until(async {
            ended = run(rig.gateway, &mut piped, &mut NoStore, &mut firmware.clone(), board, mode).await.ok();
        });
    });
    (String::from_utf8(shown).unwrap(), ended)
}

/// What is piped in, in pieces of up to 100 bytes, and what is shown.
struct Piped<'p> {
    input: &'p [u8],
    shown: &'p mut Vec<u8>,
}

impl ErrorType for Piped<'_> {
    type Error = Infallible;
}

impl Read for Piped<'_> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        let (now, rest) = self.input.split_at(into.len().min(self.input.len()).min(100));
        into[..now.len()].copy_from_slice(now);
        self.input = rest;
        Ok(now.len())
    }
}

impl Write for Piped<'_> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        self.shown.extend_from_slice(from);
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[test]
fn a_file_behind_the_line_is_taken_when_it_is_piped_in_by_ssh() {
    let (firmware, board, file) = (Firmware::default(), Board::default(), image(5000));
    let input = [b"show version\nupdate\n", &file[..]].concat();
    let (shown, ended) = pipe(&firmware, &board, &input);
    assert!(shown.ends_with("9.8.7 is complete and genuine; it starts now, on trial\n"), "{shown:?}");
    assert_eq!((firmware.taken(), board.restarts.get()), (vec![file], 1));
    assert_eq!(ended, Some(Ended::Left { refused: false }));
}

#[test]
fn a_piped_file_that_is_refused_is_no_lines() {
    let (firmware, board) = (Firmware::default(), Board::default());
    firmware.refuse(1000, UpdateError::OtherBoard);
    let input = [b"update\n", &b"show version\n".repeat(1000)[..]].concat();
    let (shown, ended) = pipe(&firmware, &board, &input);
    assert_eq!(shown, "error: line 1, the image is for another board\n");
    assert_eq!((firmware.unfinished(), board.restarts.get()), (None, 0));
    assert_eq!(ended, Some(Ended::Left { refused: true }));
}

#[test]
fn show_says_how_the_firmware_came_to_run() {
    let version = || Version::try_from("0.9.0").unwrap();
    for (state, text) in [
        (FirmwareState::Confirmed, "confirmed"),
        (FirmwareState::OnTrial, "on trial"),
        (
            FirmwareState::WentBack { from: Some(version()), why: "no network" },
            "went back from 0.9.0: no network",
        ),
        (FirmwareState::Next(version()), "confirmed, 0.9.0 starts with the next restart"),
    ] {
        let board = Board { firmware: Some(state), ..Board::default() };
        at_console(1, TERMINAL, (&mut Firmware::default(), &board), async |mut sender| {
            sender.type_in("show version\rshow update\r").await;
            let shown = sender.read_for(SECOND).await;
            assert!(shown.contains(&format!(", {text}")), "{shown:?}");
            assert!(shown.contains(&format!(": {text}\r\n")), "{shown:?}");
        });
    }
}
