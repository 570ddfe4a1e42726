//! Sizes of the boards' images, the STM32 ones each without and with EtherCAT and data points, with users, and with the web interface where the board has it: sections, largest symbols, budgets.
//!
//! Flash is what is programmed: code, constants, and initial values of variables. RAM is what is used statically; the rest of the
//! memory is the stack. The router's core is what lies between the ports: router, rules, frames, queues, counters. Its flash is the
//! sum of the symbols of its modules in the linked image, after inlining; its RAM is one port's slot in the gateway's statics.
//!
//! The H743's image without has a budget for what it had at commit `ed70195`, which is the rest besides the [`parts`] that were added
//! since, and a budget for all.

use std::path::{Path, PathBuf};

use crate::board;
use crate::parts;
use crate::tools::{Outcome, command, fault, figure, output, read};

/// Modules of the router's core.
const CORE: [&str; 11] = [
    "tasks::router",
    "routing",
    "settings::functions",
    "settings::policy",
    "settings::rule::",
    "frame",
    "stats",
    "gateway",
    "port::client::queue",
    "port::client::dispatcher",
    "port::client::cache",
];
/// Parts of these modules that do not count: changes of settings, console requests, sockets, response time statistics.
const BESIDES: [&str; 10] = [
    "routing::is_implied",
    "stats::response_tail",
    "gateway::direct_request",
    "gateway::events",
    "gateway::outstanding",
    "gateway::reconfigure",
    "gateway::response_times",
    "gateway::saved",
    "gateway::socket",
    "gateway::turns",
];
/// The ports' own tasks: framing, timing, sockets.
const TASKS: [&str; 4] = ["run_port", "run_connection", "play<", "socket_closed"];

/// The gateway's statics, including the futures of its tasks.
const PARTS: [(&str, &str); 7] = [
    ("port_futures", "nucleo144::port::POOL"),
    ("connection_futures", "gateway::connection::POOL"),
    ("settings", "gateway::GATEWAY"),
    ("frames", "gateway::SLOTS"),
    ("port_places", "gateway::PORT_STATES"),
    ("connections", "gateway::CONNECTION_STATES"),
    ("router", "gateway::router::POOL"),
];

/// The futures of the task that has the web interface's connections, which are so many, and the buffers of their sockets.
const WEB_TASK: &str = "nucleo144::serve::POOL";
const SOCKET_BUFFERS: &str = "network::BUFFERS";
const WEB_CONNECTIONS: u64 = 6;

const CODE: &str = "tTrR";
const VARIABLES: &str = "dDbB";
const LARGEST: usize = 8;

/// Prints the sizes of these boards' images; of all if none are given.
pub(crate) fn print(boards: &[String]) -> Outcome {
    let mut all = board::nucleos()?;
    all.extend(board::RP2040.map(str::to_owned));
    for board in if boards.is_empty() { &all } else { boards } {
        let is_rp2040 = board::RP2040.contains(&board.as_str());
        let name = if is_rp2040 { "rp2040" } else { board.strip_prefix("nucleo_").unwrap_or(board) };
        let lines = read(format!("boards/{board}/src/main.rs"))?.lines().count();
        figure(&format!("{name}_main"), lines as f64, "lines", Some(99.0));
        // Eight ports, 64 rules, 16 clients.
        let budget = board == "nucleo_h743zi";
        if !is_rp2040 {
            let users = with_users(&format!("{name}_secure"), board, budget)?;
            if board::has_feature(board, "web")? {
                with_web(name, board, &users)?;
            }
        }
        let image = Image::build(board, " without EtherCAT", &board::WITH_USERS[..1])?;
        // Of the RP2040: the program's part of the flash; RAM but for the stack.
        let most = if is_rp2040 { Some((640.0, 200.0)) } else { budget.then_some((320.0, 128.0)) };
        image.totals(name, most);
        if budget {
            image.parts(name, board, Some(256.0))?;
            figure("router_core_flash", kib(image.core_flash()), "KiB", Some(24.0));
            image.gateway_ram()?;
            figure("router_core_ram_per_port", kib(image.core_ram()?), "KiB", Some(1.0));
        }
        let boot = Image::read(&board::boot_loader(board)?)?;
        figure(&format!("{name}_boot_flash"), kib(boot.flash()), "KiB", Some(32.0));
        if is_rp2040 {
            continue;
        }
        // Router, scanner and EtherCAT together: the image that users flash.
        let image = Image::build(board, "", &[])?;
        image.totals(&format!("{name}_ethercat"), Some((512.0, 192.0)));
    }
    Ok(())
}

/// Prints the sizes of a board's image with users and the audit trail, without EtherCAT; part by part where there is a budget.
fn with_users(name: &str, board: &str, budget: bool) -> Outcome<Image> {
    let image = Image::build(board, " with users, without EtherCAT", &board::WITH_USERS)?;
    image.totals(name, budget.then_some((352.0, 192.0)));
    if budget {
        image.parts(name, board, None)?;
    }
    Ok(image)
}

