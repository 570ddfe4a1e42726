//! What a transaction costs the program, in counts that do not depend on how busy the machine is: user instructions by
//! callgrind, system calls by strace, with eight clients, at a line without pacing and at one with the pace of a wire; and what a
//! refusal costs, which must be less.
//!
//! The program runs twice under each, with a small and a large number of transactions; the difference is theirs alone.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::Duration;

use rustix::process::Signal;

use crate::Effort;
use crate::common::{Program, free_port, mobgate, wait_for};
use crate::contestants::{Behind, Contestant, Wired};
use crate::figure::{Target, figure};
use crate::flood::{KINDS, Kind, settings};
use crate::line::{Device, Line};
use crate::load::{Client, Habit, Load, ask_while};

const CLIENTS: usize = 8;

/// A line, and how often each client asks in the short and in the long run.
#[derive(Clone, Copy)]
struct Course {
    /// Stands in the figures' names.
    name: &'static str,
    device: Device,
    counts: [usize; 2],
    /// Instructions and system calls.
    targets: [Target; 2],
}

fn courses() -> [Course; 2] {
    let unpaced = [Target::AtMost(3_000.0), Target::AtMost(8.0)];
    [
        Course { name: "", device: Device::UNPACED, counts: [200, 1_200], targets: unpaced },
        // A wire's response comes in pieces, and silences are waited for.
        Course {
            name: "paced_",
            device: Device::paced(115_200),
            counts: [25, 125],
            targets: [Target::None; 2],
        },
    ]
}

/// Requests of each client in the short and in the long run that are refused.
const REFUSED: [usize; 2] = [100, 600];
/// Connections whose requests fill the queue of a port that waits for its device; what that has no room for is refused.
const FILLING: u16 = 80;

/// A program whose instructions are counted takes fifty times as long, on a busy machine many times that.
const COUNTED_PATIENCE: Duration = Duration::from_secs(300);

fn callgrind(report: &Path) -> Vec<String> {
    let out = format!("--callgrind-out-file={}", report.display());
    vec!["valgrind".into(), "--tool=callgrind".into(), out]
}

fn instructions(report: &str) -> Option<u64> {
    let totals = report.lines().find_map(|line| line.strip_prefix("totals: "))?;
    totals.trim().parse().ok()
}

pub(crate) fn figures(_: Effort) {
    // Detached, so that the program is the child and gets the signal that ends it.
    let strace = |report: &Path| {
        ["strace", "-D", "-f", "-c", "-o", &report.to_string_lossy()].map(String::from).into()
    };
    let calls = |report: &str| {
        // 100.00    0.000000           0         0         0 total
        let total = report.lines().find(|line| line.trim_end().ends_with(" total"))?;
        total.split_whitespace().nth(3)?.parse().ok()
    };
    for Course { name, device, counts, targets: [most_instructions, most_calls] } in courses() {
        let serve = |tool: &[String], count| run_under(tool, device, count);
        let figure_name = format!("{name}instructions_per_transaction");
        let each = count(&figure_name, counts, callgrind, instructions, serve);
        figure(&figure_name, each, "instructions", most_instructions);
        let figure_name = format!("{name}system_calls_per_transaction");
        let each = count(&figure_name, counts, strace, calls, serve);
        figure(&figure_name, each, "calls", most_calls);
    }
}

/// What a refusal costs, beside a served request.
pub(crate) fn refusals(_: Effort) {
    let [Course { name, device, counts, .. }, _] = courses();
    let serve = |tool: &[String], count| run_under(tool, device, count);
    let served = count(&format!("{name}served"), counts, callgrind, instructions, serve);
    for (name, kind) in KINDS {
        let Kind::Asks(unit, pdu) = kind else { continue };
        let name = format!("refusal_instructions_{name}");
        let each = count(&name, REFUSED, callgrind, instructions, |tool, count| {
            refuse_under(tool, unit, pdu, count)
        });
        figure(&name, each, "instructions", Target::AtMost(served));
    }
}

/// Lets `run` run the program under what `tool` says, each client asking so often, and gives what `read` finds in its report, for each
/// of as many responses as `run` says.
fn count(
    name: &str,
    counts: [usize; 2],
    tool: impl Fn(&Path) -> Vec<String>,
    read: impl Fn(&str) -> Option<u64>,
    run: impl Fn(&[String], usize) -> usize,
) -> f64 {
    let counted = counts.map(|count| {
        // Kept, for callgrind_annotate.
        let report = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.{count}"));
        let _ = fs::remove_file(&report);
        let answered = run(&tool(&report), count);
        let total: u64 = wait_for("the report", || read(&fs::read_to_string(&report).ok()?));
        (total as f64, answered as f64)
    });
    let [(few, few_answered), (many, many_answered)] = counted;
    (many - few) / (many_answered - few_answered)
}

