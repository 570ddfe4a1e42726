//! What holds for all settings and all lines: printing recreates, and nothing panics.

pub(crate) mod any;
mod any_port;

use std::format;
use std::string::String;
use std::vec::Vec;

use proptest::prelude::*;

use self::any::any_settings;
use super::{PORTS, load, print, std};
use crate::language::*;

proptest! {
    #[test]
    fn what_is_printed_recreates_the_settings(settings in any_settings()) {
        prop_assert_eq!(&load(&print(&settings)), &*settings);
    }

    #[test]
    fn random_text_is_refused_without_a_panic_and_without_a_change(line in "\\PC{0,80}") {
        let mut settings = load(PORTS);
        let before = settings.clone();
        if !apply(&mut settings, &line).is_ok_and(|applied| applied.changed) {
            prop_assert_eq!(settings, before);
        }
    }

    #[test]
    fn random_words_of_the_language_never_panic_and_keep_the_settings_printable(
        lines in prop::collection::vec(random_line(), 1..20)
    ) {
        let mut settings = load(PORTS);
        for line in lines {
            let before = settings.clone();
            if apply(&mut settings, &line).is_err() {
                prop_assert_eq!(&settings, &before);
            }
        }
        // Places of deleted ports are not kept, so the text is compared and not the value.
        let text = print(&settings);
        prop_assert_eq!(print(&load(&text)), text);
    }
}

fn random_line() -> impl Strategy<Value = String> {
    const VERBS: &[&str] =
        &["port", "route", "edit port", "edit route 1", "insert route 1", "move route", "delete port"];
    const WORDS: &str = "P1 P2 P3 P502 502 serial tcp uart1 rtu ascii client server 9600 8E1 7E1 timeout \
        300ms gap 0 1 2 reserve for 10.0.0.0/8, ::1 * -1 =7 1-64 local readonly functions \
        3,4 priority high , # listen allow first 0x5A";
    let route = (0..3_usize, 0..9_u8, 0..3_usize).prop_map(|(from, unit, to)| {
        format!("route {} {unit} * * {}", ["P502", "P2", "P5"][from], ["P1", "P4", "local"][to])
    });
    let words: Vec<&str> = WORDS.split(' ').collect();
    let any = (prop::sample::select(VERBS), prop::collection::vec(prop::sample::select(words), 0..9))
        .prop_map(|(verb, words)| format!("{verb} {}", words.join(" ")));
    let verbs: Vec<&'static str> = Vec::from(["delete route 1", "move route 1 2", "edit port P1 retries 3"]);
    prop_oneof![route, any, prop::sample::select(verbs).prop_map(String::from)]
}
