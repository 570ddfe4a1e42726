//! The audit trail: who changed what, from where; and sessions of users who are changed meanwhile.

use core::net::SocketAddr;

use embassy_time::Instant;

use super::*;
use crate::gateway::audit::Stamp;
use crate::gateway::date::Date;
use crate::hal::{OpenError, OpenErrorKind};
use crate::settings::ServerAddress;

/// Who and what, of all lines.
fn trail(gateway: &Gateway<'_>) -> Vec<String> {
    let lines = (0..).map_while(|nth| gateway.audit_line(nth));
    lines.map(|line| format!("{}: {}", line.actor(), line.what())).collect()
}

#[test]
fn changes_are_told_with_who_made_them_and_where() {
    let gateway = &new_gateway();
    add_users(gateway);
    let before = trail(gateway).len();
    pipe(
        gateway,
        "port P1 serial uart1 rtu client # by hand\nport P1 serial uart1 rtu client\nshow ports\nsave\n",
    );
    network(
        gateway,
        "engineer\nlet me in\nport P502 tcp server 502\nroute P502 1,2 * * P1\nwrite 1 holding 4 5 via P9\nclear log",
    );
    assert_eq!(
        trail(gateway)[before..],
        [
            "local console: port P1 serial uart1 rtu client",
            "local console: save",
            "engineer@127.0.0.1: logged in as engineer",
            "engineer@127.0.0.1: port P502 tcp server 502",
            "engineer@127.0.0.1: clear log",
        ],
        "what changes nothing, and what was refused, is no change"
    );
}

#[test]
fn no_secret_and_no_text_that_may_be_one_is_told() {
    let gateway = &new_gateway();
    add_users(gateway);
    pipe(
        gateway,
        &format!(
            "USER anna role viewer password \"{HASH}\" # hunter2\nhunter2\npassword hunter2\nwrite hunter2"
        ),
    );
    typed(gateway, "password anna\rlet me in\rlet me in\r");
    // The password at the wrong prompt.
    network(gateway, "hunter2\nanna\nviewer\nhunter2\nanna\nlet me out\n");
    network(gateway, "hunter2-hunter2-hunter2\nx\nviewer\nlet me in\nhunter2\nsave hunter2\n");
    let mut saved =
        Memory { saved: format!("user bert role viewer password \"{HASH}\"").into(), ..Memory::default() };
    session(gateway, &mut saved, Mode::Plain, "load", 50);
    let trail = trail(gateway);
    for line in [
        "USER anna role viewer password",
        "password anna",
        "a wrong password for an unknown user",
        "a wrong password for viewer",
    ] {
        assert!(trail.iter().any(|told| told.ends_with(line)), "{line}: {trail:?}");
    }
    assert!(trail.iter().any(|line| line == "local console: + user bert role viewer"), "{trail:?}");
    for secret in ["hunter2", "let me", "argon2"] {
        assert!(!trail.iter().any(|line| line.contains(secret)), "{secret}: {trail:?}");
        assert!(!pipe(gateway, "show audit").contains(secret));
    }
}

#[test]
fn loading_tells_the_lines_that_differ() {
    let gateway = &new_gateway();
    pipe(gateway, SETTINGS);
    let before = trail(gateway).len();
    let other = SETTINGS.replace("9600 8N1", "19200 8E1") + "port longername tcp server 1502\n";
    let mut saved = Memory { saved: other.into(), ..Memory::default() };
    assert_eq!(session(gateway, &mut saved, Mode::Plain, "load", 50), "loaded\n");
    let told = trail(gateway);
    assert_eq!(told.len() - before, 3, "{told:?}");
    assert!(
        told[before].starts_with("local console: - port P1") && told[before].contains("9600 8N1"),
        "{told:?}"
    );
    assert!(
        told[before + 1].starts_with("local console: + port P1") && told[before + 1].contains("19200 8E1")
    );
    assert!(told[before + 2].contains("+ port longername tcp server 1502"));
    let moved: Vec<_> = other_order(SETTINGS);
    let mut saved = Memory { saved: moved.concat().into(), ..Memory::default() };
    session(gateway, &mut saved, Mode::Plain, "load\nload", 50);
    let told = trail(gateway);
    let expected =
        ["local console: - route P502 1-64    * * P1", "local console: + route P502 1-64    * * P1"];
    assert_eq!(told[before + 3..], expected, "told once: {told:?}");
}

