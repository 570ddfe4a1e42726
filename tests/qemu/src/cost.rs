//! What the gateway costs on the board: instructions, by SysTick where each takes the same time, and bytes of memory.

use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use crate::figure::{Target, figure};
use crate::passing::Passing;
use crate::{Bus, Console, Figures, Image, Machine, Options};

/// The counts and sizes that hold as good; more is a fault that a change of this file must own up to.
const BUDGETS: &str = include_str!("../budgets");
/// Room that a count has above its budget.
const GROWTH: f64 = 1.05;
/// Sessions by SSH that the board has, and sockets.
const SSH_SESSIONS: f64 = 8.0;
const SOCKETS: f64 = 26.0;
/// Connections of the web interface.
const WEB_CONNECTIONS: f64 = 8.0;
/// Times that each thing is measured.
pub(crate) const TRIALS: usize = 21;
/// Time after which nothing happens any more.
pub(crate) const SETTLED: Duration = Duration::from_millis(60);
/// A tick is 40 ns, an instruction 64 ns.
pub(crate) const INSTRUCTIONS_PER_TICK: f64 = 40.0 / 64.0;
/// Most instructions for a byte that is passed on.
const PER_BYTE_MAX: f64 = 60.0;
/// Most instructions that roles add, and times that a transaction is measured for it: among so many some meet no disturbance at all.
const ROLE_PATH_MAX: f64 = 20.0;
const ROLE_TRIALS: usize = 151;
/// Registers of a short frame and of a long one, both passed on while they arrive, and times that each is measured.
const FEW_REGISTERS: u8 = 20;
const MANY_REGISTERS: u8 = 120;
const BYTE_TRIALS: usize = 9;
/// Passwords that are set, and the clocks of boards in MHz.
const PASSWORDS: usize = 5;
const BOARDS: [(&str, f64); 3] = [("f429zi", 168.0), ("f767zi", 216.0), ("h743zi", 400.0)];
/// The board's counts of ticks come round.
pub(crate) const TICKS_ROUND: u32 = 1 << 24;

/// Prints the sizes of the image.
pub fn sizes() {
    let (flash, ram) = size(Image::Usual);
    figure("qemu_image_flash", flash, "bytes", Target::AtMost(budget("image_flash")));
    figure("qemu_image_ram", ram, "bytes", Target::AtMost(budget("image_ram")));
}

/// Bytes of flash and of RAM.
fn size(image: Image) -> (f64, f64) {
    let output = Command::new("size").arg(image.build()).output().expect("size, of binutils");
    let text = String::from_utf8(output.stdout).unwrap();
    let numbers: Vec<f64> = text
        .lines()
        .nth(1)
        .unwrap_or_default()
        .split_whitespace()
        .map_while(|word| word.parse().ok())
        .collect();
    let [code, data, bss] = numbers[..3] else { panic!("{text}") };
    (code + data, data + bss)
}

/// Bytes of each of `shares` of an image: variables, whose names end like this, by how many use them.
fn share(image: Image, shares: &[(&str, f64)]) -> f64 {
    let output = Command::new("nm").args(["--demangle", "--print-size"]).arg(image.build()).output();
    let symbols = String::from_utf8(output.expect("nm, of binutils").stdout).unwrap();
    let size = |name: &str| {
        let symbol = symbols.lines().find(|line| line.ends_with(name)).unwrap_or_else(|| panic!("no {name}"));
        let size = symbol.split(' ').nth(1).and_then(|size| u32::from_str_radix(size, 16).ok());
        f64::from(size.expect("a size"))
    };
    shares.iter().map(|(name, users)| size(name) / users).sum()
}

/// Prints the bytes of a session by SSH: its task, and the buffer of its socket.
pub fn ssh_session() {
    let shares = [("::ssh::session::POOL", SSH_SESSIONS), ("::network::start::BUFFERS", SOCKETS)];
    let bytes = share(Image::Ssh, &shares);
    figure("qemu_ssh_session_ram", bytes, "bytes", Target::AtMost(budget("ssh_session")));
}

/// Prints the instructions that roles in rules add to a transaction by rules without one: by two images in one run.
pub fn roles(folder: &Path) {
    let [without, with] = [Image::Usual, Image::Roles].map(|image| {
        let options = Options { counts_instructions: true, image, ..Options::default() };
        let machine = Machine::start(folder, options);
        let bus = Bus::new([1, 2]);
        machine.wire(1, &bus);
        let (mut figures, mut client) = (machine.figures(), machine.client());
        let mut least = |act: &mut dyn FnMut()| f64::from(trials(&mut figures, ROLE_TRIALS, act)[0].0);
        let idle = least(&mut || {});
        (least(&mut || drop(client.read(1, 0, 10))) - idle) * INSTRUCTIONS_PER_TICK
    });
    figure("role_path_transaction_instructions", with, "instructions", Target::None);
    figure("role_path_instructions", with - without, "instructions", Target::AtMost(ROLE_PATH_MAX));
}

/// Prints what the web interface takes of the image, of which its page has so many bytes, and of the memory.
pub(crate) fn web_interface(page: f64) {
    let [with, without] = [Image::Web, Image::Usual].map(size);
    let code = with.0 - without.0 - page;
    figure("qemu_web_flash", code, "bytes", Target::AtMost(budget("web_flash")));
    figure("qemu_web_page", page, "bytes", Target::AtMost(budget("web_page")));
    let sockets = SOCKETS + WEB_CONNECTIONS;
    let shares = [("::web::connection::POOL", WEB_CONNECTIONS), ("::network::start::BUFFERS", sockets)];
    let bytes = share(Image::Web, &shares);
    figure("qemu_web_connection_ram", bytes, "bytes", Target::AtMost(budget("web_connection")));
    figure("qemu_web_ram", with.1 - without.1, "bytes", Target::None);
}

