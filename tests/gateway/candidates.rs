//! Random commits by console and by the web interface, with resets and power cuts in every step of a save: whoever has cut off the own
//! access has it back in time, and what was confirmed is kept.

use embassy_futures::select::{Either, select};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::audit::AuditMemory;
use mobgate::gateway::{Candidate, Gateway, Ports, reconfigure};
use mobgate::hal::NoUpdate;
use mobgate::web;
use mobgate_simulator::Network;
use mobgate_simulator::console::Medium;
use mobgate_simulator::random::each_seed;

use crate::cut_off::{Board, by_network, user};
use crate::prelude::*;
use crate::web_user::{JSON, User};

/// Commits that change the settings in force, in all by default; `MOBGATE_COMMITS` says how many else.
const COMMITS: u64 = 10_000;
/// Steps of a world, of which ten and more are commits that change something.
const STEPS: usize = 28;
/// The longest that a commit waits for its confirmation here.
const CONFIRMED_MAX_S: u64 = 60;
/// The lines by which a user reaches the gateway, and what may be behind those of the ports. Their names are the longest, and equally
/// long: there are columns.
const ACCESS: &str = "port access tcp server 502";
const WEB: &str = "port webapi http server 80";
const CLEARTEXT: &str = " cleartext";
const ALLOWED: &str = " allow 10.0.0.0/8";
const NAME: &str = "mdns on name cabinet";
/// For lines that turn TLS on, by which nobody comes in here.
const CERTIFICATE: &str = "certificate own own /own.pem key /own.key";

/// What the console says of a commit that it has saved.
const SAVED: &str = "in force and saved";

/// What it says of one that waits for its confirmation.
const WAITS: &str = "in force: commit within";

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

/// How the user comes in.
#[derive(Clone, Copy, Debug)]
enum Entrance {
    Console,
    /// The web interface of the gateway that is called so.
    Web(&'static str),
}

impl Entrance {
    /// Sessions of the console are quicker tests, so there are more of them.
    const ALL: [Self; 5] =
        [Self::Console, Self::Console, Self::Console, Self::Web("10.0.0.99"), Self::Web("cabinet.local")];

    /// Whether the user can come in by it with settings of this `text`.
    fn is_open(self, text: &str) -> bool {
        let has = |wanted: &str| text.lines().any(|line| line == wanted);
        let admits =
            |port: &str, end: &str| ["", ALLOWED].iter().any(|allowed| has(&[port, allowed, end].concat()));
        let is_reached = match self {
            Self::Console => admits(ACCESS, ""),
            Self::Web(host) => admits(WEB, CLEARTEXT) && (has(NAME) || !host.ends_with(".local")),
        };
        is_reached && has(&user())
    }
}

/// What happens over many lives of a gateway.
struct History {
    seed: u64,
    random: Random,
    medium: Medium,
    steps: usize,
    /// Commits that have changed the settings in force, by console and by the web interface.
    commits: [u64; 2],
    /// Changes that would have cut off who made them, and were refused.
    refused: u64,
    /// Those that were to be confirmed, and did.
    cuts: u64,
    power_cuts: u64,
    /// The text that was last said to be saved.
    kept: String,
    /// A commit waits for its confirmation since the last session.
    waits: bool,
    /// A commit was refused in the last session.
    is_stuck: bool,
    /// Who has just lost the own access, and whether the settings that were saved before give it.
    outside: Option<(Entrance, bool)>,
}

impl History {
    /// A line of settings.
    fn change(&mut self) -> String {
        let number = self.random.within(1..=3);
        let port = ["access", "webapi"][self.random.index(2)];
        match self.random.index(32) {
            0..=15 => format!("port P{number} tcp server 200{number} clients {}", self.random.within(1..=9)),
            16 => format!("delete port P{number}"),
            17 => format!("delete port {port}"),
            18..=20 => ACCESS.into(),
            21..=23 => [WEB, CLEARTEXT].concat(),
            24 => WEB.into(),
            25 => "edit port webapi tls".into(),
            26 => NAME.into(),
            27 => ["mdns off", "mdns on name other"][self.random.index(2)].into(),
            28 => "delete user anna".into(),
            29 => ["user anna role viewer", "user anna role engineer"][self.random.index(2)].into(),
            30 => format!("edit port {port} allow {}", ["10.0.0.9", "10.0.0.0/8"][self.random.index(2)]),
            _ => user(),
        }
    }

    /// A line that commits.
    fn commit(&mut self) -> String {
        match self.random.index(3) {
            0 => format!("commit confirmed {}s", self.random.within(10..=CONFIRMED_MAX_S)),
            _ => "commit".into(),
        }
    }

