//! Candidates at consoles: lines that change them, commits, and the way back.

use super::{Memory, Mode, SETTINGS, new_gateway, pipe, session};

#[test]
fn lines_change_the_candidate_until_it_is_committed_as_a_whole_and_saved() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    typed(SETTINGS);
    assert_eq!(typed("candidate\nedit port P1 19200\ndelete route 1\nport P503 tcp server 503"), "");
    assert!(typed("show config").contains("P1   serial /dev/ttyUSB0 rtu client 9600 8N1"));
    assert!(typed("show candidate").contains("port P503 tcp server 503"));
    assert_eq!(
        typed("diff"),
        "- port P1 serial /dev/ttyUSB0 rtu client 9600 8N1 timeout 300ms\n\
         + port P1 serial /dev/ttyUSB0 rtu client 19200 8N1 timeout 300ms\n\
         - route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high\n\
         + port P503 tcp server 503\n\
         restarts: P1 P503\n"
    );
    assert_eq!(typed("commit check\ncommit"), "the board can have it\nin force and saved\n");
    let shown = typed("show config");
    assert!(shown.contains("rtu client 19200") && shown.contains("P503"), "{shown}");
    assert!(!gateway.has_unsaved());
    assert_eq!(core::str::from_utf8(&store.saved).unwrap(), shown);
}

#[test]
fn a_rule_that_moves_and_another_order_of_names_are_seen() {
    let gateway = &new_gateway();
    pipe(gateway, SETTINGS);
    assert_eq!(
        pipe(gateway, "candidate\nmove route 2 1\nport a-long-name tcp server 1502\ndiff"),
        "+ port a-long-name tcp server 1502\n\
         - route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high\n\
         + route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high\n\
         restarts: a-long-name\n"
    );
    assert_eq!(pipe(gateway, "discard\ncandidate\ndiff"), "");
}

#[test]
fn what_the_board_cannot_have_or_the_store_cannot_keep_changes_nothing() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    typed(SETTINGS);
    let before = typed("show config");
    let refused = "error: line 1, the TCP servers need 51 connections (one more each than their clients), this \
                   board has 40\n";
    typed("candidate\nedit port P502 clients 50");
    assert_eq!(typed("commit check"), refused);
    assert_eq!(typed("commit"), refused);
    assert_eq!(typed("show config"), before);
    typed("edit port P502 clients 4");
    store.absent = true;
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    assert_eq!(
        typed("commit"),
        "error: line 1, nothing has changed: there is no place to save settings: start with --config FILE\n"
    );
    assert_eq!(typed("show config"), before);
    let audit = typed("show audit");
    assert!(audit.contains("- port P502 tcp server 502 clients 4"), "the way back is in the trail: {audit}");
    assert!(typed("show candidate").contains("clients 4"), "the candidate is still there");
}

#[test]
fn each_command_says_what_it_misses() {
    let gateway = &new_gateway();
    for command in ["diff", "discard", "commit", "commit check", "commit confirmed"] {
        let said = pipe(gateway, command);
        assert_eq!(said, "error: line 1, there is no candidate: `candidate` begins one\n", "{command}");
    }
    assert_eq!(pipe(gateway, "rollback"), "error: line 1, no commit waits for its confirmation\n");
    let again = pipe(gateway, "candidate\ncandidate");
    assert!(again.contains("there is a candidate already"), "{again}");
    let wrong = pipe(gateway, "commit never");
    assert!(wrong.contains("column 8: \"never\": expected check, confirmed"), "{wrong}");
    let short = pipe(gateway, "commit confirmed 1s");
    assert!(short.contains("10s to 86400s"), "{short}");
}

#[test]
fn settings_that_changed_meanwhile_are_not_overwritten_unseen() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    typed(SETTINGS);
    typed("save\ncandidate\ndelete routes\nload");
    let said = typed("commit");
    assert!(said.contains("the settings in force have changed: see `diff`"), "{said}");
    assert!(typed("show config").contains("route"));
    assert_eq!(typed("commit"), "in force and saved\n");
    assert!(!typed("show config").contains("route"));
}

