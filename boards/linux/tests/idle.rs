//! A gateway with nothing to do sleeps: none of its threads wakes up.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::Duration;

use serial2::SerialPort;

use common::{Program, ask, converse, mobgate};

mod common;

/// Looks of [`WINDOW`] each, of which one has to be without a wake-up: what was begun before may end in the first ones.
const LOOKS: usize = 10;
/// Several times the periods that a program would look after something in.
const WINDOW: Duration = Duration::from_secs(3);

/// How often threads of the program have been switched to, by thread.
fn switches(program: &Program) -> Vec<(String, u64)> {
    let tasks = fs::read_dir(format!("/proc/{}/task", program.id())).unwrap();
    let mut counts: Vec<_> = tasks
        .filter_map(|task| fs::read_to_string(task.unwrap().path().join("status")).ok())
        .map(|status| {
            let count = |line: &str| {
                line.split_once("ctxt_switches:").and_then(|(_, count)| count.trim().parse::<u64>().ok())
            };
            let name = status.lines().next().unwrap_or_default().to_owned();
            (name, status.lines().filter_map(count).sum::<u64>())
        })
        .collect();
    counts.sort();
    counts
}

#[test]
fn nothing_wakes_up_while_nothing_is_to_be_done() {
    let (_device, device_end) = SerialPort::pair().unwrap();
    let (_master, master_end) = SerialPort::pair().unwrap();
    let name = |end: &SerialPort| rustix::termios::ttyname(end, Vec::new()).unwrap().into_string().unwrap();
    let settings = format!(
        "port P1 serial {} rtu client 19200 8E1\nport P2 serial {} rtu server 19200 8E1\n\
         port P502 tcp server 127.0.0.1:{{port}}\nroute P502 1 * * local\nroute P2 * * * P1\n",
        name(&device_end),
        name(&master_end)
    );
    // Standard input stays open, and nothing comes.
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console"];
    let program = Program::by(mobgate().stdin(Stdio::piped()), &settings, &options);
    let mut client = program.connect();
    assert_eq!(ask(&mut client, 1, &[8, 0, 0, 0x12, 0x34]), [8, 0, 0, 0x12, 0x34]);
    let mut session = program.session();
    converse(&mut session, "save\nshow ports\n", "/dev/pts");
    let mut looks = (0..LOOKS).map(|_| {
        let before = switches(&program);
        thread::sleep(WINDOW); // what is looked at
        (before, switches(&program))
    });
    let mut last = None;
    let still = looks.any(|(before, after)| {
        last = Some((before.clone(), after.clone()));
        before == after
    });
    assert!(still, "threads woke up in each of {LOOKS} times {WINDOW:?}: {last:?}");
    println!("wake-ups in {WINDOW:?} with a console, two serial ports and a TCP client: 0");
}
