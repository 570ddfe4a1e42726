//! What `help` says, and where words of other consoles lead.

use super::*;

#[test]
fn help_is_given_for_all_and_for_one() {
    let gateway = &new_gateway();
    let overview = pipe(gateway, "help");
    for command in command::commands().filter(|command| command.exists) {
        let line = overview.lines().find(|line| line.split(' ').next() == Some(command.name));
        assert!(line.is_some_and(|line| line.contains("  ") || line.len() > 30), "{}", command.name);
        let all = pipe(gateway, &format!("help {}", command.name));
        assert!(all.starts_with(command.name), "{all}");
        assert_eq!(all, pipe(gateway, &format!("{} ?", command.name)));
    }
    assert!(pipe(gateway, "help route").contains("route SOURCE UNITS IP TAG DESTINATION"));
    assert!(pipe(gateway, "help show").contains("config"));
    assert!(pipe(gateway, "help hepl").contains("did you mean help?"));
}

#[test]
fn every_line_of_help_fits_into_eighty_columns() {
    let gateway = &new_gateway();
    let all: String = command::commands().map(|command| format!("help {}\n", command.name)).collect();
    for line in pipe(gateway, &(all + "help\n")).lines() {
        assert!(line.len() <= 80, "{}: {line}", line.len());
    }
}

#[test]
fn words_of_other_consoles_lead_on() {
    let gateway = &new_gateway();
    for (typed, meant) in [
        ("?", "help"),
        ("quit", "exit"),
        ("ls", "show config"),
        ("status", "show ports"),
        ("show run", "config"),
        ("undo", "load"),
    ] {
        let said = pipe(gateway, typed);
        assert!(said.contains(&format!("did you mean {meant}")), "{typed}: {said}");
    }
}
