//! How sessions end.

use super::*;

/// What a session of `mode` prints, how it ends, and the settings behind it, after `prepare`.
pub(super) fn ended(
    mode: Mode,
    typed: &[u8],
    piece: usize,
    prepare: fn(&Gateway<'_>),
) -> (String, Ended, String) {
    let gateway = &new_gateway();
    pipe(gateway, SETTINGS);
    prepare(gateway);
    let (printed, ended) =
        session_on(gateway, &Bench::default(), &mut Memory::default(), mode, (typed, piece));
    (printed, ended, pipe(gateway, "show config"))
}

#[test]
fn noise_on_a_serial_console_does_not_end_it() {
    let noise = b"\xff\x16\x03\0POST / HTTP/1.1\r\nshow version\r\n";
    for mode in [Mode::Echo, Mode::Plain] {
        let (printed, end, _) = ended(mode, noise, 3, |_| {});
        assert!(printed.contains("mobgate 0."), "{printed:?}");
        assert_eq!(end, Ended::Left { refused: true });
    }
}

#[test]
fn ctrl_c_ends_what_runs_then_the_line_and_twice_on_an_empty_one_the_program() {
    // Each key comes by itself, as a person types.
    let (printed, end, _) =
        ended(Mode::Foreground, b"show vers\x03show version\r\x03x\x7f\x03\x03show log\r", 1, |_| {});
    assert_eq!(end, Ended::Stopped);
    assert_eq!(printed.matches("press Ctrl-C again to stop the gateway").count(), 2, "{printed:?}");
    assert!(printed.contains("mobgate 0.") && !printed.contains("AGE"), "{printed:?}");
    let (printed, end, _) = ended(Mode::Echo, b"\x03\x03\x03exit\r", 1, |_| {});
    assert_eq!((printed.contains("press"), end), (false, Ended::Left { refused: false }));
}
