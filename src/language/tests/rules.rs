//! Rules as they are read, what is wrong with them, and what is unlikely to be meant.

use super::*;
use crate::settings::Forbidden;

#[test]
fn a_second_identical_rule_is_refused() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["route P502 1 * * P1", "route P502 2 * * P1"]);
    let error = apply(&mut settings, "route 502 2-2 * +0 p1").unwrap_err().to_string();
    assert_eq!(error, "column 7: \"502\": rule 2 is the same");
    apply_all(&mut settings, &["edit route 2 P502 2 * * P1"]);
    assert_eq!(settings.routes.len(), 2);
}

#[test]
fn rules_are_read_by_value() {
    let mut settings = load(PORTS);
    apply_all(
        &mut settings,
        &[
            "route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high",
            "route P502 255 * =17 local functions 3,4, 16-18",
            "route P502 * * * discard all priority low",
            "route P2 1 * +0 nopath functions readonly",
        ],
    );
    let [first, second, third, fourth] = &settings.routes[..] else { panic!() };
    assert_eq!((first.source, first.units), (PortId(4), UnitRange { first: 101, last: 132 }));
    assert_eq!((first.tag, first.destination), (Tag::Subtract(100), Destination::Port(PortId(0))));
    assert_eq!((first.policy.functions, first.policy.priority), (Functions::READ_ONLY, Priority::High));
    assert_eq!((second.tag, second.destination), (Tag::Set(17), Destination::Local));
    let list = Functions::NONE.with(3).with(4).with(16).with(17).with(18);
    assert_eq!(second.policy.functions, list);
    assert_eq!((third.units, third.policy.priority), (UnitRange::ALL, Priority::Low));
    assert_eq!((fourth.tag, fourth.policy.functions), (Tag::Keep, Functions::READ_ONLY));
}

#[test]
fn table_1_of_the_paper_is_accepted_row_by_row() {
    let mut settings = load(
        "port P1 serial uart1 rtu master 19200 8E1\n\
         port P2 serial uart2 rtu slave 19200 8E1\n\
         port P3 serial uart3 ascii master 9600 7E1\n\
         port P4 serial uart4 ascii slave 9600 7E1\n\
         port P502 tcp server 502\n",
    );
    apply_all(
        &mut settings,
        &[
            "route P1   1-64   * * P2",
            "route P2   1-64   * * P1",
            "route P3   *      * * P4",
            "route P4   *      * * P3",
            "route P502 65-128 192.168.1.101 * P2",
            "route P2   65-128 * * 502",
        ],
    );
    assert_eq!(settings.routes.len(), 6);
    assert_eq!(settings.routes[5].destination, Destination::Port(PortId(4)), "502 is P502");
    let implied: Vec<bool> = settings.routes.iter().map(|route| is_implied(&settings, route)).collect();
    assert_eq!(implied, [true, false, true, false, true, true]);
}

#[test]
fn a_tag_that_makes_a_broadcast_or_no_unit_of_a_unit_is_refused() {
    let cases = [
        ("1-64 * -1", "column 19: \"-1\": unit 1 would become 0, a broadcast to all units"),
        ("5 * =0", "column 16: \"=0\": unit 5 would become 0, a broadcast to all units"),
        ("* * =0", "column 16: \"=0\": unit 0 would become 0, a broadcast to all units"),
        ("101-132 * -101", "\"-101\": unit 101 would become 0, a broadcast to all units"),
        ("255 * -255", "\"-255\": unit 255 would become 0, a broadcast to all units"),
        ("50-150 * -100", "column 21: \"-100\": unit 50 would become -50, but units are 1 to 247, or 255"),
        ("* * +1", "\"+1\": unit 247 would become 248, but units are 1 to 247, or 255"),
        ("255 * +1", "\"+1\": unit 255 would become 256, but units are 1 to 247, or 255"),
        ("148 * +100", "\"+100\": unit 148 would become 248, but units are 1 to 247, or 255"),
        // The last one is a unit, those before it are none.
        ("240-247 * +8", "\"+8\": unit 240 would become 248, but units are 1 to 247, or 255"),
        ("1 * =254", "\"=254\": unit 1 would become 254, but units are 1 to 247, or 255"),
        ("1 * =248", "\"=248\": unit 1 would become 248, but units are 1 to 247, or 255"),
    ];
    for (columns, expected) in cases {
        let error = error(&format!("route P502 {columns} P1"));
        assert!(error.contains(expected), "{columns}\n gives    {error}\n expected {expected}");
    }
    let mut settings = load(PORTS);
    let good =
        ["2-64 * -1", "1-147 * +100", "247 * +8", "* * =247", "* * =255", "0 * +5", "* * *", "248 * -1"];
    for columns in good {
        apply(&mut settings, &format!("route P502 {columns} P1")).unwrap_or_else(|error| panic!("{error}"));
    }
}

