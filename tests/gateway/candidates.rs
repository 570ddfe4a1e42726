//! Random commits, with resets and power cuts in every step of a save: whoever has cut off his own access has it back in time, and
//! what was confirmed is kept.

use embassy_futures::select::{Either, select};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::audit::AuditMemory;
use mobgate::gateway::{Candidate, Gateway, Ports, reconfigure};
use mobgate_simulator::console::Medium;
use mobgate_simulator::random::each_seed;

use crate::cut_off::{by_network, user};
use crate::prelude::*;

/// Commits in all by default; `MOBGATE_COMMITS` says how many else.
const COMMITS: u64 = 10_000;
/// Steps of a world.
const STEPS: usize = 60;
/// The longest that a commit waits for its confirmation here.
const CONFIRMED_MAX_S: u64 = 60;
/// The line of the port by which its user reaches the gateway, and what may be behind it: without it nobody types anything.
const ACCESS: &str = "port access tcp server 502";
const ALLOWED: &str = " allow 10.0.0.0/8";

/// The settings in force as text.
fn in_force(gateway: &Gateway<'_>) -> String {
    gateway.settings(|settings| {
        let mut text = String::new();
        (0..)
            .map_while(|n| mobgate::language::write_line(settings, n, &mut text).map(|_| text.push('\n')))
            .count();
        text
    })
}

/// Whether the user of these settings can come in.
fn is_open(gateway: &Gateway<'_>) -> bool {
    let text = in_force(gateway);
    let port =
        |line: &str| line.strip_prefix(ACCESS).is_some_and(|words| words.is_empty() || words == ALLOWED);
    text.lines().any(|line| line == user()) && text.lines().any(port)
}

/// What happens over many lives of a gateway.
struct History {
    random: Random,
    medium: Medium,
    steps: usize,
    commits: u64,
    /// Changes that would have cut off who made them, and were refused.
    refused: u64,
    lock_outs: u64,
    /// The text that was last said to be saved.
    kept: String,
}

impl History {
    /// A line that the user types.
    fn line(&mut self) -> String {
        let number = self.random.within(1..=3);
        match self.random.index(20) {
            0..=3 => "candidate".into(),
            4 | 5 => format!("port P{number} tcp server 200{number} clients {}", self.random.within(1..=3)),
            6 => format!("delete port P{number}"),
            7 | 8 => "delete port access".into(),
            9 => ACCESS.into(),
            10..=12 => format!("commit confirmed {}s", self.random.within(10..=CONFIRMED_MAX_S)),
            13 | 14 => "commit".into(),
            15 => "delete user anna".into(),
            16 => ["user anna role viewer", "user anna role engineer"][self.random.index(2)].into(),
            17 => ["edit port access allow 10.0.0.9", "edit port access allow 10.0.0.0/8"]
                [self.random.index(2)]
            .into(),
            18 => user(),
            _ => ["discard", "rollback", "commit check", "diff"][self.random.index(4)].into(),
        }
    }

    /// One life, until the steps are over or a reset.
    fn live(&mut self, seed: u64) {
        let slots = [const { Slot::new() }; 40];
        let (ports, candidate, audit) = (Ports::<5>::new(), Candidate::new(), AuditMemory::new());
        let pool = FramePool::new(&slots, 32);
        let connections = [const { mobgate::gateway::Connection::new() }; 27];
        let gateway = Gateway::new(&pool, &ports, &connections).with_candidate(&candidate).with_audit(&audit);
        let mut world = World::new(seed);
        world
            .run_until(reconfigure::load(&gateway, &mut self.medium, &|_| Ok(())))
            .expect("what is saved can be read");
        assert!(is_open(&gateway), "a reset gives the access back");
        world.spawn(gateway.watch_commits());
        while self.steps > 0 {
            self.steps -= 1;
            if !is_open(&gateway) {
                // Nobody gets in: the gateway must help itself, or somebody resets it.
                if self.random.chance(0.3) {
                    return;
                }
                world.run_for(Duration::from_secs(CONFIRMED_MAX_S) + MS);
                if !is_open(&gateway) {
                    println!("seed {seed}: locked out");
                    self.lock_outs += 1;
                    return;
                }
                continue;
            }
            match self.random.index(12) {
                0 => return,
                1 => world.run_for(Duration::from_secs(self.random.within(1..=CONFIRMED_MAX_S))),
                _ => {
                    if !self.step(&mut world, &gateway) {
                        return;
                    }
                }
            }
        }
    }

    /// Types a line; false if the power is cut meanwhile.
    fn step<'w>(&mut self, world: &mut World<'w>, gateway: &Gateway<'_>) -> bool {
        let line = self.line();
        let is_commit = line.starts_with("commit") && !line.ends_with("check");
        self.commits += u64::from(is_commit);
        self.medium.calls_left =
            self.random.chance(0.2).then(|| (self.random.within(0..=6), self.random.chance(0.5)));
        let session = by_network(gateway, &mut self.medium, &line);
        let before = self.kept.clone();
        let ended = world.run_until(select(session, Timer::after(SECOND)));
        let saved = String::from_utf8_lossy(&self.medium.saved).into_owned();
        self.medium.calls_left = None;
        self.medium.next.clear();
        let Either::First(said) = ended else {
            // Power is gone in the middle of a save: the text is the old one or the new one.
            assert!(saved == before || saved == in_force(gateway), "{line}: {saved}");
            self.kept = saved;
            return false;
        };
        self.refused += u64::from(said.contains("this would cut you off"));
        if said.contains("in force and saved") {
            self.kept = in_force(gateway);
        }
        assert_eq!(saved, self.kept, "{line}: what is saved is what was said to be");
        true
    }
}

#[test]
fn commits_lock_nobody_out_and_keep_what_was_confirmed() {
    let wanted = mobgate_simulator::random::chosen("MOBGATE_COMMITS").unwrap_or(COMMITS);
    let (mut seeds, mut commits, mut refused, mut lock_outs) = (0, 0, 0, 0);
    each_seed(wanted / 10, |seed| {
        let kept = format!("{}\n{ACCESS}\n", user());
        let medium = Medium { saved: kept.clone().into_bytes(), ..Medium::default() };
        let mut history = History {
            random: Random::new(seed),
            medium,
            steps: STEPS,
            commits: 0,
            refused: 0,
            lock_outs: 0,
            kept,
        };
        while history.steps > 0 {
            let life = history.random.bits();
            history.live(life);
            assert_eq!(String::from_utf8_lossy(&history.medium.saved), history.kept);
        }
        seeds += 1;
        commits += history.commits;
        refused += history.refused;
        lock_outs += history.lock_outs;
    });
    let target = mobgate_simulator::random::chosen("MOBGATE_SEED").map_or(10 * seeds, |_| 0);
    let verdict = |good| if good { "ok" } else { "short" };
    println!("figure commits_random {commits} commits >={target} {}", verdict(commits >= target));
    println!("{refused} changes refused that cut off who made them");
    println!("figure commits_lock_outs {lock_outs} lock-outs <=0 {}", verdict(lock_outs == 0));
    assert!(commits >= target && lock_outs == 0);
}