    /// The lines of a session: something, or a whole transaction.
    fn lines(&mut self) -> Vec<String> {
        let kinds = if self.waits { 16..=23 } else { 0..=19 };
        match self.random.within(kinds) {
            0..=16 => {
                let mut lines = vec!["candidate".into()];
                // Else no later commit would change anything.
                if self.is_stuck && self.random.chance(0.9) {
                    lines.insert(0, "discard".into());
                }
                let changes: Vec<_> = (0..=self.random.index(3)).map(|_| self.change()).collect();
                lines.push(changes.join("\n"));
                lines.push(self.commit());
                lines
            }
            17 => vec![self.change()],
            18 => vec![self.commit()],
            20..=23 => vec!["commit".into()],
            _ => vec![["discard", "rollback", "commit check", "diff"][self.random.index(4)].into()],
        }
    }

    /// One life, until the steps are over or a reset.
    fn live(&mut self) {
        let slots = [const { Slot::new() }; 40];
        let (ports, candidate, audit) = (Ports::<5>::new(), Candidate::new(), AuditMemory::new());
        let pool = FramePool::new(&slots, 32);
        let connections = [const { mobgate::gateway::Connection::new() }; 42];
        let gateway = Gateway::new(&pool, &ports, &connections).with_candidate(&candidate).with_audit(&audit);
        let mut world = World::new(self.seed);
        world
            .run_until(reconfigure::load(&gateway, &mut self.medium, &|_| Ok(())))
            .expect("what is saved can be read");
        world.spawn(gateway.watch_commits());
        let network = Network::new(self.seed);
        let mut visitor = Visitor { network: network.clone(), user: None };
        self.outside = self.outside.filter(|(_, is_saved)| *is_saved);
        self.comes_in_again(&gateway, "after a reset");
        while self.steps > 0 {
            self.steps -= 1;
            match self.random.index(12) {
                0 => return,
                1 => world.run_for(Duration::from_secs(self.random.within(1..=CONFIRMED_MAX_S))),
                _ => {
                    if !self.step(&mut world, &gateway, &mut visitor) {
                        return;
                    }
                }
            }
            if self.outside.is_some() {
                // The gateway must help itself, or somebody resets it.
                if self.random.chance(0.3) {
                    return;
                }
                world.run_for(Duration::from_secs(CONFIRMED_MAX_S) + MS);
                self.comes_in_again(&gateway, "after the time");
            }
        }
    }

    /// Whoever was cut off, and somebody in any case, can come in.
    fn comes_in_again(&mut self, gateway: &Gateway<'_>, when: &str) {
        let text = in_force(gateway);
        let outside = self.outside.take();
        let locked_out = outside.filter(|(entrance, _)| !entrance.is_open(&text));
        assert!(locked_out.is_none(), "seed {}: {locked_out:?} is locked out {when}:\n{text}", self.seed);
        let is_open = Entrance::ALL.iter().any(|entrance| entrance.is_open(&text));
        assert!(is_open, "seed {}: nobody comes in {when}:\n{text}", self.seed);
    }

    /// Somebody who can come in has a session; false if the power is cut meanwhile.
    fn step(&mut self, world: &mut World<'_>, gateway: &Gateway<'_>, visitor: &mut Visitor) -> bool {
        let (lines, before) = (self.lines(), in_force(gateway));
        let open: Vec<_> = Entrance::ALL.into_iter().filter(|entrance| entrance.is_open(&before)).collect();
        let entrance = open[self.random.index(open.len())];
        self.medium.calls_left =
            self.random.chance(0.2).then(|| (self.random.within(0..=12), self.random.chance(0.5)));
        let session = visitor.session(gateway, &mut self.medium, (entrance, &before), &lines);
        let ended = world.run_until(async { embassy_time::with_timeout(SECOND, session).await.ok() });
        let (after, had) = (in_force(gateway), entrance.is_open(&self.kept));
        let saved = String::from_utf8_lossy(&self.medium.saved).into_owned();
        self.medium.calls_left = None;
        self.medium.next.clear();
        let Some(said) = ended else {
            // Power is gone in the middle of a save: the text is the old one or the new one.
            let is_whole = saved == self.kept || saved == after;
            assert!(is_whole, "seed {}: {lines:?}: {saved}", self.seed);
            self.power_cuts += 1;
            self.kept = saved;
            return false;
        };
        let last = lines.last().map(String::as_str).unwrap_or_default();
        let is_commit = last.starts_with("commit") && last != "commit check";
        self.commits[usize::from(matches!(entrance, Entrance::Web(_)))] +=
            u64::from(is_commit && after != before);
        self.waits = said.contains(WAITS);
        self.is_stuck = said.contains("this would cut you off");
        self.refused += u64::from(self.is_stuck);
        if said.contains(SAVED) {
            self.kept = after.clone();
        }
        assert_eq!(saved, self.kept, "seed {}: {lines:?}: what is saved is what was said to be", self.seed);
        // Whoever takes a commit back wants what was before, and what is not saved is gone after a reset.
        if (had || self.waits) && !entrance.is_open(&after) && last != "rollback" {
            self.outside = Some((entrance, had));
            self.cuts += 1;
        }
        true
    }
}

/// Who comes in.
struct Visitor {
    network: Network,
    /// Logged in to the web interface.
    user: Option<User>,
}

impl Visitor {
    /// Has a session with these lines; returns what it says.
    async fn session(
        &mut self,
        gateway: &Gateway<'_>,
        medium: &mut Medium,
        (entrance, before): (Entrance, &str),
        lines: &[String],
    ) -> String {
        let Entrance::Web(host) = entrance else {
            return by_network(gateway, medium, &lines.join("\n")).await;
        };
        let (mut hosts, mut update) = (self.network.host(), NoUpdate("this is a simulation"));
        let interface = web::run(gateway, 0, &mut hosts, (medium, &mut update), &Board);
        let calls = async {
            // It listens by then.
            Timer::after(MS).await;
            let mut said = String::new();
            for line in calls_of(lines) {
                let (status, text) = self.call(host, &line).await;
                let is_good = [200, 204, 409, 422].contains(&status);
                // A connection is reset if a commit is taken back meanwhile that the listener came by.
                let is_gone = status == 0 && in_force(gateway) != before;
                assert!(is_good || is_gone, "{host}: {line}: {status} {text}");
                said += match &*line {
                    "commit" if status == 204 => SAVED,
                    _ if status == 204 && line.starts_with("commit confirmed") => WAITS,
                    _ => &text,
                };
            }
            said
        };
        match select(interface, calls).await {
            Either::Second(said) => said,
            Either::First(()) => unreachable!("the interface is served forever"),
        }
    }

