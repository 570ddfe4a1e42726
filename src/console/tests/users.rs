//! Who may do what: log-in over a network, roles, passwords.

mod audit;

use core::net::IpAddr;

use super::*;
use crate::settings::Role;

pub(super) const PEER: IpAddr = IpAddr::V4(core::net::Ipv4Addr::LOCALHOST);

/// A user of each role, named like it, and one without password.
pub(super) fn add_users(gateway: &Gateway<'_>) {
    for role in ["viewer", "operator", "engineer"] {
        assert_eq!(pipe(gateway, &format!("user {role} role {role} password \"{HASH}\"")), "");
    }
    assert_eq!(pipe(gateway, "user nobody role engineer"), "");
}

/// What a session by network prints.
fn network(gateway: &Gateway<'_>, text: &str) -> String {
    session(gateway, &mut Memory::default(), Mode::Network(PEER, None), text, 50)
}

/// What it prints behind the log-in of `user`.
fn as_user(gateway: &Gateway<'_>, user: &str, text: &str) -> String {
    let said = network(gateway, &format!("{user}\nlet me in\n{text}"));
    said.strip_prefix("user: password: ").unwrap_or(&said).into()
}

#[test]
fn nobody_gets_in_by_network_before_a_user_has_a_password() {
    let gateway = &new_gateway();
    let refused =
        "error: nobody can log in yet: at the local console, user NAME role engineer, then password NAME\n";
    assert_eq!(network(gateway, "show version\n"), refused);
    pipe(gateway, "user anna role engineer");
    assert_eq!(network(gateway, "anna\n\nshow version\n"), refused);
    pipe(gateway, "password anna\nlet me in\n");
    assert!(as_user(gateway, "anna", "show version\n").starts_with("mobgate 0."));
}

#[test]
fn a_wrong_name_and_a_wrong_password_are_refused_alike_and_three_end_the_session() {
    let gateway = &new_gateway();
    add_users(gateway);
    for (user, password) in [("viewer", "let me out"), ("else", "let me in"), ("nobody", ""), ("", "")] {
        let said = network(gateway, &format!("{user}\n{password}\n"));
        assert!(said.starts_with("user: password: error: "), "{said}");
        assert!(said.contains("no such user, or another password\nuser: "), "{said}");
        gateway.attempts(|attempts| attempts.succeeded(PEER, user));
    }
    let said = network(gateway, "a\nb\na\nb\na\nb\nviewer\nlet me in\nshow version\n");
    assert_eq!(said.matches("no such user").count(), 3);
    assert!(!said.contains("mobgate"), "{said}");
}

#[test]
fn after_five_failures_a_pause_is_said_and_the_local_console_is_open() {
    let gateway = &new_gateway();
    add_users(gateway);
    network(gateway, "viewer\nx\nviewer\nx\nviewer\nx\n");
    network(gateway, "viewer\nx\nviewer\nx\n");
    let said = network(gateway, "viewer\nlet me in\nshow version\n");
    assert!(said.contains("too many failures: try again in 1s\n"), "{said}");
    assert!(!said.contains("mobgate"), "{said}");
    assert!(pipe(gateway, "show version").starts_with("mobgate 0."));
}

/// The commands that a role may run, besides those of the role before.
const ALLOWED: [(&str, &str); 3] = [
    // Only the web interface and its images explain.
    (
        "viewer",
        if cfg!(feature = "web") { "show explain watch exit help diff" } else { "show watch exit help diff" },
    ),
    ("operator", "ping read write mark begin finish clear"),
    (
        "engineer",
        "port server route device point slave edit insert move delete network mdns syslog ntp certificate \
         publish user scan tune capture password save load update reboot candidate commit rollback versions discard",
    ),
];

#[test]
fn every_command_is_for_the_roles_that_it_declares_and_for_no_other() {
    let gateway = &new_gateway();
    add_users(gateway);
    let mut allowed = Vec::new();
    for (role, more) in ALLOWED {
        allowed.extend(more.split(' '));
        for command in command::commands() {
            // The word behind is none of any command; `reboot` alone would be carried out.
            let said = as_user(gateway, role, &format!("{} )(\n", command.name));
            let refused = said.contains(&format!("needs the role {}; yours is {role}\n", command.role));
            assert_eq!(refused, !allowed.contains(&command.name), "{role}: {said}");
        }
    }
    let all: Vec<_> = command::commands().map(|command| command.name).collect();
    assert_eq!(all.len(), allowed.len(), "each command is listed once: {all:?}");
}

#[test]
fn help_lists_what_the_role_may_run() {
    let gateway = &new_gateway();
    add_users(gateway);
    let commands = |role| {
        let said = as_user(gateway, role, "help\n");
        said.lines().map(|line| line.split(' ').next().unwrap().to_string()).collect::<Vec<_>>()
    };
    assert_eq!(commands("viewer").join(" "), ALLOWED[0].1);
    assert!(commands("operator").contains(&"write".into()) && !commands("operator").contains(&"save".into()));
    assert_eq!(commands("engineer").len(), command::commands().count());
}

#[test]
fn hashes_are_shown_to_engineers_at_the_local_console_and_nowhere_else() {
    let gateway = &new_gateway();
    add_users(gateway);
    let shown = "user viewer role viewer\nuser operator role operator\nuser engineer role engineer\nuser nobody role engineer\n";
    assert_eq!(pipe(gateway, "show config"), shown);
    assert_eq!(as_user(gateway, "engineer", "show config\n"), shown);
    let said = as_user(gateway, "engineer", "show config secrets\n");
    assert!(said.contains("at the local console only") && !said.contains("argon2"), "{said}");
    let secrets = pipe(gateway, "show config secrets");
    assert_eq!(secrets.matches(HASH).count(), 3, "{secrets}");
    // Lines that make the settings, on another gateway too.
    let other = &new_gateway();
    assert_eq!(pipe(other, &secrets), "");
    assert_eq!(pipe(other, "show config secrets"), secrets);
    assert_eq!(
        pipe(gateway, "show users"),
        "NAME            ROLE     PASSWORD              KEYS\n\
         viewer          viewer   set                   0\n\
         operator        operator set                   0\n\
         engineer        engineer set                   0\n\
         nobody          engineer none: cannot log in   0\n"
    );
}