/// Prints what the web interface takes: its code, that is, without the page, its memory, and that of a connection.
fn with_web(name: &str, board: &str, users: &Image) -> Outcome {
    let image = Image::build(board, " with the web interface, without EtherCAT", &board::WITH_WEB)?;
    let page = page_bytes(&board::image(board)?.with_file_name("build"))?;
    figure(&format!("{name}_web_flash"), kib(image.flash() - users.flash() - page), "KiB", Some(96.0));
    figure(&format!("{name}_web_page"), kib(page), "KiB", Some(40_000.0 / 1024.0));
    figure(&format!("{name}_web_ram"), kib(image.ram() - users.ram()), "KiB", None);
    let of_connections = |image: &Image| image.variable(WEB_TASK) + image.variable(SOCKET_BUFFERS);
    let bytes = (of_connections(&image) - of_connections(users)) / WEB_CONNECTIONS;
    figure(&format!("{name}_web_connection_ram"), kib(bytes), "KiB", Some(8.0));
    Ok(())
}

/// Bytes of the page's files, compressed by the build script in this folder of them that ran last.
fn page_bytes(built: &Path) -> Outcome<u64> {
    let error = |error: std::io::Error| fault(built, &error);
    let written = |out: &PathBuf| out.join("page.js.gz").metadata().and_then(|file| file.modified()).ok();
    let folders = built.read_dir().map_err(error)?.flatten().map(|script| script.path().join("out"));
    let newest = folders.filter(|out| written(out).is_some()).max_by_key(written);
    let newest = newest.ok_or_else(|| format!("{}: there is no page", built.display()))?;
    let files = newest.read_dir().map_err(error)?.flatten();
    let files = files.filter(|file| file.path().extension().is_some_and(|kind| kind == "gz"));
    files.map(|file| Ok(file.metadata().map_err(error)?.len())).sum()
}

fn kib(bytes: u64) -> f64 {
    bytes as f64 / 1024.0
}

/// Whether a symbol belongs to the router's core.
fn is_core(symbol: &str) -> bool {
    let Some((_, module)) = symbol.split_once("mobgate::") else { return false };
    let within = |modules: &[&str]| modules.iter().any(|of| module.starts_with(of));
    within(&CORE) && !within(&BESIDES) && !TASKS.iter().any(|task| symbol.contains(task))
}

struct Symbol {
    bytes: u64,
    kind: char,
    name: String,
}

struct Image {
    symbols: Vec<Symbol>,
    /// Names, sizes and addresses.
    sections: Vec<(String, u64, u64)>,
}

impl Image {
    /// Builds an image with these arguments, and prints its sections and largest symbols.
    fn build(board: &str, which: &str, arguments: &[&str]) -> Outcome<Self> {
        board::run(board, "build", &arguments.iter().map(|&word| word.into()).collect::<Vec<_>>())?;
        let image = Self::read(&board::image(board)?)?;
        println!("{board}{which}:");
        for (name, bytes, _) in &image.sections {
            if [".vector_table", ".text", ".rodata", ".kept", ".data", ".bss", ".uninit"]
                .contains(&name.as_str())
            {
                println!("  {name:<14} {bytes:7}");
            }
        }
        for (kinds, what) in [(CODE, "code or constant"), (VARIABLES, "variable")] {
            let of_kind: Vec<_> = image.of_kind(kinds).collect();
            for symbol in &of_kind[of_kind.len().saturating_sub(LARGEST)..] {
                println!("  {:7} {what} {:.100}", symbol.bytes, symbol.name);
            }
        }
        Ok(image)
    }

    fn read(file: &Path) -> Outcome<Self> {
        let mut nm = command("nm", &["--print-size", "--size-sort", "--radix=d", "--demangle"]);
        let symbols = output(nm.arg(file))?;
        let symbols = symbols.lines().filter_map(|line| {
            let mut words = line.splitn(4, ' ').skip(1);
            let (bytes, kind, name) = (words.next()?, words.next()?, words.next()?);
            Some(Symbol { bytes: bytes.parse().ok()?, kind: kind.chars().next()?, name: name.into() })
        });
        let sections = output(command("size", &["-A", "-d"]).arg(file))?;
        let sections = sections.lines().filter_map(|line| {
            let mut words = line.split_whitespace();
            Some((words.next()?.to_owned(), words.next()?.parse().ok()?, words.next()?.parse().ok()?))
        });
        Ok(Self { symbols: symbols.collect(), sections: sections.collect() })
    }

    fn of_kind(&self, kinds: &str) -> impl Iterator<Item = &Symbol> {
        self.symbols.iter().filter(move |symbol| kinds.contains(symbol.kind))
    }

    fn sum(&self, of: &[&str]) -> u64 {
        let sections = self.sections.iter().filter(|(name, ..)| of.contains(&name.as_str()));
        sections.map(|(_, bytes, _)| bytes).sum()
    }

