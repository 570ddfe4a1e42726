//! The images with users and the audit trail.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, CONSOLE, Machine, Network, Reset, Uart};

use crate::network::STATION;
use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(
    a_user_is_made_at_the_local_console_and_no_line_tells_the_password,
    a_password_without_random_numbers_is_refused,
    the_trail_says_who_when_and_outlives_a_reset_with_its_reason,
    a_factory_reset_mends_a_lost_password_and_stands_in_the_trail,
    a_syslog_server_gets_the_lines_and_an_ntp_server_tells_their_time,
    the_stack_has_room_for_a_password
);

/// 2027-03-04T05:06:07Z, as `date -u -d @1804136767` says, from 1900 (RFC 4330, 3).
const NOW: u64 = 1_804_136_767 + 2_208_988_800;
/// Longest time for a hash, which the emulator does not hurry.
const HASHED: Duration = Duration::from_secs(5);

/// Types a new password for `user`, twice; returns what the terminal shows.
fn type_password(machine: &mut Machine, user: &str) -> String {
    let typed = format!("password {user}\rlet me in\rlet me in\r");
    machine.send(Uart::Console, typed.as_bytes(), CONSOLE);
    machine.wait_for_prompt(HASHED).unwrap()
}

/// The rows of `show audit`, without their times, which are those since the start.
fn trail(machine: &mut Machine) -> Vec<String> {
    let shown = machine.type_line("show audit").unwrap();
    let mut rows = Vec::<String>::new();
    for line in shown.lines().skip(1).filter(|line| !line.trim().is_empty()) {
        let words: Vec<&str> = line.split_whitespace().collect();
        match (&words[..], rows.last_mut()) {
            // What is wider than the terminal goes on below.
            (words, Some(row)) if line.starts_with(' ') => *row += &format!(" {}", words.join(" ")),
            (["up", _, what @ ..] | ["-", what @ ..], _) => rows.push(what.join(" ")),
            (words, _) => rows.push(words.join(" ")),
        }
    }
    rows
}

fn a_user_is_made_at_the_local_console_and_no_line_tells_the_password(board: Board) {
    let mut machine = started(board.with_users());
    set_up(&mut machine, &["user anna role operator", "user bert role viewer"]);
    type_password(&mut machine, "anna");
    type_password(&mut machine, "bert");
    let secrets = machine.type_line("show config secrets").unwrap();
    let hash = |user: &str| {
        let (_, behind) = secrets.split_once(&format!("user {user} role ")).unwrap();
        let (_, hash) = behind.split_once(" password \"").unwrap();
        hash.split_once('"').unwrap().0.to_owned()
    };
    assert!(hash("anna").starts_with("$argon2id$v=19$m=32,t=16,p=1$"), "{secrets}");
    assert_ne!(hash("anna"), hash("bert"), "each has a salt of its own");
    let mut shown = String::new();
    for line in ["show users", "show config", "show audit", "show log"] {
        shown += &machine.type_line(line).unwrap();
    }
    assert!(shown.contains("password anna") && shown.contains("bert"), "{shown}");
    assert!(!shown.contains("argon2") && !shown.contains("let me"), "{shown}");
}

fn a_password_without_random_numbers_is_refused(board: Board) {
    let mut machine = started(board.with_users());
    set_up(&mut machine, &["user anna role operator"]);
    machine.spoil_noise(true);
    let refused = type_password(&mut machine, "anna");
    assert!(refused.contains("no random numbers"), "{refused}");
    assert!(!machine.type_line("show config secrets").unwrap().contains("argon2"));
    machine.spoil_noise(false);
    type_password(&mut machine, "anna");
    assert!(machine.type_line("show config secrets").unwrap().contains("argon2"));
}

fn the_trail_says_who_when_and_outlives_a_reset_with_its_reason(board: Board) {
    let mut machine = started(board.with_users());
    let by_power = "system start of mobgate 0.1.0, started by power";
    assert_eq!(trail(&mut machine), [by_power]);
    set_up(&mut machine, &["mdns off"]);
    let shown = machine.type_line("show audit").unwrap();
    let seconds = machine.now().as_secs();
    let when = [format!("up {}s", seconds - 1), format!("up {seconds}s")];
    let change = shown.lines().find(|line| line.ends_with("mdns off")).unwrap();
    assert!(when.iter().any(|when| change.contains(when)), "{change:?} at {when:?}");
    machine.type_line("reboot").unwrap();
    let by_reboot = "system start of mobgate 0.1.0, started by reboot or after a fault";
    let resumed = "gateway above: before the last start";
    let mut expected = vec![by_power, "local console mdns off", "local console reboot", resumed, by_reboot];
    assert_eq!(trail(&mut machine), expected);

    machine.mislead(0x6000_0000);
    wait_for_prompt(&mut machine);
    assert_eq!(machine.resets, [Reset::Software; 2]);
    expected.retain(|row| *row != resumed);
    expected.extend([resumed, by_reboot]);
    let rows = trail(&mut machine);
    let (last, before) = rows.split_last().unwrap();
    assert_eq!(before, expected);
    assert!(last.starts_with("system the last run ended: fault 0x00000100 at 0x60000000"), "{last}");

    machine.power_cycle();
    wait_for_prompt(&mut machine);
    assert_eq!(trail(&mut machine), [by_power], "the power was off");
}

