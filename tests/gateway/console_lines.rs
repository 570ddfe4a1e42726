//! Random lines at a console: words of the language and garbage. None of them panics, ends the session unless it says so, or
//! changes the settings unless it was accepted.

use std::convert::Infallible;

use embedded_io_async::ErrorType;
use mobgate::console::{Ended, Mode, run};
use mobgate::gateway::Gateway;
use mobgate::hal::NoUpdate;
use mobgate_simulator::console::{Medium, Simulator};
use mobgate_simulator::random::{Random, chosen};

use crate::prelude::*;

const SETTINGS: &str = "
port bus serial uart1 rtu client 115200 8E1 timeout 20ms
port P502 tcp server 502
port scan scanner
route P502 * * * bus
route scan * * * bus
device meter unit 5
point power meter holding 0 count 2 as f32 read high
";
/// Lines in a world; the next world begins anew, so that settings do not only grow.
const LINES: usize = 500;
/// Lines in all by default; `MOBGATE_LINES` says how many else.
const LINES_DEFAULT: u64 = 15_000;

/// What a line may begin with, as it is or spoiled.
const LINES_GOOD: &[&str] = &[
    "port bus serial uart1 rtu client 19200 8E1 timeout 300ms retries 2",
    "port P1 serial uart2 ascii server 9600 7E1",
    "port P503 tcp server 503 clients 4 idle 10s reserve 1 for 10.0.0.0/8",
    "port plc tcp client 192.168.1.20:502 in-flight 4",
    "port udp1 udp server 502",
    "edit port bus timeout 50ms gap 2ms",
    "route P502 1-64 192.168.1.0/24 +100 bus readonly priority high",
    "route P502 7 * =1 local addresses 0-99",
    "insert route 1 P502 9 * * discard",
    "move route 2 1",
    "delete route 1",
    "delete port P1",
    "delete routes",
    "device meter unit 7 order 2301 label \"Main meter\"",
    "point volts meter holding 10 count 4 as i16 write auto",
    "point own local holding 1 count 8 quality 400",
    "port field ethercat",
    "slave 0 unit 232 coil 10 count 18 read 100ms",
    "network dhcp",
    "show ports",
    "show routes",
    "show units",
    "show stats",
    "show config",
    "show log",
    "show frames",
    "show points",
    "help",
    "help route",
    "read 5 holding 0 count 4 via bus",
    "write 5 holding 0 via bus 7",
    "read power",
    "write power 1.5",
    "mark meter 3 0-9",
    "begin power",
    "finish power",
    "ping 5 via bus",
    "ping 5",
    "scan bus 115200 units 1-3",
    "tune bus units 5 count 10",
    "watch",
    "watch points",
    "capture off",
    "clear stats",
    "clear log",
    "save",
    "load",
    "candidate",
    "diff",
    "commit",
    "commit confirmed 10s",
    "rollback",
    "rollback 1",
    "versions",
    "discard",
    "reboot",
];

/// A line without its end.
fn line(random: &mut Random) -> Vec<u8> {
    let mut line = LINES_GOOD[random.index(LINES_GOOD.len())].as_bytes().to_vec();
    match random.within(0..=11) {
        0..=3 => {}
        4 => line = (0..random.within(0..=90)).map(|_| random.byte()).collect(),
        5 => line.truncate(random.index(line.len())),
        6 => {
            let place = random.index(line.len());
            line[place] = random.byte();
        }
        // Words of one line in another.
        7 => {
            let other: Vec<&str> = LINES_GOOD[random.index(LINES_GOOD.len())].split(' ').collect();
            let mut words: Vec<&str> = std::str::from_utf8(&line).unwrap_or_default().split(' ').collect();
            let place = random.index(words.len());
            words[place] = other[random.index(other.len())];
            line = words.join(" ").into_bytes();
        }
        8 => {
            let strange = [
                "\u{e9}",
                "\u{1f480}",
                "\x1b[A",
                "\x1b[31m",
                "\0",
                "\t",
                "\x03",
                "\x7f",
                "\"",
                "#",
                "%s",
                "-1",
            ];
            let place = random.index(line.len());
            line.splice(place..place, strange[random.index(strange.len())].bytes());
        }
        9 => {
            let number =
                ["0", "-1", "65536", "4294967296", "99999999999999999999", "1.5", "1e9", "0x10", "247-1"];
            let mut words: Vec<&str> = std::str::from_utf8(&line).unwrap_or_default().split(' ').collect();
            let last = words.len() - 1;
            words[last] = number[random.index(number.len())];
            line = words.join(" ").into_bytes();
        }
        10 => line.extend(vec![b" x7\"\xff"[random.index(5)]; random.within(1..=3_000) as usize]),
        _ => line = [&line[..], b" ", &line].concat(),
    }
    // What ends lines comes between them, and what leaves on purpose.
    line.retain(|byte| !matches!(byte, b'\n' | b'\r' | 0x04));
    line
}

