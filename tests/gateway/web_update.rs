//! New firmware by the web interface: it is written while it comes, and what is wrong with it is told.

use embassy_futures::select::select3;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_io_async::Write;
use mobgate::hal::{FirmwareState, SharedUpdate, UpdateError};
use mobgate::web;
use mobgate_simulator::console::Medium;
use mobgate_simulator::firmware::Firmware;

use crate::board::{Board, image};
use crate::prelude::*;
use crate::web_user::{User, received};

/// The password of both.
const PASSWORD: &str = "let me in";
const SETTINGS: &str = "port web http server 80 cleartext
user anna role engineer password \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"
user otto role operator password \"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"
";
const HOST: &str = "10.0.0.1";
const OCTETS: &str = "Content-Type: application/octet-stream\r\n";

impl User {
    async fn upload(&self, image: &[u8]) -> (u16, String) {
        self.call("POST /api/v1/update", OCTETS, image).await
    }
}

/// Lets `scenario` call a gateway with two connections for the interface.
fn at_interface(firmware: &Firmware, board: &Board, scenario: impl AsyncFnOnce(User)) {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let shared = Mutex::<NoopRawMutex, _>::new(firmware.clone());
        let connection = async |nth| {
            let (mut host, mut store) = (rig.network.host(), Medium::default());
            let mut update = SharedUpdate::new(&shared);
            web::run(rig.gateway, nth, &mut host, (&mut store, &mut update), board).await;
        };
        let scenario = async {
            Timer::after_millis(10).await;
            scenario(User::new(&rig.network, HOST).log_in("anna", PASSWORD).await).await;
        };
        world.run_until(select3(connection(0), connection(1), scenario));
    });
}

#[test]
fn an_image_is_written_while_it_comes_and_the_gateway_starts_again() {
    let (firmware, board, file) = (Firmware::default(), Board::default(), image(200_000));
    // It takes longer than any other request may.
    firmware.set_pace(20 * MS);
    at_interface(&firmware, &board, async |user| {
        let mut stream = user.begin("POST /api/v1/update", OCTETS, file.len()).await;
        let (half, rest) = file.split_at(file.len() / 2);
        stream.write_all(half).await.unwrap();
        Timer::after_secs(30).await;
        assert_eq!(firmware.unfinished(), Some(half.len()));
        stream.write_all(rest).await.unwrap();
        assert_eq!(received(&mut stream).await, (200, r#"{"version":"9.8.7"}"#.to_owned()));
        Timer::after_secs(1).await;
    });
    assert_eq!((firmware.taken(), board.restarts.get()), (vec![file], 1));
    assert_eq!(firmware.announced(), (Some(200_000), false), "an older one is not allowed");
}

#[test]
fn a_wrong_image_is_refused_with_the_reason_and_the_interface_goes_on() {
    for (bytes, why, status, text) in [
        (0, UpdateError::NotAnImage, 422, "this is no image of mobgate"),
        (1_500, UpdateError::OtherBoard, 422, "the image is for another board"),
        (1_500, UpdateError::Older, 422, "the image is older than what runs"),
        (1_500, UpdateError::TooLong, 413, "the image is too long for this board"),
        (1_500, UpdateError::Failed, 409, "writing the image failed"),
        (usize::MAX, UpdateError::Signature, 422, "the image's signature is wrong"),
        (usize::MAX, UpdateError::Truncated, 422, "the image is incomplete"),
    ] {
        let (firmware, board) = (Firmware::default(), Board::default());
        firmware.refuse(bytes, why);
        at_interface(&firmware, &board, async |user| {
            let refused = format!(r#"{{"error":{{"message":"{text}"}}}}"#);
            // Much follows, which is not written.
            assert_eq!(user.upload(&image(300_000)).await, (status, refused));
            assert_eq!(user.call("GET /api/v1/update", "", b"").await.0, 200);
        });
        assert_eq!((firmware.taken().len(), firmware.unfinished(), board.restarts.get()), (0, None, 0));
    }
}

#[test]
fn what_is_too_large_or_of_somebody_else_is_not_even_begun() {
    let (firmware, board) = (Firmware::default(), Board::default());
    at_interface(&firmware, &board, async |user| {
        let mut stream = user.begin("POST /api/v1/update", OCTETS, 5_000_000).await;
        assert_eq!(received(&mut stream).await.0, 413);
        let nobody = user.nobody();
        assert_eq!(nobody.upload(&image(1_000)).await.0, 401);
        let otto = user.log_in("otto", PASSWORD).await;
        let (status, why) = otto.upload(&image(1_000)).await;
        assert!(status == 403 && why.contains("needs the role engineer"), "{why}");
        for (headers, status) in
            [("Origin: http://evil.example\r\n", 403), ("Content-Type: text/plain\r\n", 415)]
        {
            assert_eq!(user.call("POST /api/v1/update", headers, &image(1_000)).await.0, status);
        }
    });
    assert_eq!((firmware.announced(), firmware.unfinished()), ((None, false), None));
}

#[test]
fn an_upload_that_stops_short_is_discarded_and_lets_others_begin() {
    for cut in [true, false] {
        let (firmware, board, file) = (Firmware::default(), Board::default(), image(20_000));
        at_interface(&firmware, &board, async |user| {
            let mut stream = user.begin("POST /api/v1/update", OCTETS, file.len()).await;
            stream.write_all(&file[..10_000]).await.unwrap();
            Timer::after_secs(10).await;
            assert_eq!(firmware.unfinished(), Some(10_000));
            let (status, why) = user.upload(&file).await;
            assert!(status == 409 && why.contains("another update is in progress"), "{why}");
            if cut {
                drop(stream);
            } else {
                assert_eq!(received(&mut stream).await.0, 0, "silence ends it");
            }
            Timer::after_secs(1).await;
            assert_eq!(firmware.unfinished(), None);
            assert_eq!(user.upload(&file).await.0, 200);
        });
        assert_eq!(firmware.taken(), [file], "{cut}");
    }
}

#[test]
fn what_is_on_trial_is_taken_back_by_a_restart_and_nothing_else_is() {
    for (state, status, restarts) in
        [(Some(FirmwareState::OnTrial), 204, 1), (Some(FirmwareState::Confirmed), 409, 0), (None, 409, 0)]
    {
        let (firmware, board) = (Firmware::default(), Board { firmware: state, ..Board::default() });
        at_interface(&firmware, &board, async |user| {
            let otto = user.log_in("otto", PASSWORD).await;
            assert_eq!(otto.call("DELETE /api/v1/update", "", b"").await.0, 403);
            assert_eq!(user.call("DELETE /api/v1/update", "", b"").await.0, status);
            Timer::after_secs(1).await;
        });
        assert_eq!(board.restarts.get(), restarts);
    }
}