fn a_factory_reset_mends_a_lost_password_and_stands_in_the_trail(board: Board) {
    let mut machine = started(board.with_users());
    set_up(&mut machine, &["user anna role engineer"]);
    type_password(&mut machine, "anna");
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    machine.press_button(true);
    machine.send(Uart::Console, b"reboot\r", CONSOLE);
    // It is held for five seconds.
    machine.run(Duration::from_secs(6)).unwrap();
    machine.press_button(false);
    wait_for_prompt(&mut machine);
    assert!(!machine.type_line("show users").unwrap().contains("anna"));
    let rows = trail(&mut machine);
    assert!(rows.contains(&"local console password anna".to_owned()), "{rows:?}");
    let last = rows.last().map(String::as_str);
    assert_eq!(last, Some("system settings forgotten, because the button was held"));
    // And for good.
    machine.type_line("reboot").unwrap();
    assert!(!machine.type_line("show users").unwrap().contains("anna"));
    set_up(&mut machine, &["user anna role engineer"]);
    type_password(&mut machine, "anna");
    assert!(machine.type_line("show config secrets").unwrap().contains("user anna role engineer password"));
}

fn a_syslog_server_gets_the_lines_and_an_ntp_server_tells_their_time(board: Board) {
    let mut machine = started(board.with_users());
    let mut network = Network::new(STATION);
    let [syslog, ntp] = [514, 123].map(|port| network.datagrams(port));
    set_up(&mut machine, &["network address 192.168.7.2/24", "ntp 192.168.7.1", "syslog 192.168.7.1"]);
    let (mut lines, mut asked) = (Vec::new(), 0);
    let served = network.run(&mut machine, Duration::from_secs(20), |network| {
        if let Some((question, from)) = network.receive_datagram(ntp) {
            assert_eq!((question.len(), question[0] & 7), (48, 3), "a client's question");
            asked += 1;
            network.send_datagram(ntp, &time_response(&question), from);
        }
        lines.extend(network.receive_datagram(syslog).map(|(line, _)| String::from_utf8(line).unwrap()));
        asked > 0 && lines.len() >= 4
    });
    assert!(served.unwrap(), "{asked} questions, {lines:#?}");
    assert!(
        lines[0].contains("sequenceId=\"1\"] system: start of mobgate 0.1.0, started by power"),
        "{lines:#?}"
    );
    assert!(lines.iter().any(|line| line.ends_with("local console: ntp 192.168.7.1")), "{lines:#?}");
    let version = machine.type_line("show version").unwrap();
    assert!(version.contains(", 2027-03-04T05:06:"), "{version}");
    let shown = machine.type_line("show audit").unwrap();
    assert!(shown.lines().nth(1).is_some_and(|line| line.starts_with("2027-03-04T05:0")), "{shown}");
}

/// A response with [`NOW`] (RFC 4330, 5): version 4, server, stratum 2.
fn time_response(question: &[u8]) -> [u8; 48] {
    let now = (NOW << 32).to_be_bytes();
    let mut response = [0; 48];
    response[..4].copy_from_slice(&[4 << 3 | 4, 2, 6, 0xec]);
    response[24..32].copy_from_slice(&question[40..48]);
    response[32..40].copy_from_slice(&now);
    response[40..48].copy_from_slice(&now);
    response
}

fn the_stack_has_room_for_a_password(board: Board) {
    let mut machine = started(board.with_users());
    set_up(&mut machine, &["user anna role operator"]);
    type_password(&mut machine, "anna");
    machine.type_line("save").unwrap();
    let (free, all) = machine.stack_free();
    println!("{} with users: {} of {all} bytes of the stack were used", board.name, all - free);
    assert!(free >= crate::memory::ROOM_BYTES, "{free} of {all}");
}
