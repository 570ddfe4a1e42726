//! Settings as JSON: they fit their schema, and are the lines that are printed.

extern crate std;
use std::boxed::Box;
use std::string::String;
use std::sync::LazyLock;

use proptest::prelude::*;
use serde_json::{Value, json};

use super::lines::Lines;
use super::piece::{Piece, Source};
use super::response::Content;
use super::settings::{Schema, Written};
use super::status::Status;
use super::untaken::Untaken;
use crate::frame::FramePool;
use crate::gateway::web::Token;
use crate::gateway::{Gateway, Ports};
use crate::hal::System;
use crate::language::apply;
use crate::language::tests::properties::any::any_settings;
use crate::settings::Settings;

/// What a random gateway does not have.
const EXAMPLE: &str = "\
user anna role engineer
user anna key ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIBaLhGyD3MeGBVKcDuCbsDUBlfzFfRkHsZJRxzWuMvHZ
network address 192.168.1.5/24 gateway 192.168.1.1 dns 9.9.9.9
mdns on name cabinet-7
syslog tcp 192.168.1.9:601
ntp time.example
port P1 serial /dev/ttyUSB0 rtu client 19200 8E1 retries 3 proof read holding 0 count 2 for 20-29
port many tcp client
port poll scanner
server many unit 1-5 at meter.example tag +10
route P1 1-64 * * many functions 3,4,16 merge near 8 priority high
device meter unit 5 order 2301 label \"Boiler # 2\"
point power meter holding 0 count 2 as f32 read high
point lamps local coil 0 count 12 label \"x\"
";

fn written(mut next: impl FnMut(&mut Piece) -> Result<bool, core::fmt::Error>) -> String {
    let (mut piece, mut text) = (heapless::String::<8_192>::new(), String::new());
    while next(piece.as_mut_view()).unwrap() {
        text.push_str(&piece);
        piece.clear();
    }
    text
}

fn lines(settings: &Settings) -> String {
    let mut lines = Written::new(false, false);
    written(|piece| lines.next_of(settings, piece))
}

fn as_json(settings: &Settings) -> String {
    let mut json = Written::new(false, true);
    written(|piece| json.next_of(settings, piece))
}

fn taken(lines: Lines<'_>) -> Result<Box<Settings>, Untaken> {
    let mut settings = Box::new(Settings::new());
    lines.each(&mut |_, line| apply(&mut settings, line).map(|_| ())).map(|()| settings)
}

fn schema() -> Value {
    let mut schema = Schema::default();
    serde_json::from_str(&written(|piece| schema.next(piece))).unwrap()
}

static SCHEMA: LazyLock<Value> = LazyLock::new(schema);

/// Whether `value` fits `schema`, which has no other keywords than these. The peers' tests hold the same schema against a validator by
/// others.
fn fits(value: &Value, schema: &Value) -> bool {
    schema.as_object().unwrap().iter().all(|(keyword, of)| match keyword.as_str() {
        "$schema" | "title" => true,
        "type" => match of.as_str().unwrap() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "integer" => value.is_u64(),
            other => panic!("{other}"),
        },
        "const" => value == of,
        "minimum" => value.as_u64() >= of.as_u64(),
        "maximum" => value.as_u64() <= of.as_u64(),
        "anyOf" => of.as_array().unwrap().iter().any(|one| fits(value, one)),
        "items" => value.as_array().is_none_or(|items| items.iter().all(|item| fits(item, of))),
        "required" => of.as_array().unwrap().iter().all(|name| value.get(name.as_str().unwrap()).is_some()),
        "properties" => value.as_object().is_none_or(|members| {
            members.iter().all(|(name, value)| of.get(name).is_none_or(|of| fits(value, of)))
        }),
        "additionalProperties" => {
            assert_eq!(of, &json!(false));
            let known = &schema["properties"];
            value.as_object().is_none_or(|members| members.keys().all(|name| known.get(name).is_some()))
        }
        other => panic!("{other}"),
    })
}

/// The same settings by JSON.
fn check(settings: &Settings) {
    let json = as_json(settings);
    let value: Value = serde_json::from_str(&json).unwrap();
    assert!(fits(&value, &SCHEMA), "{json}");
    let again = taken(Lines::Json(&json)).unwrap_or_else(|error| panic!("{error}: {json}"));
    assert_eq!(lines(&again), lines(settings), "{json}");
}

proptest! {
    // Each validates and parses up to a hundred lines.
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_settings_as_json_fit_the_schema_and_are_the_printed_lines(settings in any_settings()) {
        check(&settings);
    }
}

