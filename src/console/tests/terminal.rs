//! A person at a terminal.

use super::*;

#[test]
fn a_person_types_edits_completes_and_leaves() {
    with_gateway(|gateway| {
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
    });
}

#[test]
fn tab_lists_the_words_that_a_word_could_become() {
    with_gateway(|gateway| {
        let printed = typed(gateway, "s\t\x15help move\r");
        assert!(printed.contains("\r\nserver  slave  show  scan  save\r\n\rmobgate> s"), "{printed:?}");
        assert!(printed.contains("move route N M"), "{printed:?}");
    });
}

#[test]
fn an_error_at_the_terminal_has_no_line_number() {
    with_gateway(|gateway| {
        let printed = typed(gateway, "reboot now\r");
        let expected = "\r\nerror: column 8: \"now\": expected the end of the line\r\n\rmobgate> ";
        assert!(printed.contains(expected), "{printed:?}");
    });
}
