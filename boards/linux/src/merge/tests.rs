//! Saves over files that people have written: by value, and for whatever settings and comments there are.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::{Text, merge};
use crate::settings::{parse, print};
use any::{Dice, file, settings_lines};

mod any;

const FILE: &str = "\
# Boiler house

port  P1   serial /dev/ttyUSB0 rtu client 9600 8N1   # the burners
port  P2   serial /dev/ttyUSB1 rtu client 9600 8N1   # the pumps
port  P502 tcp server 502

# SCADA reads all
route P502 1-64 * * P1
# except that one
route P502 70 10.0.0.7 * P2 readonly

# the end
";

/// What `FILE` is after a console has carried out `lines` and saved.
fn after(lines: &[&str]) -> String {
    changed(FILE, lines)
}

/// `file` after `lines` is `file` with these texts replaced.
fn check(file: &str, lines: &[&str], replaced: &[(&str, &str)]) {
    let expected = replaced.iter().fold(file.to_owned(), |text, (old, new)| text.replace(old, new));
    assert_eq!(changed(file, lines), expected, "{lines:?}");
}

fn changed(file: &str, lines: &[&str]) -> String {
    let mut settings = parse(file).unwrap();
    for line in lines {
        mobgate::language::apply(&mut settings, line).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
    merge(file, &print(&settings))
}

#[test]
fn a_file_that_says_so_already_stays_as_it_is() {
    assert_eq!(after(&[]), FILE);
    // Also one that gets there by a detour.
    let detour = format!("{FILE}edit port P1 19200\ninsert route 1 P502 9 * * P2\nmove route 1 2\n");
    assert_eq!(changed(&detour, &[]), detour);
}

#[test]
fn a_changed_line_stands_where_its_old_one_stood_with_its_comment() {
    let old = "port  P2   serial /dev/ttyUSB1 rtu client 9600 8N1   # the pumps";
    let new = "port P2   serial /dev/ttyUSB1 rtu client 19200 8N1 # the pumps";
    check(FILE, &["edit port P2 19200"], &[(old, new)]);
    let rule = ("route P502 1-64 * * P1", "route P502 1-64    * * P2");
    check(FILE, &["edit route 1 P502 1-64 * * P2"], &[rule]);
}

#[test]
fn new_lines_go_behind_the_last_of_their_kind() {
    let port = ("server 502\n", "server 502\nport P3   tcp client 10.0.0.1:502\n");
    let rule = ("P2 readonly\n", "P2 readonly\nroute P502 80      * * P3\n");
    check(FILE, &["port P3 tcp client 10.0.0.1", "route P502 80 * * P3"], &[port, rule]);
    // A longer name widens the columns of new lines, and leaves old ones alone.
    let port = ("server 502\n", "server 502\nport substation tcp client 10.0.0.1:502\n");
    check(FILE, &["port substation tcp client 10.0.0.1"], &[port]);
}

#[test]
fn removed_lines_go_and_nothing_else_is_lost() {
    let rule = ("route P502 1-64 * * P1\n", "");
    check(FILE, &["delete route 1"], &[rule]);
    let port = ("port  P1   serial /dev/ttyUSB0 rtu client 9600 8N1   # the burners\n", "");
    check(FILE, &["delete route 1", "delete port P1"], &[rule, port]);
    let comments = "# Boiler house\n\n\n# SCADA reads all\n# except that one\n\n# the end\n";
    let all = ["delete routes", "delete port P1", "delete port P2", "delete port P502"];
    assert_eq!(after(&all), comments);
}

#[test]
fn rules_are_inserted_and_moved_where_their_order_wants_them() {
    let first = ("# SCADA reads all\n", "route P502 9       * * P2\n# SCADA reads all\n");
    check(FILE, &["insert route 1 P502 9 * * P2"], &[first]);
    let second = ("* P1\n", "* P1\nroute P502 9       * * P2\n");
    check(FILE, &["insert route 2 P502 9 * * P2"], &[second]);
    let moved = after(&["move route 1 2"]);
    let expected = "\
port P1   serial /dev/ttyUSB0 rtu client 9600 8N1
port P2   serial /dev/ttyUSB1 rtu client 9600 8N1
port P502 tcp server 502
route P502 70      10.0.0.7 * P2 readonly
route P502 1-64    * * P1
";
    assert_eq!(print(&parse(&moved).unwrap()), expected);
}

#[test]
fn lines_that_edit_others_end_up_in_those() {
    let file = format!("{FILE}edit port P1 retries 2 # a bad cable\ndelete route 2\n");
    let expected = FILE
        .replace(
            "port  P1   serial /dev/ttyUSB0 rtu client 9600 8N1   # the burners",
            "port P1   serial /dev/ttyUSB0 rtu client 9600 8N1 retries 3 # the burners",
        )
        .replace("route P502 70 10.0.0.7 * P2 readonly\n", "");
    assert_eq!(changed(&file, &["edit port P1 retries 3"]), format!("{expected}# a bad cable\n"));
}

#[test]
fn a_rule_for_a_port_that_is_made_further_down_puts_the_file_into_order() {
    let file = "\
# line one
port P1 serial uart1 rtu client
port P502 tcp server 502
route P502 1 * * P1 # mine
# line two
port P2 serial uart2 rtu client
route P502 2 * * P2
";
    let expected = "\
# line one
port P1 serial uart1 rtu client
port P502 tcp server 502
# line two
port P2 serial uart2 rtu client
route P502 1       * * P2 # mine
route P502 2 * * P2
";
    assert_eq!(changed(file, &["edit route 1 P502 1 * * P2"]), expected);
    // A new port and its rule find their places without that.
    let new = ["port P3 serial uart3 rtu client", "route P502 3 * * P3"];
    let expected = file
        .replace("uart2 rtu client\n", "uart2 rtu client\nport P3   serial uart3 rtu client 19200 8E1\n")
        + "route P502 3       * * P3\n";
    assert_eq!(changed(file, &new), expected);
}

#[test]
fn multicast_dns_is_a_line_as_any_other() {
    let file = FILE.to_owned() + "mdns off # the plant forbids it\n";
    let listen = ("port  P502 tcp server 502", "port P502 tcp server 503");
    check(&file, &["edit port P502 listen 503"], &[listen]);
    check(&file, &["mdns on name hall"], &[("mdns off #", "mdns on name hall #")]);
    // The default is said where something else was.
    check(&file, &["mdns on"], &[("mdns off #", "mdns on #")]);
    check(&file.replace("mdns off #", "mdns on #"), &["edit port P502 listen 502"], &[]);
    assert_eq!(after(&["mdns off"]), FILE.to_owned() + "mdns off\n");
}

#[test]
fn points_and_their_labels_are_kept_too() {
    let file = "\
port scan scanner
device boiler unit 1 label \"No. 1 # north\"   # by the door
point temp boiler 40001 label \"T # 1\" # in K
";
    let expected = file.to_owned() + "point out  boiler holding 5\n";
    assert_eq!(changed(file, &["point out boiler 40006"]), expected);
    let point = ("point temp boiler 40001", "point temp boiler holding 2");
    check(file, &["point temp boiler 40003 label \"T # 1\""], &[point]);
}

#[test]
fn line_ends_a_byte_order_mark_and_a_missing_last_line_end_stay() {
    let file = format!("\u{feff}{}", FILE.replace('\n', "\r\n"));
    let expected = file.replace("server 502\r\n", "server 502\r\nport P3   tcp client 10.0.0.1:502\r\n");
    assert_eq!(changed(&file, &["port P3 tcp client 10.0.0.1"]), expected);
    let file = "port P1 tcp server 502";
    assert_eq!(changed(file, &["edit port P1 rtu"]), "port P1 tcp server 502 rtu\n");
    let expected = "port P1 tcp server 502\nport P2 tcp server 503\n";
    assert_eq!(changed(file, &["port P2 tcp server 503"]), expected);
}

#[test]
fn a_comment_that_does_not_fit_behind_a_line_stands_above_it() {
    let comment = format!("# {}", "x".repeat(700));
    let file = format!("port P1 tcp server 502 {comment}\n");
    let prefixes = "10.0.0.0/8,192.168.100.0/24,192.168.101.0/24,192.168.102.0/24";
    let edit = format!("edit port P1 allow {prefixes} clients 99");
    let expected = format!("{comment}\nport P1 tcp server 502 clients 99 allow {prefixes}\n");
    assert_eq!(changed(&file, &[&edit]), expected);
}

#[test]
fn lines_that_cannot_be_read_give_way() {
    let file = format!("prot P9\n{FILE}route P9 1 * * P1\n");
    assert_eq!(merge(&file, &print(&parse(FILE).unwrap())), FILE);
    assert_eq!(merge("# nothing yet\n", "\n"), "# nothing yet\n");
    assert_eq!(merge("", "\n"), "\n", "an empty file would be none");
    assert_eq!(merge("", "port P1 tcp server 502\n"), "port P1 tcp server 502\n");
}

const HASH: &str =
    "\"$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA\"";
const KEY: &str = "AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GK";

#[test]
fn users_their_keys_and_servers_of_syslog_and_time_are_lines_as_any_other() {
    let file = format!(
        "# who may come in\nuser anna role engineer password {HASH}   # the owner\n\
         user anna key ssh-ed25519 {KEY}Jl anna@desk # her desk\n{FILE}syslog 10.0.0.9 # the plant's\n\
         ntp 10.0.0.1 # the clock\n"
    );
    check(
        &file,
        &["edit port P502 listen 503"],
        &[("port  P502 tcp server 502", "port P502 tcp server 503")],
    );
    let role = format!("user anna role engineer password {HASH}   #");
    let lower = format!("user anna role viewer password {HASH} #");
    check(&file, &["user anna role viewer"], &[(&role, &lower)]);
    let more = format!("user anna key ssh-ed25519 {KEY}Jm");
    let desk = format!("{KEY}Jl anna@desk # her desk\n");
    check(&file, &[&more], &[(&desk, &format!("{desk}{more}\n"))]);
    let gone = format!("user anna key ssh-ed25519 {KEY}Jl anna@desk # her desk\n");
    check(&file, &[&format!("delete user anna key ssh-ed25519 {KEY}Jl")], &[(&gone, "")]);
    check(&file, &["syslog tcp 10.0.0.8"], &[("syslog 10.0.0.9 #", "syslog tcp 10.0.0.8:514 #")]);
    check(&file, &["syslog off"], &[("syslog 10.0.0.9 # the plant's\n", "")]);
    check(&file, &["ntp 10.0.0.2"], &[("ntp 10.0.0.1 #", "ntp 10.0.0.2:123 #")]);
    check(&file, &["ntp off"], &[("ntp 10.0.0.1 # the clock\n", "")]);
}

/// How often each comment stands in a text, those of removed lines aside.
fn comments(text: &str) -> BTreeMap<&str, usize> {
    let lines = text.lines().map(str::trim).filter(|line| line.starts_with('#'));
    lines.fold(BTreeMap::new(), |mut counts, line| {
        *counts.entry(line).or_default() += 1;
        counts
    })
}

/// The words of each line that makes something with a name, and the line.
fn named(text: &str) -> BTreeMap<Vec<String>, String> {
    let read = Text::read(text);
    let made = read.lines.iter().filter_map(|line| match &line.does {
        super::Does::Makes(item) if item.kind != super::ROUTE => {
            Some((item.words.clone(), line.raw.to_owned()))
        }
        _ => None,
    });
    made.collect()
}

/// What a text says: its rules in their order, and all else in any.
fn said(text: &str) -> (Vec<String>, Vec<String>) {
    let lines = print(&parse(text).unwrap());
    let lines = lines.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    let (rules, mut others): (Vec<_>, Vec<_>) = lines.partition(|line| line.starts_with("route"));
    others.sort();
    (rules, others)
}

proptest! {
    // Each reads some hundred texts.
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn what_is_saved_over_any_commented_file_is_read_back(old in any::<u64>(), new in any::<u64>()) {
        let (mut one, mut other) = (Dice(old), Dice(new));
        let lines = settings_lines(&mut one);
        let old = file(&mut one, lines);
        let wanted = file(&mut other, settings_lines(&mut Dice(new)));
        let new = print(&parse(&wanted).unwrap());
        let merged = merge(&old, &new);
        prop_assert_eq!(said(&merged), said(&new), "{}\n--\n{}", old, merged);
        prop_assert_eq!(comments(&merged), comments(&old));
        // What says the same is the same, to the byte.
        let (before, after) = (named(&old), named(&merged));
        for (words, line) in before.iter().filter(|(words, _)| after.contains_key(*words)) {
            prop_assert_eq!(line, &after[words]);
        }
        prop_assert_eq!(merge(&merged, &new), merged, "a second save changes nothing");
    }

    #[test]
    fn one_change_leaves_all_other_lines_in_their_order(seed in any::<u64>()) {
        let mut dice = Dice(seed);
        let lines = settings_lines(&mut dice);
        let old = file(&mut dice, lines);
        let mut settings = parse(&old).unwrap();
        let change = dice.of(&[
            "edit port bus retries 3", "delete route 1", "delete route 2", "port new tcp client 10.9.9.9",
            "edit port P1 timeout 7s", "delete point p00", "route P1 77 * * local", "delete port plc",
        ]);
        // A rule that uses a port made further down cannot stand behind the other rules: then the lines come in another order.
        let last = |of: &str| old.lines().collect::<Vec<_>>().iter().rposition(|line| line.split_whitespace().take(2).eq(of.split(" ")));
        let rules = old.lines().collect::<Vec<_>>().iter().rposition(|line| line.trim_start().starts_with("route"));
        prop_assume!(!change.starts_with("route") || last("port P1") < rules);
        if mobgate::language::apply(&mut settings, change).is_ok() {
            let merged = merge(&old, &print(&settings));
            let count = |text: &str| text.lines().count();
            let stayed: Vec<_> = old.lines().filter(|line| merged.lines().any(|other| other == *line)).collect();
            let kept: Vec<_> = merged.lines().filter(|line| old.lines().any(|other| other == *line)).collect();
            prop_assert_eq!(stayed, kept, "{}", change);
            prop_assert!(count(&merged).abs_diff(count(&old)) <= 1);
        }
    }
}

#[test]
fn lines_of_servers_keep_their_places_and_comments() {
    let file = "port plant tcp client sockets 2\nserver plant unit 1-5 at 10.0.0.1 # the hall\n\n# the yard\nserver plant unit 7 at meter.example\n";
    let saved = changed(file, &["server plant unit 9 at 10.0.0.9 tag =1"]);
    assert!(saved.starts_with(file), "{saved}");
    assert!(saved.ends_with("at 10.0.0.9:502 tag =1\n"), "{saved}");
    let saved = changed(file, &["delete server plant unit 7", "edit port plant sockets 3"]);
    assert!(saved.contains("server plant unit 1-5 at 10.0.0.1 # the hall\n"), "{saved}");
    assert!(!saved.contains("meter.example") && saved.contains("sockets 3"), "{saved}");
}