/// Prints the instructions of a transaction and of a byte that is passed on; gives those of a transaction.
pub fn instructions(folder: &Path) -> f64 {
    let machine = Machine::start(folder, Options { counts_instructions: true, ..Options::default() });
    let bus = Bus::new([1, 2]);
    machine.wire(1, &bus);
    let mut figures = machine.figures();
    let mut client = machine.client();
    let transaction = typical(&mut figures, TRIALS, || drop(client.read(1, 0, 10)));
    let target = Target::AtMost(GROWTH * budget("transaction_instructions"));
    figure("qemu_transaction_instructions", transaction.all, "instructions", target);
    password(&mut machine.console(), &mut figures);
    passed_on(&machine, &mut figures);
    let most = Target::AtMost(budget("stack"));
    figure("qemu_stack_icount", f64::from(figures.stack_bytes()), "bytes", most);
    transaction.all
}

/// Prints the memory and the instructions of a password's hash, and how long a board stands still for it, at an instruction a cycle.
fn password(console: &mut Console, figures: &mut Figures) {
    assert_eq!(console.run("user anna role viewer"), "");
    let hashed = typical(figures, PASSWORDS, || {
        console.type_keys("password anna\rlet me in\rlet me in\r");
        console.read_until("*> ");
    });
    let secrets = console.run("show config secrets");
    let memory = secrets.split_once("$m=").and_then(|(_, costs)| costs.split_once(',')?.0.parse().ok());
    figure("argon2_memory_kib", memory.expect("a hash"), "KiB", Target::None);
    figure("argon2_instructions", hashed.all, "instructions", Target::None);
    for (board, mhz) in BOARDS {
        figure(&format!("{board}_argon2_ms"), hashed.all / mhz / 1000.0, "ms", Target::None);
    }
    assert_eq!(console.run("delete user anna"), "");
}

/// Writes and reads of many registers and of few, from line to line, while they arrive.
fn passed_on(machine: &Machine, figures: &mut Figures) {
    let mut console: Console = machine.console();
    assert_eq!(console.run("delete routes"), "");
    let mut passing = Passing::start(machine, &mut console);
    let mut write = |registers: u8| {
        let values = vec![0x55; 2 * usize::from(registers)];
        passing.ask(&[&[16, 0, 0, 0, registers, 2 * registers][..], &values].concat(), 8);
    };
    let requests = per_byte(figures, &mut write);
    let responses = per_byte(figures, &mut |registers| passing.read(registers));
    let cut = console.count("P3", "cut") as f64 / console.count("P3", "requests") as f64;
    figure("qemu_cut_through_share", 100.0 * cut, "%", Target::None);
    let worst = requests.gateway.max(responses.gateway);
    figure("qemu_cut_through_instructions", worst, "instructions/byte", Target::AtMost(PER_BYTE_MAX));
    figure("qemu_cut_through_requests", requests.gateway, "instructions/byte", Target::None);
    figure("qemu_cut_through_answers", responses.gateway, "instructions/byte", Target::None);
    // An interrupt for each byte, which is moved in and out.
    figure("qemu_uart_instructions", requests.all - requests.gateway, "instructions/byte", Target::None);
}

/// What a register more costs, for each of its bytes.
fn per_byte(figures: &mut Figures, act: &mut dyn FnMut(u8)) -> Cost {
    let few = typical(figures, BYTE_TRIALS, || act(FEW_REGISTERS));
    let many = typical(figures, BYTE_TRIALS, || act(MANY_REGISTERS));
    let bytes = 2.0 * f64::from(MANY_REGISTERS - FEW_REGISTERS);
    Cost { all: (many.all - few.all) / bytes, gateway: (many.gateway - few.gateway) / bytes }
}

/// Instructions: all of them, and those without what moves the bytes of UARTs.
pub(crate) struct Cost {
    pub(crate) all: f64,
    gateway: f64,
}

/// What `act` costs, by so many trials.
pub(crate) fn typical(figures: &mut Figures, trials: usize, mut act: impl FnMut()) -> Cost {
    let idle = undisturbed(figures, trials, &mut || {});
    let active = undisturbed(figures, trials, &mut act);
    Cost {
        all: (active.0 - idle.0) * INSTRUCTIONS_PER_TICK,
        gateway: (active.1 - idle.1) * INSTRUCTIONS_PER_TICK,
    }
}

/// Ticks in the lower quartile of trials: where this host is busy, bytes come late and in more pieces, which only adds some.
fn undisturbed(figures: &mut Figures, count: usize, act: &mut dyn FnMut()) -> (f64, f64) {
    let (all, gateway) = trials(figures, count, act)[count / 4];
    (f64::from(all), f64::from(gateway))
}

/// Ticks of so many trials, the fewest first.
fn trials(figures: &mut Figures, count: usize, act: &mut dyn FnMut()) -> Vec<(u32, u32)> {
    let mut trials: Vec<(u32, u32)> = (0..count)
        .map(|_| {
            let before = figures.busy();
            act();
            // Until acknowledgements have come, and timers of the line have run out.
            sleep(SETTLED);
            let after = figures.busy();
            (after.0.wrapping_sub(before.0) % TICKS_ROUND, after.1.wrapping_sub(before.1) % TICKS_ROUND)
        })
        .collect();
    trials.sort_unstable();
    trials
}

/// What holds as good.
pub(crate) fn budget(name: &str) -> f64 {
    let lines = BUDGETS.lines().filter_map(|line| line.split_once(' '));
    let (_, value) = lines.into_iter().find(|(budget, _)| *budget == name).expect("a budget");
    value.trim().parse().expect("a number")
}
