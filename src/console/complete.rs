//! Completion of the word before the cursor: commands, their topics, port names and option words.

use heapless::String;

use super::command::commands;
use crate::language::{Offer, WORD_BYTES_MAX, is_separator};
use crate::settings::{Settings, USERS};

/// The result of completing a word.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Completion {
    /// No word has this prefix.
    None,
    /// Append this: the rest of the only match, or the common prefix of all matches.
    Append(String<WORD_BYTES_MAX>),
    /// Several words match and differ in the next letter.
    Several,
}

/// Completes the last word of `before`.
pub(super) fn complete(before: &str, settings: &Settings) -> Completion {
    let mut common = String::<WORD_BYTES_MAX>::new();
    let mut count = 0_usize;
    candidates(before, settings, &mut |word| {
        if count == 0 {
            // Keywords and port names are shorter than the buffer.
            let _ = common.push_str(word);
        } else {
            let same = |(a, b): &(u8, u8)| a.eq_ignore_ascii_case(b);
            let length = common.bytes().zip(word.bytes()).take_while(same).count();
            common.truncate(length);
        }
        count += 1;
    });
    let rest = common.get(last_word(before).len()..).unwrap_or_default();
    let mut append = String::new();
    let _ = append.push_str(rest);
    match count {
        0 => return Completion::None,
        1 => {
            let _ = append.push_str(" ");
        }
        _ if append.is_empty() => return Completion::Several,
        _ => {}
    }
    Completion::Append(append)
}

/// Calls `each` with every word that may replace the last word of `before`.
pub(super) fn candidates(before: &str, settings: &Settings, each: &mut dyn FnMut(&str)) {
    let begun = last_word(before);
    let offer: &mut dyn FnMut(&str) = &mut |word| {
        if word.get(..begun.len()).is_some_and(|start| start.eq_ignore_ascii_case(begun)) {
            each(word);
        }
    };
    let done = before.get(..before.len() - begun.len()).unwrap_or_default();
    let mut words = done.split_ascii_whitespace();
    let offers = match words.next() {
        None => &[Offer::Verbs],
        Some(verb) => match commands().find(|command| command.name.eq_ignore_ascii_case(verb)) {
            Some(command) if words.next().is_none() => command.second,
            Some(command) => command.later,
            None => &[],
        },
    };
    for words in offers {
        match *words {
            Offer::Words(words) => words.iter().for_each(|word| offer(word)),
            Offer::Each(each) => each(&mut |word| offer(word)),
            Offer::Verbs => commands().for_each(|command| offer(command.name)),
            Offer::Ports => settings.ports.iter().flatten().for_each(|port| offer(&port.name)),
            Offer::Devices => settings.devices.iter().for_each(|device| offer(&device.name)),
            Offer::Users if !USERS => {}
            Offer::Users => settings.users.iter().for_each(|user| offer(&user.name)),
            // As its verb.
            #[cfg(feature = "tls")]
            Offer::Certificates => settings.certificates().iter().for_each(|own| offer(&own.name)),
            #[cfg(feature = "mqtt")]
            Offer::Publishers => settings.publishers.iter().for_each(|own| offer(&own.name)),
            Offer::Points => settings.points.iter().for_each(|point| offer(&point.name)),
        }
    }
}

fn last_word(before: &str) -> &str {
    let last = before.bytes().rposition(is_separator);
    before.get(last.map_or(0, |at| at + 1)..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;
    use crate::language::apply;

    fn settings() -> Settings {
        let mut settings = Settings::new();
        for line in ["port meters serial uart1 rtu client", "port P502 tcp server 502"] {
            apply(&mut settings, line).unwrap();
        }
        settings
    }

    fn appended(before: &str) -> Option<std::string::String> {
        match complete(before, &settings()) {
            Completion::Append(text) => Some(text.to_string()),
            Completion::Several | Completion::None => None,
        }
    }

    #[test]
    fn a_word_that_only_one_begins_with_is_completed() {
        assert_eq!(appended("sh").as_deref(), Some("ow "));
        assert_eq!(appended("show st").as_deref(), Some("ats "));
        assert_eq!(appended("delete route").as_deref(), None);
        assert_eq!(appended("edit port mete").as_deref(), Some("rs "));
        assert_eq!(appended("route p").as_deref(), Some("502 "));
        assert_eq!(appended("edit port meters tur").as_deref(), Some("naround "));
        assert_eq!(appended("serv").as_deref(), Some("er "));
        assert_eq!(appended("server mete").as_deref(), Some("rs "));
        assert_eq!(appended("show se").as_deref(), Some("rvers "));
        assert_eq!(appended("delete se").as_deref(), Some("rver "));
        assert_eq!(appended("port plant tcp client sock").as_deref(), Some("ets "));
        assert_eq!(appended("help inse").as_deref(), Some("rt "));
        assert_eq!(appended("network dh").as_deref(), Some("cp "));
        assert_eq!(appended("mdns of").as_deref(), Some("f "));
        assert_eq!(appended("route P502 1 * * meters forb").as_deref(), Some("idden "));
        assert_eq!(appended("route P502 1 * * meters forbidden ign").as_deref(), Some("ore "));
    }

    #[test]
    fn several_words_are_completed_as_far_as_they_agree() {
        assert_eq!(appended("show ro").as_deref(), Some("utes "));
        assert_eq!(appended("del").as_deref(), Some("ete "));
        assert_eq!(appended("tune me").as_deref(), Some("ters "));
        assert_eq!(complete("s", &settings()), Completion::Several);
        assert_eq!(complete("xyz", &settings()), Completion::None);
        let mut all = Vec::new();
        candidates("m", &settings(), &mut |word| all.push(word.to_string()));
        assert_eq!(all, ["move", "mdns", "mark"]);
    }
}