#[test]
fn a_commit_that_waits_is_not_saved_and_is_confirmed_or_taken_back() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    typed(SETTINGS);
    typed("save");
    let before = typed("show config");
    let commit = "candidate\ndelete routes\ncommit confirmed 1m";
    assert_eq!(
        typed(commit),
        "in force: commit within 60s confirms it, or the settings from before come back\n"
    );
    assert!(!typed("show config").contains("route"));
    assert!(typed("show candidate").starts_with("# none: a commit waits for its confirmation for another "));
    for command in ["save", "save force", "candidate"] {
        let said = typed(command);
        assert!(
            said.contains("a commit waits for its confirmation: `commit` confirms it"),
            "{command}: {said}"
        );
    }
    assert_eq!(typed("rollback"), "the settings from before are back in force\n");
    assert_eq!(typed("show config"), before);
    assert!(!gateway.has_unsaved());
    let audit = typed("show audit");
    for line in
        ["console         commit confirmed 1m", "- route P1", "console         rollback", "+ route P1"]
    {
        assert!(audit.contains(line), "{line} in {audit}");
    }
    typed(commit);
    assert_eq!(typed("commit"), "in force and saved\n");
    assert!(!gateway.has_unsaved());
    assert!(!core::str::from_utf8(&store.saved).unwrap().contains("route"));
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    assert_eq!(typed("rollback"), "error: line 1, no commit waits for its confirmation\n");
}

#[test]
fn saved_versions_are_listed_and_one_of_them_becomes_the_candidate() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    assert_eq!(typed("versions"), "nothing was saved so far\n");
    assert_eq!(typed("rollback 0"), "error: line 1, there is no such version: see `versions`\n");
    typed(SETTINGS);
    typed("save");
    let first = typed("show config");
    typed("candidate\ndelete routes\ncommit");
    assert_eq!(
        typed("versions"),
        "NO TIME                 LINES     WHO\n \
         0 2026-11-25T21:40:00Z +1 -0     local console\n \
         1 2026-11-25T21:40:00Z +1 -0     local console\n"
    );
    // In place of another candidate, and nothing is in force before the commit.
    let said = typed("candidate\nport other tcp server 1502\nrollback 1\ndiff");
    assert_eq!(
        said,
        "version 1 is the candidate: see `diff`, then `commit`\n\
         + route P502 101-132 192.168.1.0/24 -100 P1 readonly priority high\n\
         + route P502 1-64    * * P1\n\
         + route P1 1-64    * * P502\n"
    );
    assert!(!typed("show config").contains("route"));
    assert_eq!(
        typed("commit confirmed"),
        "in force: commit within 300s confirms it, or the settings from before come back\n"
    );
    let waits = "error: line 1, a commit waits for its confirmation: `commit` confirms it, `rollback` takes it back\n";
    assert_eq!(typed("rollback 1"), waits);
    assert_eq!(typed("commit"), "in force and saved\n");
    assert_eq!(typed("show config"), first);
    assert_eq!(typed("versions").lines().count(), 4);
    assert!(typed("show audit").contains("console         rollback 1"));
    let wrong = typed("rollback yesterday");
    assert!(wrong.contains("column 10: \"yesterday\": expected"), "{wrong}");
}

#[test]
fn a_version_that_cannot_be_read_leaves_the_candidate_alone() {
    let gateway = &new_gateway();
    let mut store = Memory::default();
    store.versions.push(("anna".into(), b"port P1 tcp server 502\nprot P2\n".to_vec()));
    let mut typed = |text: &str| session(gateway, &mut store, Mode::Plain, text, 50);
    typed("candidate\nport P7 tcp server 507");
    let said = typed("rollback 0");
    assert!(said.starts_with("error: line 1, saved settings: line 2, column 1: \"prot\""), "{said}");
    assert_eq!(typed("show candidate"), "port P7 tcp server 507\n");
}