#[test]
fn the_words_of_a_policy_are_read_and_printed() {
    let mut settings = load(PORTS);
    let lines = [
        "route P502 1       * * P1 readonly forbidden ignore",
        "route P502 2       * * P1 functions 1-4,43/14 writes 10-19",
        "route P502 3       * * P1 functions 3,43 urgent 43/14",
    ];
    apply_all(&mut settings, &lines);
    assert_eq!(settings.routes[0].policy.forbidden, Forbidden::Ignore);
    let text = print(&settings);
    for line in lines {
        assert!(text.contains(line), "{line}\n{text}");
    }
    apply_all(&mut settings, &["edit route 1 P502 1 * * P1 forbidden refuse functions 43/14,43"]);
    let text = print(&settings);
    assert!(text.contains("route P502 1       * * P1 functions 43\n"), "{text}");
    for (line, expected) in [
        ("forbidden", "end of line: expected refuse or ignore"),
        ("forbidden exception", "\"exception\": expected refuse or ignore"),
        ("forbidden refuse forbidden ignore", "\"forbidden\": is set twice"),
        (
            "functions 43/13",
            "\"43/13\": expected function codes from 1 to 127, such as 3,4,16 or 1-6, or 43/14",
        ),
    ] {
        let error = error(&format!("route P502 1 * * P1 {line}"));
        assert!(error.contains(expected), "{line}\n gives    {error}\n expected {expected}");
    }
}

/// What is said when `line` is typed.
fn warning(settings: &mut Settings, line: &str) -> Option<String> {
    let applied = apply(settings, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    applied.warning.map(|warning| warning.to_string())
}

/// What is said of the whole table.
fn warnings(settings: &Settings) -> Vec<String> {
    settings.warnings().map(|warning| warning.to_string()).collect()
}

#[test]
fn a_rule_that_never_matches_is_named_with_those_that_take_its_requests() {
    // Rules above, the rule, and whether something is left for it.
    let cases: [(&[&str], &str, Option<&str>); 13] = [
        (&["1-64 *"], "1-64 * =5", Some("rule 2 never matches: rule 1 takes all its requests")),
        (&["1-64 *"], "1-65 *", None),
        (&["* *"], "7 10.0.0.1", Some("rule 2 never matches: rule 1 takes all its requests")),
        (&["7 10.0.0.1"], "7 *", None),
        (&["7 10.0.0.0/8"], "7 10.1.0.0/16", Some("rule 2 never matches: rule 1 takes all its requests")),
        (&["7 10.0.0.0/16"], "7 10.0.0.0/8", None),
        (&["7 10.1.0.0/16"], "7 10.2.0.0/16", None),
        // Several cover it together, in any order.
        (
            &["40-64 *", "100 *", "1-20 *", "21-39 10.0.0.0/8"],
            "1-64 10.0.0.0/16",
            Some("rule 5 never matches: rules 1, 3, 4 take all its requests"),
        ),
        (&["1-20 *", "22-64 *"], "1-64 *", None),
        (&["1-20 *", "21-64 10.0.0.1"], "1-64 *", None),
        (&["0-100 *", "101-255 *"], "* *", Some("rule 3 never matches: rules 1, 2 take all its requests")),
        (&["0-247 *"], "* *", None),
        (&["0-247 *", "248-254 *"], "* *", None),
    ];
    for (above, rule, expected) in cases {
        let mut settings = load(PORTS);
        let line = |rule: &str| match rule.split_once('=') {
            Some(_) => format!("route P502 {rule} P1"),
            None => format!("route P502 {rule} * P1"),
        };
        for rule in above {
            assert_eq!(warning(&mut settings, &line(rule)), None, "{rule}");
        }
        assert_eq!(warning(&mut settings, &line(rule)).as_deref(), expected, "{above:?} {rule}");
        assert_eq!(warnings(&settings), expected.into_iter().map(String::from).collect::<Vec<_>>());
    }
}

#[test]
fn rules_of_other_ports_and_ways_back_take_nothing() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["route P5 * * * P1", "route P1 * * * P502", "route P2 1-9 * * P502"]);
    assert_eq!(warning(&mut settings, "route P502 1 * * P1"), None);
    assert_eq!(
        warning(&mut settings, "route P2 5 * * P1"),
        None,
        "a way back never matches, so it takes nothing"
    );
    assert_eq!(warning(&mut settings, "route P1 5 * * P502"), None, "and is not meant to");
    assert_eq!(warnings(&settings), [""; 0]);
}

#[test]
fn units_that_mean_something_else_at_their_port_come_to_no_rule() {
    let mut settings = load(PORTS);
    apply_all(&mut settings, &["route P502 255 * * P1", "route P502 1-254 * * P1"]);
    let said = warning(&mut settings, "edit port P502 unit-255 local");
    assert_eq!(said.as_deref(), Some("rule 1 never matches: its units mean something else at its port"));
    apply_all(&mut settings, &["edit port P502 reserved-units replace 7 broadcast off"]);
    let said = warning(&mut settings, "route P502 * * =5 P1");
    assert_eq!(said.as_deref(), Some("rule 3 never matches: rule 2 takes all its requests"), "unit 0, too");
}