/// The lines with the last two rules exchanged, and without those that [`loading_tells_the_lines_that_differ`] has added.
fn other_order(text: &str) -> Vec<String> {
    let mut lines: Vec<_> =
        text.replace("9600 8N1", "19200 8E1").lines().map(|line| format!("{line}\n")).collect();
    let last = lines.len() - 1;
    lines.swap(last, last - 1);
    lines.push("port longername tcp server 1502\n".into());
    lines
}

#[test]
fn the_trail_is_shown_to_engineers_with_uptimes_where_there_is_no_calendar() {
    let gateway = &new_gateway();
    add_users(gateway);
    let said = network(gateway, "operator\nlet me in\nshow audit\nsave\n");
    assert!(said.contains("error: line 1, needs the role engineer; yours is operator"), "{said}");
    let said = network(gateway, "engineer\nlet me in\nsyslog 192.168.1.9\nshow audit\n");
    let rows: Vec<&str> = said.lines().collect();
    assert_eq!(rows[0], "user: password: TIME                 WHO                   WHAT");
    let of_viewer =
        |row: &str| row.starts_with("up ") && row.contains("local console         user viewer role viewer");
    assert!(rows.iter().any(|row| of_viewer(row)), "{said}");
    assert!(
        rows.iter().any(|row| row.contains("127.0.0.1             save is denied to the role operator")),
        "{said}"
    );
    assert_eq!(
        rows.last().unwrap(),
        &"-                    syslog                udp 192.168.1.9:514: off; last sent 0, 0 lost"
    );
}

#[test]
fn what_others_cause_at_will_is_told_some_times_and_then_counted() {
    let gateway = &new_gateway();
    add_users(gateway);
    let before = trail(gateway).len();
    for nth in 0..100_u32 {
        let address = std::net::IpAddr::from([10, 0, (nth / 200) as u8, nth as u8]);
        session(gateway, &mut Memory::default(), Mode::Network(address, None), "viewer\nx\nx\ny\n", 50);
    }
    let told = trail(gateway);
    assert_eq!(told.len() - before, 4, "{told:?}");
    assert_eq!(told[before], "10.0.0.0: a wrong password for viewer");
    assert_eq!(told[before + 1], "10.0.0.0: a wrong password for an unknown user");
}

#[test]
fn a_session_has_the_role_that_its_user_has_by_now_and_ends_with_him() {
    let gateway = &new_gateway();
    add_users(gateway);
    let after = |line: &str, more: &str| {
        // What cuts off who makes it must be confirmed where that is possible.
        let lines = match cfg!(feature = "candidate") {
            true => format!("candidate\n{line}\ncommit confirmed"),
            false => line.to_string(),
        };
        network(gateway, &format!("engineer\nlet me in\n{lines}\n{more}"))
    };
    let said = after("user engineer role operator", "mdns off\nclear log\nexit\n");
    assert_eq!(said.matches("error").count(), 1, "{said}");
    assert!(said.contains("needs the role engineer; yours is operator"), "{said}");
    assert!(!pipe(gateway, "show config").contains("mdns off"));
    pipe(gateway, "rollback\nuser engineer role engineer");
    let said = after("delete user engineer", "mdns off\nshow version\n");
    assert!(said.contains("this user was deleted"), "{said}");
    assert!(!said.contains("mobgate"), "nothing behind it is carried out: {said}");
    assert!(!pipe(gateway, "show config").contains("mdns off"));
}

#[test]
fn who_is_no_engineer_any_more_sets_no_password_that_was_asked_for() {
    let gateway = &new_gateway();
    add_users(gateway);
    // The text of a network is not typed twice; the change comes between command and password.
    let role =
        || block_on(crate::gateway::reconfigure::change(gateway, "user engineer role viewer", &|_| Ok(())));
    let bench = Bench::default();
    let mut shell = Shell::new(gateway, &bench, Mode::Network(PEER, None));
    shell.session.user = "engineer".try_into().unwrap();
    shell.session.role = crate::settings::Role::Engineer;
    shell.session.asks = crate::console::asks::Asks::New("viewer".try_into().unwrap());
    role().unwrap();
    let mut wait = shell.start();
    for byte in b"other password\n" {
        wait = shell.step(WaitEvent::Key(*byte));
    }
    assert!(!matches!(wait, Wait::Password), "{wait:?}");
    assert!(shell.session.out.text.contains("needs the role engineer"), "{}", shell.session.out.text);
}

