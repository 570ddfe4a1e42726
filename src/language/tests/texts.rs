//! Whole texts, in pieces and with faults; lines as long as they can be.

use super::*;

#[test]
fn a_long_line_is_refused_as_a_whole() {
    let line = "route ".to_string() + &"1 ".repeat(5_000);
    assert!(error(&line).contains(&format!("the line is longer than {LINE_BYTES_MAX} bytes")));
    let mut settings = Settings::new();
    let mut buffer = LineBuffer::default();
    let mut loader = Loader::new(&mut settings, &mut buffer);
    loader.feed(b"# short\n").unwrap();
    loader.feed(line.as_bytes()).unwrap();
    let error = loader.finish().unwrap_err();
    assert_eq!((error.line, error.error.problem), (2, Problem::LineTooLong));
}

#[test]
fn a_configuration_text_is_read_in_pieces_of_any_size_with_either_line_end() {
    let expected = load(PORTS);
    let text = PORTS.replace('\n', "\r\n");
    for size in [1, 7, 64, 1_000] {
        let mut settings = load("port X tcp server 1");
        let mut line = LineBuffer::default();
        let mut loader = Loader::new(&mut settings, &mut line);
        for piece in text.trim_end().as_bytes().chunks(size) {
            loader.feed(piece).unwrap();
        }
        loader.finish().unwrap();
        assert_eq!(settings, expected);
    }
}

#[test]
fn a_byte_order_mark_is_skipped_at_the_start_and_nowhere_else() {
    let text = "\u{feff}".to_owned() + PORTS;
    for size in [1, 2, 64] {
        let mut settings = Settings::new();
        let mut line = LineBuffer::default();
        let mut loader = Loader::new(&mut settings, &mut line);
        text.as_bytes().chunks(size).for_each(|piece| loader.feed(piece).unwrap());
        loader.finish().unwrap();
        assert_eq!(settings, load(PORTS));
    }
    let mut settings = Settings::new();
    let error = Loader::new(&mut settings, &mut LineBuffer::default())
        .feed("\u{feff}prot P1\n".as_bytes())
        .unwrap_err();
    assert_eq!((error.line, error.error.column, error.error.word.as_str()), (1, 1, "prot"));
    let error = Loader::new(&mut settings, &mut LineBuffer::default())
        .feed("\n\u{feff}port P1\n".as_bytes())
        .unwrap_err();
    assert_eq!((error.line, error.error.column), (2, 1));
}

#[test]
fn a_configuration_error_names_its_line_and_word() {
    let text =
        "# a comment\n\nport P1 serial uart1 rtu client\n\n\n\nport P2 serial uart2 rtu client 9600 81E\n";
    let mut settings = Settings::new();
    let error = Loader::new(&mut settings, &mut LineBuffer::default()).feed(text.as_bytes()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 7, column 38: \"81E\": expected a format such as 8E1, 7E1, 8N1 or 8N2"
    );
    let error = Loader::new(&mut settings, &mut LineBuffer::default())
        .feed(b"# fine \xc3\xa9\nport \xff\n")
        .unwrap_err();
    assert_eq!((error.line, error.error.column, error.error.problem), (2, 6, Problem::NotText));
}

#[test]
fn the_longest_lines_that_print_can_be_read() {
    let prefix = "1111:1111:1111:1111:1111:1111:1111:1110/127";
    let time = "3599999.999ms";
    let name = |last| "a".repeat(NAME_BYTES_MAX - 1) + last;
    let (one, two) = (name("1"), name("2"));
    let device = "d".repeat(DEVICE_BYTES_MAX);
    let functions: Vec<String> = (1..128).step_by(2).map(|code: u8| code.to_string()).collect();
    let lines = [
        format!("port {one} serial {device} ascii client 10000000 7E1"),
        format!("edit port {one} rs485 driver-before 999.999ms driver-after 999.999ms echo"),
        format!("edit port {one} char-timeout 59999.999ms gap 999.999ms timeout {time} retries 10"),
        format!(
            "edit port {one} turnaround 59999.999ms start-delay {time} late-window {time} down-after 255"
        ),
        format!("port {two} tcp server [1111:1111:1111:1111:1111:1111:1111:1111]:65535 clients 1000"),
        format!("edit port {two} idle 86399999.999ms pipeline 15 lifetime {time}"),
        format!("edit port {two} reserve 1000 for {prefix},{prefix},{prefix},{prefix}"),
        format!("edit port {two} allow {prefix},{prefix},{prefix},{prefix}"),
        format!("edit port {two} broadcast replace 247 confirm-broadcast unit-255 replace 247"),
        format!("edit port {two} reserved-units replace 247"),
        format!(
            "route {two} 101-132 {prefix} -100 {one} functions {} addresses 10000-65535 writes 10000-65535 \
             priority low urgent {} merge near 255 cache 59.999s",
            functions.join(","),
            functions.join(",")
        ),
    ];
    let mut settings = Settings::new();
    for line in &lines {
        apply(&mut settings, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
    let text = print(&settings);
    let longest = text.lines().map(str::len).max().unwrap();
    assert!((300..=LINE_BYTES_MAX).contains(&longest), "{longest}: {text}");
    assert_eq!(load(&text), settings);
}
