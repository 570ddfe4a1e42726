//! What lines of points say where there are none. Run by `cargo test -p mobgate --lib --no-default-features --features ipv6`.

use std::format;
use std::string::ToString;

use super::{PORTS, load, print, std};
use crate::language::{LineBuffer, Loader, Problem, apply};
use crate::settings::{PortId, Settings};

const LINES: [&str; 9] = [
    "device meter unit 5",
    "point power meter holding 0",
    "slave 0 unit 7",
    "port ask scanner",
    "port bus ethercat line P1",
    "delete device meter",
    "delete point power",
    "delete slave 0",
    "delete slaves",
];

#[test]
fn lines_that_need_points_are_refused_and_change_nothing() {
    let mut settings = load(PORTS);
    let before = settings.clone();
    for line in LINES {
        let error = apply(&mut settings, line).expect_err(line);
        assert_eq!(error.problem, Problem::NoPoints, "{line}");
        assert!(error.to_string().ends_with(": this board has no data points"), "{error}");
    }
    assert_eq!(settings, before);
}

#[test]
fn saved_settings_with_points_are_refused_with_the_line_that_needs_them() {
    let mut settings = Settings::new();
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut settings, &mut line);
    let error =
        loader.feed(format!("{PORTS}port ask scanner\nport P9 tcp server 503\n").as_bytes()).unwrap_err();
    assert_eq!((error.line, &error.error.problem), (7, &Problem::NoPoints));
    assert_eq!(error.to_string(), "line 7, column 10: \"scanner\": this board has no data points");
}

#[test]
fn all_else_is_printed_and_read_as_ever() {
    let settings = load(&print(&load(PORTS)));
    assert_eq!(settings, load(PORTS));
    assert_eq!(settings.name(PortId(0)), "P1");
}