#[test]
fn a_syslog_server_is_set_printed_and_deleted() {
    let gateway = &new_gateway();
    for (line, shown) in [
        ("syslog 10.0.0.9", "syslog udp 10.0.0.9:514\n"),
        ("syslog udp 10.0.0.9:1514", "syslog udp 10.0.0.9:1514\n"),
        ("syslog TCP logs.example:601", "syslog tcp logs.example:601\n"),
        ("syslog tcp [fe80::1]", ""),
        ("syslog off", ""),
    ] {
        let refused = pipe(gateway, line).contains("error");
        assert_eq!(refused, line.contains('['), "{line}");
        if !refused {
            assert_eq!(pipe(gateway, "show config"), shown, "{line}");
            assert_eq!(pipe(gateway, shown), "");
            assert_eq!(pipe(gateway, "show config"), shown, "{line}");
        }
    }
    for (line, error) in [
        ("syslog", "end of line: expected the address of a server"),
        ("syslog tcp", "end of line: expected the address of a server"),
        ("syslog off now", "\"now\": expected the end of the line"),
    ] {
        let said = pipe(gateway, line);
        assert!(said.contains(error), "{line}: {said}");
    }
}

#[test]
fn lines_of_before_a_reset_are_shown_as_such_and_only_once_sent() {
    let memory = kept(AuditMemory::new());
    let (first, second) =
        ("start of mobgate 0.1.0, started by power", "start of mobgate 0.1.0, started by the watchdog");
    {
        let gateway = &gateway_with(memory);
        gateway.audit_start("started by power", None);
        pipe(gateway, "mdns off");
        gateway.change_forwarding(|forwarding| forwarding.sent = 1);
    }
    {
        let gateway = &gateway_with(memory);
        gateway.audit_start("started by the watchdog", Some("the console stood still"));
        let shown = pipe(gateway, "show audit");
        let rows: Vec<String> = shown
            .lines()
            .skip(1)
            .map(|row| row.split_whitespace().skip(2).collect::<Vec<_>>().join(" "))
            .collect();
        let expected = [first, "local console mdns off", "above: before the last start", second];
        assert!(
            rows.iter().zip(expected).all(|(row, end)| row.ends_with(end) || end.ends_with(row)),
            "{shown}"
        );
        assert_eq!(rows.len(), 5, "{shown}");
        assert!(rows[4].contains("the last run ended: the console stood still"), "{shown}");
        assert_eq!(gateway.forwarding().sent, 1, "the next line that a server gets is the second");
        assert_eq!(gateway.audit_line(2).map(|line| line.number), Some(3), "numbers go on");
    }
}

#[test]
fn once_the_time_is_known_the_lines_of_this_run_have_dates_and_earlier_ones_keep_theirs() {
    let (memory, server) =
        (kept(AuditMemory::new()), ServerAddress::from(SocketAddr::from(([10, 0, 0, 1], 123))));
    let noon = Date(1_795_694_400_000_000);
    {
        let gateway = &gateway_with(memory);
        gateway.audit_start("one", None);
        assert!(gateway.date(Instant::now()).is_none());
        gateway.set_time(&server, Err(OpenError::new(OpenErrorKind::TimedOut, "")));
        assert!(gateway.date(Instant::now()).is_none());
        gateway.set_time(&server, Ok((noon, Instant::now())));
        let version = pipe(gateway, "show version");
        assert!(version.trim_end().ends_with(", 2026-11-26T12:00:00Z by 10.0.0.1:123"), "{version}");
        pipe(gateway, "mdns off");
    }
    {
        let gateway = &gateway_with(memory);
        gateway.audit_start("two", None);
        let stamps = (0..).map_while(|nth| gateway.audit_line(nth)).map(|line| line.stamp);
        let dated: Vec<bool> = stamps
            .map(|stamp| matches!(stamp, Stamp::Date(date) if date <= noon || date.0 - noon.0 < 60_000_000))
            .collect();
        assert_eq!(dated, [true, true, false], "the first line was written before the time was known");
    }
}
