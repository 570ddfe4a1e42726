//! Mutation testing: `cargo xtask mutation` changes the code in small ways and names the changes that no test notices.
//!
//! All mutants are in one build, each behind a switch that the environment turns (`find`, `weave`, `tree`). Each test runs
//! once to see which mutants it comes by; then a mutant costs only the tests that come by it, the quick ones first, until
//! one fails (`suite`). README.md says how to read what it prints.

use std::collections::HashMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use clap::Parser;

use mutant::Mutant;
use suite::{End, Suite};
use tree::Tree;

mod find;
mod mutant;
mod scope;
mod suite;
mod tree;
mod weave;

/// Share of the mutants that must be noticed.
const TARGET_PERCENT: f64 = 95.0;
/// Places that are woven for each mutant that is drawn: some do not compile.
const WOVEN_FOR_EACH: usize = 2;

/// Changes the code in small ways and names the changes that no test notices.
#[derive(Parser)]
struct Arguments {
    /// How many mutants are drawn; 0 takes all.
    #[arg(long, default_value_t = 300)]
    sample: usize,
    /// Draws another sample.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only mutants whose place (FILE:LINE) begins so; may be given again.
    #[arg(long, value_name = "PLACE")]
    at: Vec<String>,
    /// Fails when so many survive, and not by the score, which says little about a small sample.
    #[arg(long, value_name = "COUNT")]
    fail_at: Option<usize>,
    /// Mutants tried at a time.
    #[arg(long)]
    jobs: Option<usize>,
    /// Names the mutants that would be drawn, and tries none.
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// Whether enough mutants were noticed.
fn run(arguments: &Arguments) -> Result<bool, String> {
    let start = Instant::now();
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let project = package.ancestors().nth(2).ok_or("the package is two folders below the project")?;
    let folder: PathBuf = project.join("target/mutants");
    let mut tree = Tree::new(project, &folder)?;
    let found = tree.mutants();
    let known = mutant::equivalent(&package.join("equivalent.toml"), &found)?;
    let mut drawn: Vec<u32> = (0..found.len() as u32).collect();
    drawn.retain(|&nth| {
        let Mutant { file, line, .. } = &found[nth as usize];
        let place = format!("{file}:{line}:");
        arguments.at.is_empty() || arguments.at.iter().any(|at| place.starts_with(at))
    });
    draw(&mut drawn, arguments.seed, WOVEN_FOR_EACH * arguments.sample);
    tree.keep(&drawn.iter().map(|&nth| found[nth as usize].key()).collect());
    let (all, programs) = tree.build()?;
    let mutant = |id: u32| &all[id as usize - 1];
    let mut drawn: Vec<u32> = (1..=all.len() as u32).collect();
    draw(&mut drawn, arguments.seed, arguments.sample);
    let sample = drawn.len();
    drawn.retain(|&id| !known.contains(&mutant(id).key()));
    println!(
        "{} of {} mutants, seed {}, {} of them equivalent",
        sample,
        found.len(),
        arguments.seed,
        sample - drawn.len()
    );
    if arguments.list {
        drawn.iter().for_each(|&id| println!("{}", mutant(id)));
        return Ok(true);
    }
    let jobs =
        arguments.jobs.or_else(|| std::thread::available_parallelism().ok().map(usize::from)).unwrap_or(1);
    let suite = Suite::new(&programs, &folder, jobs)?;
    println!("{} tests, built and run once in {} s", suite.len(), start.elapsed().as_secs());
    let done = AtomicUsize::new(0);
    let file = folder.join("killers");
    let killers = killers(&file);
    let killer = |id| killers.get(&mutant(id).key()).map(String::as_str);
    let killed = File::options().append(true).create(true).open(&file);
    let killed = Mutex::new(killed.map_err(|error| format!("{}: {error}", file.display()))?);
    let ends = suite.judge(&drawn, killer, |id, end| {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if let End::Killed(test) = end
            && killer(id) != Some(test)
        {
            // Only the next run is slower without it.
            let _ = writeln!(killed.lock().unwrap(), "{test}\t{}", mutant(id).key());
        }
        if let Some(how) = survived(end) {
            println!("{done}: {} survives ({how})", mutant(id));
        }
    });
    report(&drawn.iter().map(|&id| mutant(id)).zip(&ends).collect::<Vec<_>>(), start, arguments.fail_at)
}

/// By mutant, the test that noticed it the last time.
fn killers(file: &Path) -> HashMap<String, String> {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let lines = text.lines().filter_map(|line| line.split_once('\t'));
    lines.map(|(test, mutant)| (mutant.to_owned(), test.to_owned())).collect()
}

fn survived(end: &End) -> Option<String> {
    match end {
        End::Killed(_) => None,
        End::Survived(tests) => Some(format!("{tests} tests pass")),
        End::Unseen => Some("no test comes by".to_owned()),
    }
}

/// Prints the survivors in the order of the source, and the score.
fn report(ends: &[(&Mutant, &End)], start: Instant, fail_at: Option<usize>) -> Result<bool, String> {
    let mut left: Vec<&Mutant> =
        ends.iter().filter(|(_, end)| survived(end).is_some()).map(|(mutant, _)| *mutant).collect();
    left.sort_by_key(|mutant| (&mutant.file, mutant.line));
    println!("\n{} of {} survived:", left.len(), ends.len());
    for mutant in &left {
        println!("{mutant}\n    {}", mutant.source);
    }
    println!("{} mutants in {} s", ends.len(), start.elapsed().as_secs());
    let score = 100.0 * (ends.len() - left.len()) as f64 / ends.len().max(1) as f64;
    let word = |enough| if enough { "ok" } else { "short" };
    if let Some(count) = fail_at {
        let enough = left.len() < count;
        println!("figure mutation_survivors {} of-{} <{count} {}", left.len(), ends.len(), word(enough));
        return Ok(enough);
    }
    let enough = score >= TARGET_PERCENT;
    println!("figure mutation_score {} % >={TARGET_PERCENT} {}", (score * 10.0).round() / 10.0, word(enough));
    Ok(enough)
}

/// Leaves `count` of the items, or all for 0.
fn draw(items: &mut Vec<u32>, seed: u64, count: usize) {
    shuffle(items, seed);
    if count > 0 {
        items.truncate(count);
    }
}

/// Fisher and Yates, with SplitMix64: equal seeds draw equal samples.
fn shuffle(items: &mut [u32], seed: u64) {
    let mut state = seed;
    let mut bits = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    for last in (1..items.len()).rev() {
        items.swap(last, (bits() % (last as u64 + 1)) as usize);
    }
}
