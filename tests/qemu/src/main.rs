//! `cargo xtask qemu` runs the gateway on an emulated board with devices on its lines; `cargo xtask qemu figures` measures it,
//! `cargo xtask qemu roles` measures what roles in rules cost where no rule has one, `cargo xtask qemu soak N` runs N transactions mixed
//! with resets.

use std::io::Write;
use std::process::ExitCode;

use mobgate_qemu::{Bus, Machine, Options, cost, pages, shift, soak};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = tempfile::tempdir().expect("a folder for temporary files");
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        [] => demonstrate(folder.path()),
        ["figures"] => {
            cost::sizes();
            cost::ssh_session();
            pages::figures(folder.path());
            let instructions = cost::instructions(folder.path());
            shift::figures(folder.path(), instructions);
            shift::passed_on(folder.path());
        }
        ["roles"] => cost::roles(folder.path()),
        ["soak", count] if count.parse::<u64>().is_ok() => {
            soak::run(folder.path(), count.parse().unwrap_or_default());
        }
        _ => {
            eprintln!("usage: cargo xtask qemu [figures | roles | soak TRANSACTIONS]");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// The board with three devices on each line, and its console on this terminal.
fn demonstrate(folder: &std::path::Path) {
    let machine = Machine::start(folder, Options::default());
    let first_units = [1, 65, 129];
    let buses = first_units.map(|first| Bus::new(first..first + 3));
    (1..).zip(&buses).for_each(|(uart, bus)| machine.wire(uart, bus));
    let port = machine.port();
    println!("Devices 1-3, 65-67 and 129-131 respond on Modbus TCP port {port}. Try from another terminal:");
    println!("  mbpoll -m tcp -p {port} -a 65 -t 4:hex -B -r 1 -c 5 -1 127.0.0.1");
    println!("The board's console is here; its end ends the board.");
    let _ = std::io::stdout().flush();
    machine.console().join_terminal();
}