#[test]
fn a_rule_that_is_put_above_others_names_those_that_it_leaves_nothing() {
    let mut settings = load(PORTS);
    let lines = ["route P502 1-9 * * P1", "route P502 10-19 * * P1", "route P502 20-29 * * P1"];
    apply_all(&mut settings, &lines);
    let said = warning(&mut settings, "insert route 1 P502 5-19 * * P4");
    assert_eq!(said.as_deref(), Some("rule 3 never matches: rule 1 takes all its requests"));
    let said = warning(&mut settings, "edit route 1 P502 1-19 * * P4");
    assert_eq!(said.as_deref(), Some("rules 2, 3 never match: rule 1 takes all their requests"));
    assert_eq!(
        warning(&mut settings, "move route 1 4"),
        Some("rule 4 never matches: rules 1, 2 take all its requests".to_string())
    );
    assert_eq!(
        warning(&mut settings, "move route 4 3").as_deref(),
        Some("rule 3 never matches: rules 1, 2 take all its requests")
    );
    assert_eq!(warning(&mut settings, "delete route 3"), None);
    assert_eq!(warnings(&settings), [""; 0]);
}

#[test]
fn requests_that_come_back_to_their_rule_are_named() {
    let circle = |port: &str, rule: &str| {
        Some(format!("rule {rule} in a circle: its requests come back by port {port}"))
    };
    let ports = "port s tcp server 502\nport c tcp client 127.0.0.1:502\nport bus serial uart1 rtu client\n";
    let cases: [(&[&str], &str, Option<String>); 20] = [
        (&[], "route s 1-9 * * c", circle("s", "1 leads unit 1")),
        (&[], "route s * * =7 c", circle("s", "1 leads unit 7")),
        (&[], "route s 1-6 * =7 c", None),
        (&[], "route s 2-9 * -1 c", None),
        (&["route s 5 * * bus"], "route s 5-6 * * c", circle("s", "2 leads unit 6")),
        (&["route s * 127.0.0.0/8 * bus"], "route s 5-6 * * c", None),
        (&[], "route s 5-6 10.0.0.0/8 * c", None),
        (&[], "route s 5-6 127.0.0.1 * c", circle("s", "1 leads unit 5")),
        (
            &["edit port s reserved-units off unit-255 local"],
            "route s 248-255 * * c",
            Some("rule 1 never matches: its units mean something else at its port".to_string()),
        ),
        (&["edit port c unit 3"], "route s 1-9 * +50 c", circle("s", "1 leads unit 3")),
        // Another server, framing, address.
        (&["edit port s listen 503"], "route s 1-9 * * c", None),
        (&["edit port s rtu"], "route s 1-9 * * c", None),
        (&["edit port s listen 10.0.0.5:502"], "route s 1-9 * * c", None),
        (&["edit port c address 10.0.0.5:502"], "route s 1-9 * * c", None),
        (&["edit port s listen 0.0.0.0:502"], "route s 1-9 * * c", circle("s", "1 leads unit 1")),
        (&["edit port s allow 10.0.0.0/8"], "route s 1-9 * * c", None),
        // All of 127.0.0.0/8 is this host, which asks from the first of them.
        (&["edit port c address 127.0.0.2:502"], "route s 5-6 127.0.0.1 * c", circle("s", "1 leads unit 5")),
        // An own address that the settings tell.
        (
            &["edit port s listen 10.0.0.5:502", "edit port c address 10.0.0.5:502"],
            "route s 1-9 * * c",
            circle("s", "1 leads unit 1"),
        ),
        (
            &["edit port c address 10.0.0.5:502", "port other udp server 10.0.0.5:5020"],
            "route s 1-9 * * c",
            circle("s", "1 leads unit 1"),
        ),
        (
            &["edit port c address 10.0.0.5:502", "network address 10.0.0.5/8"],
            "route s 1-9 * * c",
            circle("s", "1 leads unit 1"),
        ),
    ];
    for (lines, rule, expected) in cases {
        let mut settings = load(ports);
        apply_all(&mut settings, lines);
        assert_eq!(warning(&mut settings, rule), expected, "{lines:?} {rule}");
        assert_eq!(warnings(&settings), expected.into_iter().collect::<Vec<_>>());
    }
}

#[test]
fn a_circle_may_go_through_several_ports() {
    let mut settings = load(
        "port s1 tcp server 502\nport s2 tcp server 127.0.0.1:503 rtu\n\
         port c1 tcp client 127.0.0.1:503 rtu\nport c2 tcp client 127.0.0.1:1502\n\
         route s1 11-19 * -10 c1\nroute s2 1-5 * +10 c2\n",
    );
    assert_eq!(warnings(&settings), [""; 0], "nobody listens at 1502");
    let said = warning(&mut settings, "edit port c2 address 127.0.0.1:502");
    assert_eq!(said.as_deref(), Some("rule 2 leads unit 1 in a circle: its requests come back by port s1"));
    let circles = warnings(&settings);
    assert_eq!(circles[0], "rule 1 leads unit 11 in a circle: its requests come back by port s2");
    assert_eq!(circles.len(), 2);
}