    /// Calls what does the same as the console's `line`, or lines of settings; returns the status and the text that come back.
    async fn call(&mut self, host: &'static str, line: &str) -> (u16, String) {
        let words: Vec<_> = line.split(' ').collect();
        let (what, body) = match words[..] {
            ["candidate"] => ("POST candidate", String::new()),
            ["discard"] => ("DELETE candidate", String::new()),
            ["diff"] => ("GET diff", String::new()),
            ["rollback"] => ("POST rollback", String::new()),
            ["commit"] => ("POST commit", "{}".into()),
            ["commit", "check"] => ("POST commit", r#"{"check":true}"#.into()),
            ["commit", "confirmed", time] => {
                ("POST commit", format!(r#"{{"confirmed":{}}}"#, time.trim_end_matches('s')))
            }
            _ => ("POST candidate", line.to_owned()),
        };
        let kind = match what {
            "POST commit" => JSON,
            "POST candidate" => "Content-Type: text/plain\r\n",
            _ => "",
        };
        if !self.network.is_listening(80) {
            return (0, String::new());
        }
        let path = what.replace(' ', " /api/v1/settings/");
        let mut user = self.user.take().unwrap_or_else(|| User::new(&self.network, host));
        user.host = host;
        let mut got = user.call(&path, kind, body.as_bytes()).await;
        if got.0 == 401 {
            user = user.log_in("anna", "one").await;
            got = user.call(&path, kind, body.as_bytes()).await;
        }
        self.user = Some(user);
        got
    }
}

/// The same lines, those of settings together: they begin a candidate.
fn calls_of(lines: &[String]) -> Vec<String> {
    match lines {
        [discard @ .., candidate, changes, commit] if candidate == "candidate" => {
            [discard, &[changes.clone(), commit.clone()]].concat()
        }
        _ => lines.to_vec(),
    }
}

#[test]
fn commits_lock_nobody_out_and_keep_what_was_confirmed() {
    let wanted = mobgate_simulator::random::chosen("MOBGATE_COMMITS").unwrap_or(COMMITS);
    let (mut seeds, mut commits, mut refused, mut cuts, mut power_cuts) = (0, [0, 0], 0, 0, 0);
    each_seed(wanted / 10, |seed| {
        let kept = [&user(), ACCESS, &[WEB, CLEARTEXT].concat(), NAME, CERTIFICATE]
            .map(|line| format!("{line}\n"))
            .concat();
        let medium = Medium { saved: kept.clone().into_bytes(), ..Medium::default() };
        let mut history = History {
            seed,
            random: Random::new(seed),
            medium,
            steps: STEPS,
            commits: [0, 0],
            refused: 0,
            cuts: 0,
            power_cuts: 0,
            kept,
            waits: false,
            is_stuck: false,
            outside: None,
        };
        while history.steps > 0 {
            history.live();
        }
        seeds += 1;
        commits = [0, 1].map(|way| commits[way] + history.commits[way]);
        refused += history.refused;
        cuts += history.cuts;
        power_cuts += history.power_cuts;
    });
    let target = mobgate_simulator::random::chosen("MOBGATE_SEED").map_or(10 * seeds, |_| 0);
    let [by_console, by_web] = commits;
    let all = by_console + by_web;
    let verdict = |good| if good { "ok" } else { "short" };
    println!("figure commits_random {all} commits >={target} {}", verdict(all >= target));
    println!("{by_console} of them by console, {by_web} by the web interface, {power_cuts} power cuts");
    println!("{refused} changes refused that cut off who made them, {cuts} done that were to be confirmed");
    // Else it has ended with the seed by now.
    println!("figure commits_lock_outs 0 lock-outs <=0 ok");
    assert!(all >= target && by_console.min(by_web) >= target / 5);
}
