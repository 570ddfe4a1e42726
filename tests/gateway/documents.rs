//! The documents' console sessions are played at a simulated gateway, and their settings for boards are read by it.
//!
//! What a session prints is compared line by line; `...` stands for any lines.

use std::path::Path;

use mobgate::settings::{LineSettings, Parity};
use mobgate_simulator::device;

use blocks::{Block, blocks};

use crate::prelude::*;

mod blocks;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn sessions_print_what_the_documents_say() {
    let wrong: Vec<String> =
        blocks(root(), "console").iter().filter_map(|block| played(block).err()).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn settings_of_boards_are_good() {
    for Block { place, with, lines, .. } in blocks(root(), "settings board") {
        let settings = [with, lines].concat().join("\n");
        println!("{place}");
        let size = Size { owns_network: true, ..Size::default() };
        rig::with_gateway_of(size, 1, &settings, |_, _| ());
    }
}

/// The page tells what to do about each kind of error, as docs/troubleshooting.md does, and no other.
#[test]
fn the_page_has_a_remedy_for_each_error_of_the_table() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap();
    let (guide, texts) = (read("docs/troubleshooting.md"), read("src/web/page/texts.js"));
    let table = guide.split("| `show units` | cause |").nth(1).unwrap().split("\n\n").next().unwrap();
    // The first cell: kinds between backquotes.
    let kinds = table.lines().filter_map(|row| row.split('|').nth(1));
    let mut kinds: Vec<&str> = kinds.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    let fixes = texts.split("  fixes: {\n").nth(1).unwrap().split("\n  },").next().unwrap();
    let mut fixes: Vec<&str> =
        fixes.lines().map(|line| line.split_once(": ").unwrap().0.trim().trim_matches('"')).collect();
    kinds.sort_unstable();
    kinds.dedup();
    fixes.sort_unstable();
    assert_eq!(kinds, fixes);
}

/// What a line that is typed begins with.
const PROMPTS: [&str; 3] = ["mobgate> ", "mobgate*> ", "mobgate(candidate)> "];

/// Plays a session; an error shows what was printed.
fn played(block: &Block) -> Result<(), String> {
    let (units, settings): (Vec<&String>, _) = block.with.iter().partition(|line| line.starts_with("units "));
    let settings: String = settings.iter().flat_map(|line| [line, "\n"]).collect();
    rig::with_gateway(1, &settings, |world, rig| {
        units.iter().for_each(|line| attach(world, rig, line));
        let mut lines = block.lines.iter().map(String::as_str).peekable();
        while let Some(line) = lines.next() {
            let (_, command) =
                line.split_once("> ").unwrap_or_else(|| panic!("{}: no prompt: {line}", block.place));
            let mut expected = Vec::new();
            let is_prompt = |line: &str| PROMPTS.iter().any(|prompt| line.starts_with(prompt));
            while let Some(line) = lines.next_if(|line| !is_prompt(line)) {
                expected.push(line);
            }
            let printed = world.run_until(typed(rig.gateway, command));
            let printed: Vec<&str> = printed.lines().map(str::trim_end).collect();
            if !fits(&expected, &printed) {
                return Err(format!("{}: {command}\n{}", block.place, printed.join("\n")));
            }
        }
        Ok(())
    })
}

/// `units 3 7 on /dev/ttyUSB0 9600 8N1`, and perhaps `late about 8ms`: exponentially, with this mean.
fn attach<'g>(world: &World<'g>, rig: &Rig<'g>, line: &str) {
    let (line, late) =
        line.split_once(" late about ").map_or((line, None), |(line, late)| (line, Some(late)));
    let mut faults = Faults::new(1);
    if let Some(ms) = late.and_then(|late| late.strip_suffix("ms")) {
        faults = faults.with(When::Always, Fault::Lingers(Duration::from_millis(ms.parse().unwrap())));
    }
    let words: Vec<&str> = line.split_whitespace().collect();
    let ["units", ids @ .., "on", wire, baud, format] = &words[..] else { panic!("{line}") };
    let parity = match format.as_bytes() {
        b"8E1" => Parity::Even,
        b"8N1" => Parity::None,
        _ => panic!("{line}"),
    };
    let line = LineSettings { baud: baud.parse().unwrap(), parity, ..LineSettings::DEFAULT };
    let devices = ids.iter().map(|id| Device::new(id.parse().unwrap()).with_faults(faults.clone())).collect();
    world.spawn(device::serve(rig.wire(wire).tap(line), devices));
}

fn fits(expected: &[&str], printed: &[&str]) -> bool {
    match expected {
        [] => printed.is_empty(),
        ["...", rest @ ..] => (0..=printed.len()).any(|skipped| fits(rest, &printed[skipped..])),
        [line, rest @ ..] => {
            printed.split_first().is_some_and(|(first, others)| first == line && fits(rest, others))
        }
    }
}
