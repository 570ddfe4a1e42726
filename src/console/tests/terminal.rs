//! A person at a terminal.

use super::*;
use crate::console::show::TOPICS;

#[test]
fn a_person_types_edits_completes_and_leaves() {
    let gateway = &new_gateway();
    let printed = typed(
        gateway,
        "port P1 serial uart1 rtu client 960\x7f00\r\nrout\t P1 1 * * loc\t\r\nsh\tver\t\r\nexit\r\nshow log\r\n",
    );
    assert!(printed.starts_with("\r\n") || printed.starts_with("\rmobgate> "), "{printed:?}");
    assert!(printed.contains("\r\nmobgate 0."), "{printed:?}");
    assert!(!printed.contains("AGE"), "nothing runs after exit: {printed:?}");
    assert_eq!(
        pipe(gateway, "show config"),
        "port P1 serial uart1 rtu client 9600 8E1\nroute P1 1       * * local\n"
    );
}

#[test]
fn tab_lists_the_words_that_a_word_could_become() {
    let gateway = &new_gateway();
    let printed = typed(gateway, "m\t\x15help move\r");
    assert!(printed.contains("\r\nmove  mdns  mark\r\n\rmobgate> m"), "{printed:?}");
    assert!(printed.contains("move route N M"), "{printed:?}");
}

#[test]
fn an_error_at_the_terminal_has_no_line_number() {
    let gateway = &new_gateway();
    let printed = typed(gateway, "reboot now\r");
    let expected = "\r\nerror: column 8: \"now\": expected the end of the line\r\n\rmobgate> ";
    assert!(printed.contains(expected), "{printed:?}");
}

/// The lines of the screen that `keys` leave behind, without the redrawing of prompts.
fn screen(gateway: &Gateway<'_>, keys: &str) -> Vec<String> {
    let printed = typed(gateway, keys);
    let plain = |line: &str| line.rsplit('\r').next().unwrap_or_default().to_string();
    printed
        .replace("\r\n", "\n")
        .replace("\x1b[K", "")
        .lines()
        .map(plain)
        .filter(|line| !line.contains('\x1b'))
        .collect()
}

/// A gateway that has a lot to tell.
fn busy(gateway: &Gateway<'_>) {
    pipe(gateway, SETTINGS);
    pipe(gateway, "port P3 serial /dev/serial/by-id/usb-FTDI_FT232R rtu client\n");
    let state = gateway.port_state(PortId(0)).unwrap();
    let now = embassy_time::Instant::now();
    Event::ALL.iter().for_each(|event| state.stats.count(*event));
    for _ in 0..1_000 {
        state.units(|units| units.asked(247));
    }
    state.units(|units| units.timed_out(247, now, 1));
    push_exception(gateway, now);
}

#[test]
fn eighty_columns_are_enough_for_every_table_and_error() {
    let gateway = &new_gateway();
    busy(gateway);
    let tables: Vec<String> = TOPICS.iter().map(|(topic, _)| format!("show {topic}\r")).collect();
    for line in tables.iter().map(String::as_str).chain(["show prots\r"]) {
        for shown in screen(gateway, line) {
            assert!(shown.chars().count() <= 80, "{line}: {shown:?}");
        }
        // Nothing is lost by it.
        let words = |text: &str| text.split_whitespace().map(String::from).collect::<Vec<_>>();
        let all = screen(gateway, line).join(" ");
        let expected = pipe(gateway, &line.replace('\r', "\n")).replace("line 1, ", "");
        assert_eq!(words(&all), words(&expected), "{line}");
    }
}

#[test]
fn columns_are_as_wide_as_they_must_be_and_what_has_no_room_stands_below() {
    let gateway = &new_gateway();
    busy(gateway);
    assert_eq!(
        screen(gateway, "show routes\r"),
        [
            "NO SOURCE UNITS   IP             TAG  DESTINATION KIND    POLICY",
            " 1 P502   101-132 192.168.1.0/24 -100 P1          rule    readonly priority high",
            " 2 P502   1-64    *              *    P1          rule    all",
            " 3 P1     1-64    *              *    P502        implied all",
        ]
    );
    let wide = screen(gateway, "\x1b[8;24;132tshow routes\r");
    assert_eq!(wide.join("\n") + "\n", pipe(gateway, "show routes"));
}

/// Two commands, and keys among them.
pub(super) const LINES_WITH_KEYS: &str =
    "\x1b[A\x1b[Dsh\x03ow\x1bOD ver\x01sion\x7f\x1b\nshow ver\x1b[1;5Csion\n";

#[test]
fn keys_of_a_terminal_among_lines_of_text_are_ignored() {
    let gateway = &new_gateway();
    let said = session(gateway, &mut Memory::default(), Mode::Plain, LINES_WITH_KEYS, 3);
    assert_eq!(said.matches("mobgate 0.").count(), 2, "{said:?}");
    assert!(!said.contains("error"), "{said:?}");
}