/// Somebody who types lines, and looks at the settings before each.
struct Typist<'g> {
    gateway: &'g Gateway<'g>,
    random: Random,
    mode: Mode<'static>,
    lines: usize,
    /// What is left of the line that is typed, and all of it.
    rest: Vec<u8>,
    line: Vec<u8>,
    printed: String,
    settings: Settings,
    changes: usize,
    refusals: usize,
}

impl Typist<'_> {
    /// The line before has been carried out, or what it has begun goes on.
    fn look(&mut self) {
        let printed = std::mem::take(&mut self.printed);
        let line = String::from_utf8_lossy(&self.line);
        let refused = printed.lines().any(|line| line.starts_with("error: "));
        self.refusals += usize::from(refused);
        let changed = self.gateway.settings(|settings| *settings != self.settings);
        if changed {
            assert!(!refused, "{line:?} was refused and changed the settings:\n{printed}");
            self.changes += 1;
            self.gateway.settings(|settings| self.settings.clone_from(settings));
        }
    }
}

impl ErrorType for Typist<'_> {
    type Error = Infallible;
}

impl Read for Typist<'_> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        // What stops a command comes a while after it.
        Timer::after(Duration::from_millis(self.random.within(1..=30))).await;
        if self.rest.is_empty() {
            self.look();
            let Some(left) = self.lines.checked_sub(1) else { return Ok(0) };
            self.lines = left;
            self.line = line(&mut self.random);
            self.rest = self.line.clone();
            self.rest.push(if self.mode == Mode::Plain { b'\n' } else { b'\r' });
        }
        let count = self.rest.len().min(into.len());
        into[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(count)
    }
}

impl Write for Typist<'_> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        self.printed.push_str(std::str::from_utf8(from).expect("what is printed is text"));
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Types as many lines of `seed` in `mode`; gives how many changed the settings, and how many were refused.
fn type_lines(seed: u64, mode: Mode<'static>) -> (usize, usize) {
    rig::with_gateway(seed, SETTINGS, |world: &mut World<'_>, rig| {
        rig.attach(world, "uart1", [Device::new(5)]);
        let mut typist = Typist {
            gateway: rig.gateway,
            random: Random::new(seed),
            mode,
            lines: LINES,
            rest: Vec::new(),
            line: Vec::new(),
            printed: String::new(),
            settings: rig.gateway.settings(Settings::clone),
            changes: 0,
            refusals: 0,
        };
        let Ok(ended) = world.run_until(run(
            rig.gateway,
            &mut typist,
            &mut Medium::default(),
            &mut NoUpdate("this is a simulation"),
            &Simulator,
            mode,
        ));
        let last = String::from_utf8_lossy(&typist.line);
        assert!(matches!(ended, Ended::Left { .. }), "{ended:?} after {last:?}");
        assert_eq!(typist.lines, 0, "the session ended after {last:?}");
        (typist.changes, typist.refusals)
    })
}

#[test]
fn random_lines_neither_panic_nor_end_the_session_nor_change_what_they_are_refused() {
    let lines = chosen("MOBGATE_LINES").unwrap_or(LINES_DEFAULT);
    let seeds = match chosen("MOBGATE_SEED") {
        Some(seed) => seed..seed + 1,
        None => 0..lines.div_ceil(LINES as u64),
    };
    let (mut changes, mut refusals) = (0, 0);
    for seed in seeds {
        let mode = if seed % 3 == 0 { Mode::Echo } else { Mode::Plain };
        println!("seed {seed}");
        let (changed, refused) = type_lines(seed, mode);
        changes += changed;
        refusals += refused;
    }
    println!("{changes} lines changed the settings, {refusals} were refused");
    assert!(changes > 0 && refusals > 0);
}
