//! The tests: which mutants each comes by, and whether one of them notices a mutant.
//!
//! Each test runs in a process of its own, so that one which hangs or spoils its process ends alone.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::scope::{ENVIRONMENT, LEFT_OUT};
use crate::tree::Program;

/// A test may take so many times what it takes without a mutant, and so many seconds besides: of the processor, since a
/// busy machine makes nothing else slower; and of the clock, for one that waits for ever.
const SLOWER: u64 = 10;
const SECONDS: u64 = 5;
const SECONDS_OF_THE_CLOCK: u64 = 60;
/// What a test may take of the memory.
const KIB: u64 = 4 << 20;

#[derive(Debug)]
pub(crate) struct Test {
    program: PathBuf,
    folder: PathBuf,
    pub(crate) name: String,
    /// How long it takes without a mutant.
    duration: Duration,
    /// The mutants it comes by, sorted.
    seen: Vec<u32>,
}

/// All tests, the quick ones first.
pub(crate) struct Suite {
    tests: Vec<Test>,
    jobs: usize,
}

/// How a mutant ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    /// This test failed.
    Killed(String),
    /// None of so many failed.
    Survived(usize),
    /// No test comes by.
    Unseen,
}

impl Suite {
    /// Runs all tests once, without a mutant. Those that fail are named and left out.
    pub(crate) fn new(programs: &[Program], folder: &Path, jobs: usize) -> Result<Self, String> {
        let mut tests = Vec::new();
        for program in programs {
            tests.extend(names(program)?.into_iter().map(|name| Test {
                program: program.path.clone(),
                folder: program.folder.clone(),
                name,
                duration: Duration::ZERO,
                seen: Vec::new(),
            }));
        }
        let tests: Vec<Mutex<Test>> = tests.into_iter().map(Mutex::new).collect();
        let scratch = |index: usize| folder.join(format!("seen-{index}"));
        in_parallel(jobs, tests.len(), |index| {
            let mut test = tests[index].lock().unwrap();
            let file = scratch(index);
            let _ = std::fs::remove_file(&file);
            let start = Instant::now();
            let passed = test.run(&[("MUTANTS_SEEN", file.to_string_lossy().into_owned())]);
            test.duration = start.elapsed();
            let seen = std::fs::read_to_string(&file).unwrap_or_default();
            let _ = std::fs::remove_file(&file);
            test.seen = seen.lines().filter_map(|line| line.parse().ok()).collect();
            test.seen.sort_unstable();
            if !passed {
                println!("left out, since it fails without a mutant: {}", test.name);
                test.seen.clear();
            }
        });
        let mut tests: Vec<Test> = tests.into_iter().map(|test| test.into_inner().unwrap()).collect();
        tests.sort_by_key(|test| test.duration);
        Ok(Self { tests, jobs })
    }

    pub(crate) fn len(&self) -> usize {
        self.tests.len()
    }

    /// How each of `mutants` ends; `said` hears of it at once. The test that `killer` names is asked first.
    pub(crate) fn judge<'k>(
        &self,
        mutants: &[u32],
        killer: impl Fn(u32) -> Option<&'k str> + Sync,
        said: impl Fn(u32, &End) + Sync,
    ) -> Vec<End> {
        let ends: Vec<Mutex<End>> = mutants.iter().map(|_| Mutex::new(End::Unseen)).collect();
        in_parallel(self.jobs, mutants.len(), |index| {
            let end = self.end_of(mutants[index], killer(mutants[index]));
            said(mutants[index], &end);
            *ends[index].lock().unwrap() = end;
        });
        ends.into_iter().map(|end| end.into_inner().unwrap()).collect()
    }

    fn end_of(&self, mutant: u32, killer: Option<&str>) -> End {
        let mut passed = 0;
        let comes_by = |test: &&Test| test.seen.binary_search(&mutant).is_ok();
        let (first, others): (Vec<&Test>, Vec<&Test>) =
            self.tests.iter().filter(comes_by).partition(|test| Some(&*test.name) == killer);
        for test in first.into_iter().chain(others) {
            if !test.run(&[("MUTANT", mutant.to_string())]) {
                return End::Killed(test.name.clone());
            }
            passed += 1;
        }
        if passed == 0 { End::Unseen } else { End::Survived(passed) }
    }
}

impl Test {
    fn run(&self, environment: &[(&str, String)]) -> bool {
        // Before it was measured, any time is fine.
        let measured = self.duration.as_secs() + u64::from(!self.duration.is_zero());
        let slower = if measured == 0 { SECONDS_OF_THE_CLOCK } else { measured * SLOWER };
        let mut command = Command::new("sh");
        let limits = format!(
            "ulimit -v {KIB}; ulimit -t {}; exec timeout {} \"$@\"",
            slower + SECONDS,
            slower + SECONDS_OF_THE_CLOCK
        );
        command.args(["-c", &limits, "sh"]).arg(&self.program);
        command.args(["--exact", &self.name, "--test-threads", "1"]).current_dir(&self.folder);
        command.envs(ENVIRONMENT.iter().copied()).envs(environment.iter().map(|(name, value)| (name, value)));
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    }
}

/// The names of a program's tests.
fn names(program: &Program) -> Result<Vec<String>, String> {
    let mut command = Command::new(&program.path);
    let output = command.arg("--list").current_dir(&program.folder).output();
    let output = output.map_err(|error| format!("{}: {error}", program.path.display()))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let names = text.lines().filter_map(|line| line.strip_suffix(": test"));
    let wanted = names.filter(|name| !LEFT_OUT.iter().any(|out| name.contains(out)));
    Ok(wanted.map(str::to_owned).collect())
}

/// Does `work` for 0 to `count`, so many at a time.
fn in_parallel(jobs: usize, count: usize, work: impl Fn(usize) + Sync) {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    work(index);
                }
            });
        }
    });
}