#[test]
fn a_line_without_password_keeps_the_password_and_changes_the_role() {
    let gateway = &new_gateway();
    add_users(gateway);
    pipe(gateway, "user viewer role operator");
    assert!(as_user(gateway, "viewer", "save\n").contains("needs the role engineer; yours is operator"));
    pipe(gateway, "delete user viewer");
    assert!(as_user(gateway, "viewer", "").contains("no such user, or another password"));
    assert!(pipe(gateway, "delete user viewer").contains("\"viewer\": there is no user of this name"));
}

#[test]
fn a_password_is_typed_twice_unseen_and_is_in_no_history() {
    let gateway = &new_gateway();
    pipe(gateway, "user anna role viewer");
    let said = typed(gateway, "password anna\rlet me in\rlet me in\r\x1b[A\x15show users\r");
    assert!(!said.contains("let me"), "{said:?}");
    assert!(said.contains("anna            viewer   set"), "{said}");
    assert!(said.contains("mobgate*> "), "it is not saved yet: {said:?}");
    let said = typed(gateway, "password anna\rlet me in\rlet me out\rshow users\r");
    assert!(said.contains("the passwords differ"), "{said}");
    for (password, good) in
        [("1234567", false), ("12345678", true), (&"x".repeat(64), true), (&"x".repeat(65), false)]
    {
        let said = typed(gateway, &format!("password anna\r{password}\r{password}\r"));
        assert_eq!(said.contains("a password has 8 to 64 characters"), !good, "{password}: {said}");
    }
    assert!(pipe(gateway, "password bert\n").contains("there is no user of this name"));
}

#[test]
fn wrong_lines_of_users_name_what_is_wrong() {
    let gateway = &new_gateway();
    for (line, error) in [
        ("user", "end of line: expected a user's name"),
        ("user anna", "end of line: expected role and viewer, operator or engineer"),
        ("user anna role boss", "\"boss\": expected viewer, operator or engineer"),
        ("user anna role viewer key x", "\"key\": expected password or the end of the line"),
        (
            "user anna role viewer password secret12",
            "\"secret12\": expected a hash as show config secrets prints it",
        ),
        ("user 1a role viewer", "\"1a\": expected a user's name"),
        ("user anna role viewer password", "end of line: expected a hash"),
    ] {
        let said = pipe(gateway, line);
        assert!(said.contains(error), "{line}: {said}");
    }
    let many: String = (0..17).map(|nth| format!("user u{nth} role viewer\n")).collect();
    assert_eq!(
        pipe(gateway, &many),
        "error: line 17, column 6: \"u16\": there are 16 users already, the maximum\n"
    );
}

#[test]
fn roles_grow() {
    assert!(Role::Viewer < Role::Operator && Role::Operator < Role::Engineer);
}

#[cfg(feature = "candidate")] // Without one nothing is refused.
#[test]
fn what_would_cut_off_who_makes_it_needs_to_be_confirmed_and_goes_back() {
    let gateway = &new_gateway();
    add_users(gateway);
    pipe(gateway, "port access tcp server 502 allow 127.0.0.0/8");
    let by_port = |text: &str| {
        let port = gateway.settings(|settings| settings.find("access"));
        let text = format!("engineer\nlet me in\n{text}");
        session(gateway, &mut Memory::default(), Mode::Network(PEER, port), &text, 50)
    };
    let key = "key ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GKJl";
    pipe(gateway, &format!("user engineer {key}"));
    let other = format!("user engineer role engineer password \"{}\"", HASH.replace("fA", "fB"));
    for (line, why) in [
        ("delete user engineer", "your user is gone"),
        ("user engineer role operator", "your role is a lower one"),
        (&other, "your password is another"),
        (&format!("delete user engineer {key}"), "a key of yours is gone"),
        ("delete port access", "no port is where you came in"),
        ("edit port access listen 503", "no port is where you came in"),
        ("edit port access allow 10.0.0.0/8", "your address may not use the port any more"),
    ] {
        let before = pipe(gateway, "show config secrets");
        let said = by_port(line);
        let direct = "; `candidate`, the change, then `commit confirmed 5m` can be taken back\n";
        assert!(
            said.contains(&format!("error: line 1, this would cut you off: {why}{direct}")),
            "{line}: {said}"
        );
        let said = by_port(&format!("candidate\n{line}\ncommit"));
        let hint = "; `commit confirmed 5m` can be taken back\n";
        assert!(
            said.contains(&format!("error: line 3, this would cut you off: {why}{hint}")),
            "{line}: {said}"
        );
        assert_eq!(pipe(gateway, "show config secrets"), before, "{line}");
        let said = by_port("commit confirmed 5m");
        assert!(said.contains("in force: commit within"), "{line}: {said}");
        assert_ne!(pipe(gateway, "show config secrets"), before, "{line}");
        pipe(gateway, "rollback");
        assert_eq!(pipe(gateway, "show config secrets"), before, "{line}");
    }
    // The local console may, and so may who is not concerned.
    assert!(!by_port("delete user viewer\nport other tcp server 504").contains("error"));
    assert_eq!(pipe(gateway, "delete user engineer"), "");
}
