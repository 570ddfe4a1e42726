//! The lines of publishers.

use std::format;
use std::string::ToString;

use super::{PORTS, load, print, std};
use crate::language::{Shown, WithoutSecrets, apply, write_shown_line};
use crate::settings::Settings;

fn said(settings: &mut Settings, line: &str) -> std::string::String {
    let before = settings.clone();
    let error = apply(settings, line).unwrap_err().to_string();
    assert_eq!(*settings, before, "{line}");
    error
}

#[test]
fn a_publisher_is_printed_with_what_it_has_not_by_default() {
    for (line, printed) in [
        ("publish p mqtt broker 127.0.0.1", "publish p mqtt broker 127.0.0.1:1883\n"),
        (
            "publish p mqtt broker 127.0.0.1:1 version 5 format json commands off every 60s topic mobgate",
            "publish p mqtt broker 127.0.0.1:1\n",
        ),
        (
            "publish p mqtt broker 127.0.0.1 commands on format homeassistant every 5m topic a/b version 3.1.1",
            "publish p mqtt broker 127.0.0.1:1883 version 3.1.1 topic a/b every 300s format homeassistant commands on\n",
        ),
        (
            "publish p mqtt broker 127.0.0.1 format sparkplug topic Plant-1 commands on",
            "publish p mqtt broker 127.0.0.1:1883 topic Plant-1 format sparkplug commands on\n",
        ),
        (
            "publish p mqtt broker 127.0.0.1 user u password \"a # b, c\"",
            "publish p mqtt broker 127.0.0.1:1883 user u password \"a # b, c\"\n",
        ),
    ] {
        let mut settings = load(PORTS);
        apply(&mut settings, line).unwrap();
        assert!(print(&settings).contains(printed), "{line}: {}", print(&settings));
        assert_eq!(load(&print(&settings)), settings);
    }
}

#[test]
fn a_password_is_kept_for_the_same_user_of_the_same_broker_and_is_shown_nowhere() {
    let mut settings = load(PORTS);
    let typed = "publish p mqtt broker 127.0.0.1 user u password \"let me in\" commands on";
    apply(&mut settings, typed).unwrap();
    let has = |settings: &Settings| print(settings).contains("password \"let me in\"");
    apply(&mut settings, "publish P mqtt broker 127.0.0.1 every 5s user u").unwrap();
    assert!(has(&settings) && settings.publishers.len() == 1, "{}", print(&settings));
    let shown = |shown| {
        let mut text = std::string::String::new();
        (0..).map_while(|n| write_shown_line(&settings, n, shown, &mut text)).for_each(Result::unwrap);
        text
    };
    for without in [Shown::WithoutSecrets, Shown::Apart] {
        assert!(shown(without).contains("publish") && !shown(without).contains("let"), "{}", shown(without));
    }
    assert_eq!(
        WithoutSecrets(typed).to_string(),
        "publish p mqtt broker 127.0.0.1 user u password commands on"
    );
    let line = "publish p mqtt broker 127.0.0.2 user u";
    apply(&mut settings, line).unwrap();
    assert!(!has(&settings), "another broker does not learn it");
}

#[test]
fn wrong_words_are_named() {
    let mut settings = load(PORTS);
    let long = "z".repeat(128);
    for (line, expected) in [
        ("publish", "expected a publisher's name"),
        ("publish 1 mqtt", "expected a publisher's name"),
        ("publish p", "expected mqtt"),
        ("publish p mqtt server", "expected broker and its address"),
        ("publish p mqtt broker", "expected the address of a server"),
        ("publish p mqtt broker 127.0.0.1 version 4", "expected 3.1.1 or 5"),
        ("publish p mqtt broker 127.0.0.1 every 0", "expected a time from 1s to 86400s"),
        ("publish p mqtt broker 127.0.0.1 every 1s every 2s", "is set twice"),
        ("publish p mqtt broker 127.0.0.1 topic a//b", "expected a topic such as"),
        ("publish p mqtt broker 127.0.0.1 topic +/a", "expected a topic such as"),
        ("publish p mqtt broker 127.0.0.1 format xml", "expected json, homeassistant or sparkplug"),
        (
            "publish p mqtt broker 127.0.0.1 topic a/b format sparkplug",
            "\"a/b\": expected a group of Sparkplug",
        ),
        ("publish p mqtt broker 127.0.0.1 format sparkplug topic a+b", "expected a topic such as"),
        (
            "publish p mqtt broker 127.0.0.1 every 60s format sparkplug",
            "\"every\": is not for format sparkplug",
        ),
        ("publish p mqtt broker 127.0.0.1 commands yes", "expected on or off"),
        ("publish p mqtt broker 127.0.0.1 password \"x\"", "expected user NAME before the password"),
        ("publish p mqtt broker 127.0.0.1 comands on", "did you mean commands?"),
        ("delete publish p", "there is no publisher of this name"),
        #[cfg(feature = "tls")]
        ("publish p mqtt broker 127.0.0.1 trust them", "needs tls"),
        #[cfg(feature = "tls")]
        ("publish p mqtt broker 127.0.0.1 tls", "there is no line certificate NAME servers FILE"),
    ] {
        let said = said(&mut settings, line);
        assert!(said.contains(expected), "{line}: {said}");
    }
    let said = said(&mut settings, &format!("publish p mqtt broker 127.0.0.1 user u password \"{long}\""));
    assert!(said.contains("in quotes") && !said.contains('z'), "{said}");
}

#[test]
fn two_publish_and_each_is_deleted() {
    let mut settings = load(PORTS);
    for name in ["a", "b"] {
        apply(&mut settings, &format!("publish {name} mqtt broker 127.0.0.1")).unwrap();
    }
    let third = said(&mut settings, "publish c mqtt broker 127.0.0.1");
    assert!(third.contains("there are 2 publishers already, the maximum"), "{third}");
    apply(&mut settings, "delete publish A").unwrap();
    apply(&mut settings, "delete publish b").unwrap();
    assert_eq!(print(&settings), print(&load(PORTS)));
}

#[cfg(feature = "tls")] // As its lines.
#[test]
fn a_certificate_that_a_publisher_needs_stays() {
    let mut settings = load(PORTS);
    apply(&mut settings, "certificate them servers /tls/them.pem").unwrap();
    apply(&mut settings, "publish p mqtt broker 127.0.0.1 tls trust them").unwrap();
    assert!(print(&settings).contains("broker 127.0.0.1:8883 tls trust them\n"));
    let said = said(&mut settings, "delete certificate them");
    assert!(said.contains("publisher p needs it"), "{said}");
}