#[test]
fn each_kind_of_line_is_there_by_names_with_types() {
    let settings = taken(Lines::Text(EXAMPLE)).unwrap();
    check(&settings);
    let value: Value = serde_json::from_str(&as_json(&settings)).unwrap();
    let port = json!({"name": "P1", "kind": "serial", "device": "/dev/ttyUSB0", "framing": "rtu", "side": "client",
        "baud": 19200, "format": "8E1", "retries": 3, "proof": "auto, read holding 0 count 2 for 20-29"});
    assert_eq!(value["port"][0], port);
    let route = json!({"source": "P1", "units": "1-64", "from": "*", "tag": "*", "destination": "many",
        "functions": "3,4,16", "merge": "near 8", "priority": "high"});
    assert_eq!(value["route"][0], route);
    let point = json!({"name": "power", "at": "meter", "table": "holding", "address": 0, "count": 2, "as": "f32",
        "read": "high"});
    assert_eq!(value["point"][0], point);
    assert_eq!(value["device"][0]["label"], json!("Boiler # 2"));
    assert_eq!(as_json(&Settings::new()), "{}");
}

#[test]
fn members_may_come_in_any_order_and_wrong_ones_are_named() {
    let text = r#"{"route":[{"destination":"local","tag":"*","readonly":true,"all":false,"units":"1","from":"*","source":"P502"}],
        "port":[{"clients":4,"listen":"502","kind":"tcp server","name":"P502"}]}"#;
    let settings = taken(Lines::Json(text)).unwrap();
    assert_eq!(
        lines(&settings),
        "port P502 tcp server 502 clients 4\nroute P502 1       * * local readonly\n"
    );
    for (wrong, why) in [
        ("[]", "not as described"),
        ("{} {}", "not as described"),
        (r#"{"pord":[]}"#, "there is no \"pord\""),
        (
            r#"{"port":[{"name":"P1","kind":"tcp server","listen":"502","timeut":"1s"}]}"#,
            "there is no \"timeut\"",
        ),
        (r#"{"port":[{"name":"P1","kind":"tcp server","listen":502}]}"#, "not as described"),
        (r#"{"port":[{"name":"P1","kind":"tcp server","listen":"502 # x"}]}"#, "\"listen\" has no words"),
        (r#"{"port":[{"name":"P1","kind":"tcp server","listen":"502\nport"}]}"#, "\"listen\" has no words"),
        (r#"{"port":[{"name":"P1","kind":"tcp server"}]}"#, "expected"),
    ] {
        let error = taken(Lines::Json(wrong)).unwrap_err();
        let told = std::format!("{error}");
        assert!(told.contains(why), "{wrong}: {told}");
        if !matches!(error, Untaken::Line(..)) {
            assert!(
                !serde_json::from_str(wrong).is_ok_and(|value| fits(&value, &SCHEMA))
                    || wrong.contains("502"),
                "{wrong}"
            );
        }
    }
    for wrong in [
        json!({"port": [{"name": "x"}]}),
        json!({"rout": []}),
        json!({"slave": [{"number": "0", "unit": 1}]}),
    ] {
        assert!(!fits(&wrong, &SCHEMA), "{wrong}");
    }
}

/// Bytes of a piece.
const ROOM: usize = 1_024;

/// What is sent of `content` if the first piece has so many bytes left: what does not fit is the beginning of the next one.
fn sent(mut content: Content<'_, '_>, source: &Source<'_, '_>, left: usize) -> String {
    let (mut text, mut left) = (String::new(), left);
    loop {
        let mut piece = heapless::String::<ROOM>::new();
        (left..ROOM).for_each(|_| piece.push(' ').unwrap());
        let begin = piece.len();
        let more = loop {
            let before = piece.len();
            match content.next(source, piece.as_mut_view()) {
                Ok(true) => {}
                Ok(false) => break false,
                Err(_) => {
                    piece.truncate(before);
                    break true;
                }
            }
        };
        text.push_str(&piece[begin..]);
        left = ROOM;
        if !more {
            return text;
        }
    }
}

#[test]
fn a_status_is_whole_wherever_a_piece_ends() {
    struct Board;
    impl System for Board {
        fn name(&self) -> &str {
            "board"
        }

        fn reboot(&self) {}
    }
    let (pool, ports) = (FramePool::new(&[], 0), Ports::<2>::new());
    let gateway = Gateway::new(&pool, &ports, &[]);
    let mut settings = Settings::new();
    apply(&mut settings, "port P1 serial uart1 rtu client 9600 8N1").unwrap();
    apply(&mut settings, "route P1 1 * * local").unwrap();
    gateway.apply(&settings).unwrap();
    let source = Source { gateway: &gateway, system: &Board };
    let parsed = |text: &str| {
        let mut status: Value = serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"));
        // It has the time since the start.
        status["version"].take();
        status
    };
    let whole = parsed(&sent(Content::Status(Status::new()), &source, ROOM));
    assert_eq!(whole["rules"].as_array().unwrap().len(), 1, "{whole}");
    for left in 0..ROOM {
        assert_eq!(parsed(&sent(Content::Status(Status::new()), &source, left)), whole, "{left}");
        let event = sent(Content::Live(Status::new(), Token::default()), &source, left);
        let data = event.strip_prefix("data: ").and_then(|rest| rest.strip_suffix("\n\n"));
        assert_eq!(parsed(data.unwrap_or_else(|| panic!("{left}: {event:?}"))), whole, "{left}");
    }
}