    /// Bytes that are programmed.
    fn flash(&self) -> u64 {
        self.sum(&[".boot2", ".vector_table", ".text", ".rodata", ".data", ".gnu.sgstubs"])
    }

    fn ram(&self) -> u64 {
        self.sum(&[".kept", ".data", ".bss", ".uninit"])
    }

    /// Bytes of the variables of this name.
    fn variable(&self, name: &str) -> u64 {
        self.of_kind(VARIABLES).filter(|symbol| symbol.name.ends_with(name)).map(|symbol| symbol.bytes).sum()
    }

    fn totals(&self, name: &str, most: Option<(f64, f64)>) {
        figure(&format!("{name}_flash"), kib(self.flash()), "KiB", most.map(|(flash, _)| flash));
        figure(&format!("{name}_ram"), kib(self.ram()), "KiB", most.map(|(_, ram)| ram));
    }

    /// Prints the flash of what was added, part by part, and of the rest.
    fn parts(&self, name: &str, board: &str, most: Option<f64>) -> Outcome {
        let text = self.sections.iter().find(|(name, ..)| name == ".text");
        let code = text.map_or(0..0, |&(_, bytes, address)| address..address + bytes);
        let mut rest = self.flash();
        for (part, bytes) in parts::bytes(&board::image(board)?, code)? {
            figure(&format!("{name}_{part}_flash"), kib(bytes), "KiB", None);
            rest -= bytes;
        }
        figure(&format!("{name}_core_flash"), kib(rest), "KiB", most);
        Ok(())
    }

    fn core_flash(&self) -> u64 {
        let core = self.of_kind(CODE).filter(|symbol| is_core(&symbol.name));
        core.map(|symbol| symbol.bytes).sum()
    }

    /// The core's RAM for one port.
    fn core_ram(&self) -> Outcome<u64> {
        let source = read("boards/firmware/src/gateway.rs")?;
        let ports = source.lines().find(|line| line.contains("const PORTS: usize = if "));
        let ports =
            ports.and_then(|line| line.rsplit_once("else { ")?.1.strip_suffix(" };")?.parse::<u64>().ok());
        let ports = ports.ok_or("boards/firmware/src/gateway.rs does not say how many ports there are")?;
        Ok(self.named("gateway::PORT_STATES")? / ports)
    }

    fn named(&self, end: &str) -> Outcome<u64> {
        let symbol = self.symbols.iter().find(|symbol| symbol.name.ends_with(end));
        symbol.map(|symbol| symbol.bytes).ok_or(format!("no {end} in the image"))
    }

    /// Prints the parts and the total.
    fn gateway_ram(&self) -> Outcome {
        for (part, name) in PARTS {
            figure(&format!("gateway_ram_{part}"), kib(self.named(name)?), "KiB", None);
        }
        let is_gateway =
            |name: &str| name.contains("mobgate_firmware::gateway::") || name.ends_with(PARTS[0].1);
        let statics = self.of_kind(VARIABLES).filter(|symbol| is_gateway(&symbol.name));
        // Eight ports, 64 rules, 16 clients.
        figure("gateway_ram", kib(statics.map(|symbol| symbol.bytes).sum()), "KiB", Some(82.5));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{BESIDES, CORE, PARTS, is_core};
    use crate::tools::{read, root};

    #[test]
    fn each_part_of_the_ram_is_a_figure_of_the_gate() {
        let figures = read("tests/figures").unwrap();
        for (part, _) in PARTS {
            assert!(figures.lines().any(|line| line == format!("gateway_ram_{part}")), "{part}");
        }
    }

    /// Renaming a module or function would change the figure silently.
    #[test]
    fn what_the_core_is_made_of_is_there() {
        for path in CORE.iter().chain(&BESIDES) {
            let path = path.trim_end_matches(':').replace("::", "/");
            let module = root().join(format!("src/{path}.rs")).exists();
            let function = || {
                let (file, name) = path.rsplit_once('/')?;
                Some(read(format!("src/{file}.rs")).ok()?.contains(&format!("fn {name}(")))
            };
            assert!(module || function() == Some(true), "{path}");
        }
    }

    #[test]
    fn symbols_of_the_core_are_told_from_those_beside_it() {
        for (symbol, core) in [
            ("<mobgate::port::client::dispatcher::Dispatcher>::next", true),
            ("<mobgate::gateway::Gateway>::refuse", true),
            ("<mobgate::settings::rule::Tag>::apply", true),
            ("<&mobgate::settings::rules::Rules as core::fmt::Display>::fmt", false),
            ("mobgate::gateway::reconfigure::draft::{closure#0}", false),
            ("<mobgate::gateway::Gateway>::run_port::<Lines>::{closure#0}", false),
            ("mobgate_firmware::gateway::start", false),
        ] {
            assert_eq!(is_core(symbol), core, "{symbol}");
        }
    }
}
