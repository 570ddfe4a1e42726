//! How sessions end, and whose bytes never become one.

use super::*;
use crate::settings::LINE_BYTES_MAX;

const NETWORK: Mode = Mode::Network(core::net::IpAddr::V4(core::net::Ipv4Addr::LOCALHOST));

/// What a session of `mode` prints, how it ends, and the settings behind it.
fn ended(mode: Mode, typed: &[u8], piece: usize) -> (String, Ended, String) {
    let mut came = None;
    with_gateway(|gateway| {
        pipe(gateway, SETTINGS);
        users::add_users(gateway);
        let mut stream = Stream { typed, piece, printed: Vec::new() };
        let ended =
            block_on(run(gateway, &mut stream, &mut Memory::default(), &mut none(), &Bench::default(), mode))
                .unwrap();
        came = Some((String::from_utf8(stream.printed).unwrap(), ended, pipe(gateway, "show config")));
    });
    came.unwrap()
}

#[test]
fn the_body_of_a_web_page_s_request_is_not_carried_out() {
    let body = "delete routes\nport evil tcp server 6666\nsave\n";
    for head in ["POST / HTTP/1.1\r\nHost: 127.0.0.1:5026\r\n\r\n", "delete /routes HTTP/1.1\r\n\r\n"] {
        let (printed, end, config) = ended(NETWORK, (head.to_string() + body).as_bytes(), 64);
        assert_eq!((printed.as_str(), end), ("user: ", Ended::Foreign(Foreign::Http)));
        assert_eq!(config, SETTINGS_SHOWN);
    }
    let long = format!("route {} HTTP/1.1\r\n\r\n{body}", "x".repeat(LINE_BYTES_MAX));
    let (printed, end, config) = ended(NETWORK, long.as_bytes(), 64);
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
            let (printed, end, config) = ended(NETWORK, bytes, piece);
            assert_eq!((printed.as_str(), end), ("user: ", Ended::Foreign(foreign)));
            assert_eq!(config, SETTINGS_SHOWN);
        }
    }
}

#[test]
fn noise_on_a_serial_console_does_not_end_it() {
    let noise = b"\xff\x16\x03\0POST / HTTP/1.1\r\nshow version\r\n";
    for mode in [Mode::Echo, Mode::Plain] {
        let (printed, end, _) = ended(mode, noise, 3);
        assert!(printed.contains("mobgate 0."), "{printed:?}");
        assert_eq!(end, Ended::Left { refused: true });
    }
}

#[test]
fn a_session_of_the_network_takes_lines_and_says_whether_one_was_refused() {
    let (printed, end, _) = ended(NETWORK, b"viewer\r\nlet me in\r\n\r\nshow version\r\n", 5);
    assert!(printed.starts_with("user: password: mobgate 0."), "{printed:?}");
    assert_eq!(end, Ended::Left { refused: false });
    let (printed, end, _) = ended(NETWORK, b"viewer\nlet me in\nshwo\nshow version\nexit\nshwo", 5);
    assert!(printed.contains(" error: line 1, ") && printed.contains("\nmobgate 0."), "{printed:?}");
    assert_eq!(end, Ended::Left { refused: true });
}

#[test]
fn ctrl_c_ends_what_runs_then_the_line_and_twice_on_an_empty_one_the_program() {
    // Each key comes by itself, as a person types.
    let (printed, end, _) =
        ended(Mode::Foreground, b"show vers\x03show version\r\x03x\x7f\x03\x03show log\r", 1);
    assert_eq!(end, Ended::Stopped);
    assert_eq!(printed.matches("press Ctrl-C again to stop the gateway").count(), 2, "{printed:?}");
    assert!(printed.contains("mobgate 0.") && !printed.contains("AGE"), "{printed:?}");
    let (printed, end, _) = ended(Mode::Echo, b"\x03\x03\x03exit\r", 1);
    assert_eq!((printed.contains("press"), end), (false, Ended::Left { refused: false }));
}