/// Starts the program under `tool` in front of `device`, lets each client ask `count` times, and ends it. Gives how many
/// were answered: on a busy machine a device with a pace makes gaps in what it says.
fn run_under(tool: &[String], device: Device, count: usize) -> usize {
    let line = Line::with(device);
    let behind = Behind::Line(Wired { device: &line.device(), pace: device.pace, timeout_ms: 5_000 });
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let gateway = Contestant::Mobgate.command(behind, folder.path(), port).unwrap();
    let program = start_under(tool, &gateway, folder, port);
    program.logs("is open");
    let mut clients: Vec<Client> = (0..CLIENTS).map(|_| Client::connect(port).unwrap()).collect();
    // A response with a gap in it costs the gateway's time-out, which is no shorter than their own patience.
    clients.iter().try_for_each(|client| client.be_patient(COUNTED_PATIENCE)).unwrap();
    let habits: Vec<Habit> = (0..CLIENTS).map(Habit::of).collect();
    let loads = ask_while(&mut clients, &habits, |asked| asked < count);
    let sum = |of: fn(&Load) -> u64| loads.iter().map(of).sum::<u64>();
    let (refused, wrong, lost) = (sum(|load| load.refused), sum(|load| load.wrong), sum(|load| load.lost));
    assert_eq!((wrong, lost), (0, 0), "each gets its own response");
    assert!(10 * refused <= (CLIENTS * count) as u64, "nearly all are answered: {refused} are not");
    program.signal(Signal::TERM);
    program.wait();
    loads.iter().map(|load| load.times.len()).sum()
}

fn start_under(tool: &[String], gateway: &Command, folder: tempfile::TempDir, port: u16) -> Program {
    let mut command = Command::new(&tool[0]);
    command.args(&tool[1..]).arg(mobgate().get_program()).args(gateway.get_args());
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    Program::try_start(&mut command, folder, port)
        .unwrap_or_else(|why| panic!("{} is needed (apt-get install valgrind strace): {why}", tool[0]))
}

/// Starts the program under `tool` with rules and lines that refuse, lets each client ask `count` times for the same, and ends it. Gives
/// how many were refused, all of them.
fn refuse_under(tool: &[String], unit: u8, pdu: [u8; 5], count: usize) -> usize {
    let line = Line::with(Device { dead: Some(unit), ..Device::UNPACED });
    let silent = Line::with(Device { dead: Some(unit), ..Device::UNPACED });
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let config = folder.path().join("mobgate.conf");
    // Whoever waits for that line waits to the end.
    let lines = settings(&line, &silent, Device::UNPACED.pace.baud, "10m");
    let lines = lines.replace("clients 250", "clients 250 lifetime 10m idle 10m");
    fs::write(&config, lines.replace("{port}", &port.to_string())).unwrap();
    let mut gateway = mobgate();
    gateway.arg("--config").arg(config).args(["--socket", "off"]);
    let program = start_under(tool, &gateway, folder, port);
    wait_for("the lines", || (program.log().matches("is open").count() == 2).then_some(()));
    let connect = || {
        let stream = program.connect();
        stream.set_read_timeout(Some(COUNTED_PATIENCE)).unwrap();
        stream
    };
    let ask = |stream: &mut TcpStream, address: u16| {
        let [function, _, _, rest @ ..] = pdu;
        let [high, low] = address.to_be_bytes();
        let request = [&[0, 1, 0, 0, 0, 6, unit, function, high, low][..], &rest].concat();
        stream.write_all(&request).unwrap();
    };
    let is_answered = |stream: &TcpStream| {
        stream.set_nonblocking(true).unwrap();
        stream.peek(&mut [0]).is_ok()
    };
    // Those that are not refused wait, or a unit is down behind them. The first one leaves the queue when its line has been silent.
    let mut first = connect();
    ask(&mut first, 0);
    let is_sent = || [&line, &silent].iter().any(|line| line.heard.requests.load(Relaxed) > 0);
    wait_for("the first request", || (is_sent() || is_answered(&first)).then_some(()));
    let mut filling: Vec<TcpStream> = (0..FILLING).map(|_| connect()).collect();
    filling.iter_mut().zip(1..).for_each(|(stream, nth)| ask(stream, 10 * nth));
    // Whichever came too late: from then on all do.
    wait_for("a refusal", || filling.iter().any(is_answered).then_some(()));
    thread::scope(|scope| {
        for nth in 0..CLIENTS as u16 {
            let mut stream = connect();
            scope.spawn(move || {
                for _ in 0..count {
                    ask(&mut stream, 1_000 + 10 * nth);
                    assert_eq!(refusal(&mut stream)[0], pdu[0] | 0x80, "all are refused");
                }
            });
        }
    });
    program.signal(Signal::TERM);
    program.wait();
    CLIENTS * count
}

/// The PDU of an exception.
fn refusal(stream: &mut TcpStream) -> [u8; 2] {
    let mut frame = [0; 9];
    stream.read_exact(&mut frame).unwrap();
    [frame[7], frame[8]]
}
