//! Sessions by network, and whose bytes never become one.

use super::ends::ended;
use super::users::{PEER, add_users};
use super::*;
use crate::settings::LINE_BYTES_MAX;

/// What a session by network prints, how it ends, and the settings behind it.
fn by_network(typed: &[u8], piece: usize) -> (String, Ended, String) {
    ended(Mode::Network(PEER, None), typed, piece, add_users)
}

#[test]
fn the_body_of_a_web_page_s_request_is_not_carried_out() {
    let body = "delete routes\nport evil tcp server 6666\nsave\n";
    for head in ["POST / HTTP/1.1\r\nHost: 127.0.0.1:5026\r\n\r\n", "delete /routes HTTP/1.1\r\n\r\n"] {
        let (printed, end, config) = by_network((head.to_string() + body).as_bytes(), 64);
        assert_eq!((printed.as_str(), end), ("user: ", Ended::Foreign(Foreign::Http)));
        assert_eq!(config, SETTINGS_SHOWN);
    }
    let long = format!("route {} HTTP/1.1\r\n\r\n{body}", "x".repeat(LINE_BYTES_MAX));
    let (printed, end, config) = by_network(long.as_bytes(), 64);
    assert_eq!((printed.as_str(), end), ("user: ", Ended::Foreign(Foreign::TooLong)));
    assert_eq!(config, SETTINGS_SHOWN);
}

/// What `show config` makes of the settings.
const SETTINGS_SHOWN: &str = "\
user viewer role viewer
user operator role operator
user engineer role engineer
user nobody role engineer
port P1   serial /dev/ttyUSB0 rtu client 9600 8N1 timeout 300ms
port P2   serial uart2 rtu server 19200 8E1
port P502 tcp server 502
route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high
route P502 1-64    * * P1
route P1   1-64    * * P502
";

#[test]
fn tls_and_telnet_end_a_session_of_the_network_before_any_line() {
    for (bytes, foreign) in [
        (&b"\x16\x03\x01\x00\xff\x01\x00\ndelete routes\n"[..], Foreign::Tls),
        (b"\xff\xfb\x1f\ndelete routes\n", Foreign::Telnet),
        (b"\0\x01\ndelete routes\n", Foreign::NotText),
    ] {
        for piece in [1, 64] {
            let (printed, end, config) = by_network(bytes, piece);
            assert_eq!((printed.as_str(), end), ("user: ", Ended::Foreign(foreign)));
            assert_eq!(config, SETTINGS_SHOWN);
        }
    }
}

#[test]
fn a_session_of_the_network_takes_lines_and_says_whether_one_was_refused() {
    let (printed, end, _) = by_network(b"viewer\r\nlet me in\r\n\r\nshow version\r\n", 5);
    assert!(printed.starts_with("user: password: mobgate 0."), "{printed:?}");
    assert_eq!(end, Ended::Left { refused: false });
    let (printed, end, _) = by_network(b"viewer\nlet me in\nshwo\nshow version\nexit\nshwo", 5);
    assert!(printed.contains(" error: line 1, ") && printed.contains("\nmobgate 0."), "{printed:?}");
    assert_eq!(end, Ended::Left { refused: true });
}

#[test]
fn keys_of_a_terminal_among_lines_of_text_are_ignored_by_network() {
    let gateway = &new_gateway();
    add_users(gateway);
    let lines = "viewer\nlet me in\n".to_string() + terminal::LINES_WITH_KEYS;
    let said = session(gateway, &mut Memory::default(), Mode::Network(PEER, None), &lines, 3);
    assert_eq!(said.matches("mobgate 0.").count(), 2, "{said:?}");
    assert!(!said.contains("error"), "{said:?}");
}
