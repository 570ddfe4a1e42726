//! Any settings file, as somebody might have written it.

use super::{HASH, KEY};
use crate::settings::parse;

/// Numbers from a seed.
pub(super) struct Dice(pub(super) u64);

impl Dice {
    pub(super) fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % count
    }

    pub(super) fn of<'a>(&mut self, words: &[&'a str]) -> &'a str {
        words[self.below(words.len())]
    }
}

/// Lines that make settings: of few names, so that two such texts have much in common.
pub(super) fn settings_lines(dice: &mut Dice) -> Vec<String> {
    let mut lines = vec![dice.of(&["mdns on", "mdns off", "mdns on name hall"]).to_owned()];
    for name in ["anna", "Bert"] {
        if dice.below(3) == 0 {
            let password = dice.of(&["", &format!(" password {HASH}")]).to_owned();
            lines.push(format!("user {name} role {}{password}", dice.of(&["viewer", "engineer"])));
            let keys = ["Jl", "Jm", "jl"].into_iter().filter(|_| dice.below(2) == 0);
            lines.extend(keys.map(|end| format!("user {name} key ssh-ed25519 {KEY}{end}")));
        }
    }
    if dice.below(3) == 0 {
        lines.push(format!("syslog {}", dice.of(&["10.0.0.9", "tcp logs.example:601"])));
    }
    if dice.below(3) == 0 {
        lines.push(format!("ntp {}", dice.of(&["10.0.0.1", "time.example:1123"])));
    }
    let names: Vec<_> =
        ["P1", "P2", "bus", "plc", "gate"].into_iter().enumerate().filter(|_| dice.below(4) > 0).collect();
    for (n, name) in &names {
        let options = dice.of(&["", "", " retries 1", " timeout 300ms late-window 2s"]);
        lines.push(match dice.below(3) {
            0 => format!(
                "port {name} serial uart{n} rtu client {}{options}",
                dice.of(&["", "9600", "9600 8N1"])
            ),
            1 => format!("port {name} tcp client 10.0.0.{n}{options}"),
            _ => format!("port {name} tcp server {}{}", 500 + n, dice.of(&["", " idle 5s", " rtu"])),
        });
    }
    let servers: Vec<_> = lines.iter().filter(|line| line.contains("server")).cloned().collect();
    for _ in 0..dice.below(8) {
        if let (false, Some((_, to))) = (servers.is_empty(), names.get(dice.below(names.len().max(1)))) {
            let from = servers[dice.below(servers.len())].split(' ').nth(1).unwrap().to_owned();
            let to = if from == *to { "local" } else { to };
            lines.push(format!("route {from} {} * * {to}", 1 + dice.below(5)));
        }
    }
    if dice.below(2) == 0 {
        lines.push("port scan scanner".into());
        for n in 0..1 + dice.below(2) {
            lines.push(format!(
                "device d{n} unit {}{}",
                1 + dice.below(2),
                dice.of(&["", " label \"a # b, c\""])
            ));
            for m in 0..dice.below(3) {
                lines.push(format!(
                    "point p{n}{m} d{n} {}{}",
                    dice.of(&["40001", "coil 7"]),
                    dice.of(&["", " count 2"])
                ));
            }
        }
    }
    lines
}

/// Such lines as somebody would have written them: with comments and blank lines, in any order that can be read.
pub(super) fn file(dice: &mut Dice, lines: Vec<String>) -> String {
    let (mut text, mut waiting, mut n) = (String::new(), lines, 0);
    let end = dice.of(&["\n", "\n", "\r\n"]);
    while !waiting.is_empty() {
        // One that does not need what is still waiting: a line before which all is in order.
        let good = |at: usize| parse(&format!("{text}{}{end}", waiting[at])).is_ok();
        let ready: Vec<_> = (0..waiting.len()).filter(|at| good(*at)).collect();
        // Rules that are there twice are left out.
        let Some(&at) = ready.get(dice.below(ready.len().max(1))) else { break };
        let line = waiting.remove(at);
        n += 1;
        for _ in 0..dice.below(3) {
            text += dice.of(&["", "   ", "# a comment", "  # port P1 tcp server 1", "#"]);
            text += &format!(
                "{}{end}",
                if text.ends_with(['#', 't', '1']) { n.to_string() } else { String::new() }
            );
        }
        text += &line.replacen(' ', dice.of(&[" ", "  ", "\t"]), 1);
        text += &format!("{}{end}", dice.of(&["", "", "   # behind"]));
    }
    text
}
